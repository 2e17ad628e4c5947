"""Integrals of |e^(Fs) E|, by entries, bounded from above in balls.

On a cell of s on which an entry keeps its sign the integral of its modulus is that of the entry
itself, which is exact; on others it is at most that of the chord and the deviation from it,

    int_a^b |f| <= int_a^b |chord| + (b - a)^3 / 12 max |f''|,

and the same bound of f'' shows where the sign is kept. It is that of `lmi.bounds.flow_comparison`
for all later s, so that cells grow as fast modes decay. What is left after the last one is bounded
in moduli: little, unless the damping ratio is below some 0.02, where the cells end before decay,
and the sum is up to some pi / 2 times the integral.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import (
    Ball,
    Balls,
    Exact,
    Rational,
    ball,
    entries,
    exact,
    exp_times,
    inverse,
    nearest_float,
    precision,
    rational,
    scalar,
    to_float,
)
from lmi.arithmetic.norms import float_above, middles
from lmi.bounds.flow_comparison import FlowComparison

_BITS = 160
# the first cell spans this much of 1 / ||F||, the others that times powers of two; so many cells
# are multiplied from one to the next before e^(Fs) is computed anew, in so many groups
_REACH, _CELLS, _GROUPS = 2.0**-5, 32, 50
# what cells may add to integrals, and with how little left behind the last one they end, in parts
_ALLOWED, _REMAINDER = 0.002, 1e-4


def absolute_integrals(F: Exact, E: Exact) -> Matrix | None:
    """Upper bounds of the integrals of |e^(Fs) E| over s >= 0, (n, k) floats.

    F (n, n) Hurwitz, E (n, k), exact. None where decay is not proved. Each state is bounded among
    those that act on it: fast ones that do not leave it as close as it is without them.
    """
    result = np.zeros(E.shape)
    if not E.size:
        return result
    acting = _acting(F)
    for states in set(acting):
        part = _coupled_integrals(F[np.ix_(states, states)], E[list(states)])
        if part is None:
            return None
        for i in (i for i, own in enumerate(acting) if own == states):
            result[i] = part[states.index(i)]
    return result


def _acting(F: Exact) -> list[tuple[int, ...]]:
    """For each state itself and all that act on it, through others too."""
    n = len(F)
    acts = np.array(F != 0, dtype=bool) | np.eye(n, dtype=bool)
    for _ in range(n.bit_length()):
        acts = acts @ acts
    return [tuple(map(int, np.flatnonzero(row))) for row in acts]


def _coupled_integrals(F: Exact, E: Exact) -> Matrix | None:
    """The same for all states at once."""
    scaling = Scaling.from_pair(F, 0 * F, math.inf)
    with precision(_BITS):
        course = _Course.from_pair(scaling.map(F), scaling.rows(E))
        if course is None:
            return None
        bounds = _integrals(course) * exact(scaling.sizes)[:, None]
    result = np.array([[float_above(value) for value in row] for row in bounds])
    return result if np.isfinite(result).all() else None


def _integrals(course: _Course) -> Exact:
    """Upper bounds of the integrals over all s, (n, k)."""
    time, exponent = rational(0.0), 0
    total = entries(0 * course.E)
    least = _row_sums(entries(course.back * course.E))  # what constant inputs come to
    for _ in range(_GROUPS):
        X = course.at(time)
        for _ in range(_CELLS):
            curve = course.largest_curvature(X)
            share = np.fmax(_row_sums(total), least) / (nearest_float(time) + course.shortest)
            exponent = course.longest(exponent + 1, curve, X, share)
            step = course.step(exponent)
            later = step.onwards * X
            total = total + course.cell_integral(X, later, curve, scalar(step.length))
            time, X = time + step.length, later
        left = course.comparison.integrals(X)
        if (_row_sums(left) <= _REMAINDER * _row_sums(total)).all():
            break
    return np.asarray(total + left)


@dataclass(frozen=True)
class _Step:
    """A length of cells h, and e^(Fh)."""

    length: Rational
    onwards: Balls


@dataclass(frozen=True)
class _Course:
    """X(s) = e^(Fs) E, F (n, n) exact, E (n, k); shortest: length of the shortest cells."""

    F: Exact
    E: Balls
    comparison: FlowComparison
    shortest: float
    twice: Balls  # F^2
    back: Balls  # F^-1
    steps: dict[int, _Step] = field(default_factory=dict)

    @staticmethod
    def from_pair(F: Exact, E: Exact) -> _Course | None:
        """None where decay is not proved."""
        comparison = FlowComparison.from_flow(F)
        back = inverse(F)
        if comparison is None or back is None:
            return None
        size = float(np.abs(to_float(F)).sum(axis=1).max())
        return _Course(F, ball(E), comparison, _REACH / size, ball(F @ F), ball(back))

    def at(self, time: Rational) -> Balls:
        """X at a time."""
        return exp_times(self.F, time) * self.E

    def step(self, exponent: int) -> _Step:
        """Cells of 2^exponent times the shortest length."""
        if exponent not in self.steps:
            length = rational(math.ldexp(self.shortest, exponent))
            self.steps[exponent] = _Step(length, exp_times(self.F, length))
        return self.steps[exponent]

    def largest_curvature(self, X: Balls) -> Exact:
        """Bounds of |X''| at this and all later times."""
        return self.comparison.largest(self.twice * X)

    def longest(self, most: int, curve: Exact, X: Balls, share: Matrix) -> int:
        """The exponent, at most `most`, of a cell that adds little to the sums over columns.

        share (n,): of these sums for each unit of time.
        """
        bend, allowed = _row_sums(curve) / 12, _ALLOWED * (_row_sums(entries(X)) + share)
        for exponent in range(most, 0, -1):
            if (math.ldexp(self.shortest, exponent) ** 2 * bend <= allowed).all():
                return exponent
        return 0

    def cell_integral(self, X: Balls, later: Balls, curve: Exact, length: Ball) -> Exact:
        """Bounds of the integral of |X| from X to `later`."""
        first, last = entries(X), entries(later)
        low, high = abs(first), abs(last)
        signed = abs(entries(self.back * (later - X)))
        deviation = curve * (length * length / 8)
        keeps_sign = (first * last > 0) & (low > deviation) & (high > deviation)
        # of the chord: a trapezium, or two triangles, whose sum is not certainly less
        chord = (low + high) * (length / 2)
        is_crossing = first * last < 0
        crossing = (low * low + high * high) / (low + high)
        chord = np.where(is_crossing, crossing * (length / 2), chord)
        return np.where(keeps_sign, signed, chord + deviation * (length * 2 / 3))


def _row_sums(values: Exact) -> Matrix:
    sums: Matrix = np.abs(middles(values)).sum(axis=1)
    return sums
