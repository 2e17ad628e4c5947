"""|e^(Fs) X| on cells of s, by entries, bounded from above in balls.

On a cell on which an entry keeps its sign the integral of its modulus is that of the entry itself,
which is exact; on others it is at most that of the chord and the deviation from it,

    int_a^b |f| <= int_a^b |chord| + (b - a)^3 / 12 max |f''|,

and the same bound of f'' shows where the sign is kept, and how large |f| is. It is that of
`lmi.bounds.flow_comparison` for all later s, so that cells grow as fast modes decay; by ||F|| where
the flow is not proved to decay.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import (
    Balls,
    Exact,
    Rational,
    ball,
    ball_matrix,
    entries,
    exact,
    exp_around,
    exp_times,
    nearest_float,
    rational,
    scalar,
    solve_entries,
    to_float,
)
from lmi.arithmetic.norms import largest_balls, least_balls, middles, upper_balls
from lmi.bounds.flow_comparison import FlowComparison

# the first cell spans this much of 1 / ||F||, later ones that times powers of two, at most this
# part of the time before, and where the flow is not proved to decay at most so much of 1 / ||F||
_SHORTEST, _GRADING, _LONGEST = 2.0**-5, 2.0**-5, 2.0
# after so many cells e^(Fs) is computed anew: products of balls grow wide
_PRODUCTS = 32
# after so many cells the last ones, as many again, are as long as it takes
_MOST = 1000
# what cells may add to integrals, in parts of them
_ALLOWED = 0.002


@dataclass(frozen=True)
class Cell:
    """A stretch of s: largest (n, k) >= |e^(Fs) X| on it, integral (n, k) of |e^(Fs) X| over it."""

    largest: Exact
    integral: Exact
    end: Rational


@dataclass(frozen=True)
class _Step:
    """A length of cells h, e^(Fh), the integral of e^(Fs) from 0 to h, e^(Fs) for |s| <= h."""

    length: Rational
    flow: Balls
    integral: Balls
    around: Balls

    @staticmethod
    def from_length(F: Exact, length: Rational) -> _Step:
        """For F (n, n)."""
        n = len(F)
        unit, zero = exact(np.eye(n)), 0 * F
        whole = entries(exp_times(np.block([[F, unit], [zero, zero]]), length))
        longest = math.nextafter(nearest_float(length), math.inf)
        return _Step(length, ball_matrix(whole[:n, :n]), ball_matrix(whole[:n, n:]),
                     exp_around(F, longest))  # fmt: skip


@dataclass(frozen=True)
class Course:
    """X(s) = e^(Fs) X, in units that balance F; comparison: None where F need not decay.

    F (n, n) exact, X (n, k), units (n,) exact; parts: of the columns, each of which is bounded
    closely, whatever the units of the others; size: ||F||.
    """

    F: Exact
    X: Balls
    units: Exact
    comparison: FlowComparison | None
    parts: tuple[slice, ...]
    size: float
    steps: dict[int, _Step] = field(default_factory=dict)

    @staticmethod
    def from_pair(F: Exact, X: Exact, parts: tuple[slice, ...] = (slice(None),)) -> Course:
        """At the current precision."""
        scaling = Scaling.from_pair(F, 0 * F, math.inf)
        flow, units = scaling.map(F), exact(scaling.sizes)
        size = float(np.abs(to_float(flow)).sum(axis=1).max(initial=0.0)) or 1.0
        comparison = FlowComparison.from_flow(flow)
        return Course(flow, ball(scaling.rows(X)), units, comparison, parts, size)

    def at(self, time: Rational) -> Balls:
        """X at a time, in own units."""
        return exp_times(self.F, time) * self.X

    def instant(self, time: Rational) -> Cell:
        """A cell of no length."""
        values = upper_balls(self.in_units_of_x(entries(self.at(time))))
        return Cell(values, 0 * values, time)

    def cells(self, start: Rational, end: Rational | None) -> Iterator[Cell]:
        """Cells from `start` to `end`; without end as many as there are of free length."""
        time, state, exponent = start, self.at(start), 0
        totals = np.zeros((len(self.parts), len(self.F)))
        for used in itertools.count():
            if time == end or (end is None and used >= _MOST):
                return
            if used and used % _PRODUCTS == 0:
                state = self.at(time)
            since = nearest_float(time - start) + self._length(0)
            most = min(exponent + 1, self._graded(time))
            curve = self._curvature(state)
            sums = self._sums(middles(entries(state))) + np.fmax(totals, self._least) / since
            exponent = self._exponent(curve, most, sums)
            step = self._step(exponent, None if end is None else end - time, used)
            later = step.flow * state
            cell = _chord_cell((state, later), step, curve(step), time + step.length)
            if step.length > self._steps_of(exponent).length:
                cell = self._cut(cell, state, step.length)
            totals = totals + self._sums(middles(cell.integral))
            yield replace(
                cell,
                largest=self.in_units_of_x(cell.largest),
                integral=self.in_units_of_x(cell.integral),
            )
            time, state = cell.end, later

    def later(self, time: Rational) -> Cell | None:
        """All s from a time on, as a cell; None where the flow is not proved to decay."""
        if self.comparison is None:
            return None
        state = self.at(time)
        largest, integral = self.comparison.largest(state), self.comparison.integrals(state)
        return Cell(self.in_units_of_x(largest), self.in_units_of_x(integral), time)

    def in_units_of_x(self, values: Exact) -> Exact:
        """Rows of own units, (n, k)."""
        return np.asarray(values * self.units[:, None])

    @cached_property
    def _least(self) -> Matrix:
        """What constant inputs come to, by parts and rows; zeros where F is singular."""
        constant = solve_entries(entries(ball(self.F)), entries(self.X))
        if constant is None:
            return np.zeros((len(self.parts), len(self.F)))
        return self._sums(middles(constant))

    @cached_property
    def _twice(self) -> Balls:
        return ball(self.F @ self.F)

    def _sums(self, values: Matrix) -> Matrix:
        return np.array([np.abs(values[:, part]).sum(axis=1) for part in self.parts])

    def _length(self, exponent: int) -> float:
        return math.ldexp(_SHORTEST / self.size, exponent)

    def _graded(self, time: Rational) -> int:
        """The largest exponent at a time."""
        longest = _GRADING * nearest_float(time)
        if self.comparison is None:
            longest = min(longest, _LONGEST / self.size)
        ratio = longest / self._length(0)
        return math.floor(math.log2(ratio)) if ratio >= 1 else 0

    def _curvature(self, state: Balls) -> Callable[[_Step], Exact]:
        """Bounds (n, k) of |X''| on a cell, by its step."""
        second = self._twice * state
        if self.comparison is None:
            return lambda step: upper_balls(entries(step.around * second))
        largest = self.comparison.largest(second)
        return lambda _: largest

    def _exponent(self, curve: Callable[[_Step], Exact], most: int, sums: Matrix) -> int:
        """The exponent, at most `most`, of a cell that adds little to these sums, (parts, n)."""
        for exponent in range(most, 0, -1):
            bend = self._sums(middles(curve(self._steps_of(exponent))))
            if (self._length(exponent) ** 2 * bend <= 12 * _ALLOWED * sums).all():
                return exponent
        return 0

    def _steps_of(self, exponent: int) -> _Step:
        if exponent not in self.steps:
            length = rational(self._length(exponent))
            self.steps[exponent] = _Step.from_length(self.F, length)
        return self.steps[exponent]

    def _step(self, exponent: int, left: Rational | None, used: int) -> _Step:
        """That of an exponent, longer once many are used, no longer than what is left."""
        step = self._steps_of(exponent)
        if left is None:
            return step
        length = step.length
        if used >= _MOST:
            length = max(length, left / max(2 * _MOST - used, 1))
        length = min(length, left)
        if length == step.length:
            return step
        return _Step.from_length(self.F, length)

    def _cut(self, cell: Cell, state: Balls, length: Rational) -> Cell:
        """The cell, where the flow decays no larger than all that follows from its first state."""
        if self.comparison is None:
            return cell
        largest = least_balls(upper_balls(cell.largest), self.comparison.largest(state))
        integral = least_balls(upper_balls(cell.integral), upper_balls(largest * scalar(length)))
        return replace(cell, largest=largest, integral=integral)


def _chord_cell(states: tuple[Balls, Balls], step: _Step, curve: Exact, end: Rational) -> Cell:
    """By the chord between two states, and the signed integral where the sign is kept."""
    length = scalar(step.length)
    first, last = map(entries, states)
    low, high = abs(first), abs(last)
    deviation = curve * (length * length / 8)
    keeps_sign = (first * last > 0) & (low > deviation) & (high > deviation)
    # of the chord: a trapezium, or two triangles, whose sum is not certainly less
    chord = (low + high) * (length / 2)
    crossing = (low * low + high * high) / (low + high)
    chord = np.where(first * last < 0, crossing * (length / 2), chord)
    signed = abs(entries(step.integral * states[0]))
    integral = np.where(keeps_sign, signed, chord + deviation * (length * 2 / 3))
    return Cell(largest_balls(low, high) + deviation, integral, end)
