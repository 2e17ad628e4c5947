"""Integrals of |e^(Fs) E| over s >= 0, by entries, bounded from above in balls.

Cell by cell (`lmi.bounds.flow_cells`), until what is left is hardly more than one mode, or for many
cells. What is left behind them is bounded mode by mode. A pair with eigenvalues -a +- bi changes
its sign with each half period tau = pi / b, up to a remainder D of other modes, and so

    q = e^(-a tau),   D = (e^(F tau) + q) X,
    int_0^inf |e^(Fs) X| <= (int_0^tau |e^(Fs) X| + int_0^inf |e^(Fs) D|) / (1 - q)

for any 0 <= q < 1: a geometric series, which is exact however small the damping is. Integrals of
D, and of real modes, are bounded in moduli.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import reduce

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.balls import (
    Balls,
    Exact,
    Rational,
    entries,
    exact,
    exp_times,
    precision,
    rational,
    scalar,
    to_float,
)
from lmi.arithmetic.norms import float_above, least_balls, middles, upper_balls
from lmi.bounds.flow_cells import Course
from lmi.bounds.flow_comparison import FlowComparison, Subspaces
from lmi.bounds.peak_gain import decaying_integrals
from lmi.prove.hurwitz import rightmost

_BITS = 160
# how much more than one mode may be left behind the last cell, in parts of the integrals; after
# how many cells that is looked at
_REMAINDER, _BETWEEN = 1e-4, 16
# weights of squares grow at these parts of the decay rate: half of it is best where all modes decay
# alike, more where those that decay faster are larger
_SHARES = (0.5, 0.75, 0.9)


def absolute_integrals(F: Exact, E: Exact) -> Matrix | None:
    """Upper bounds of the integrals of |e^(Fs) E| over s >= 0, (n, k) floats.

    F (n, n) Hurwitz, E (n, k), exact. None where decay is not proved. Each state is bounded among
    those that act on it and are driven: others do not make its bound larger.
    """
    result = np.zeros(E.shape)
    if not E.size:
        return result
    acts = _reach(F)
    is_driven = acts[:, np.array(E != 0, dtype=bool).any(axis=1)].any(axis=1)
    acting = acts & is_driven
    with precision(_BITS):
        still = F[np.ix_(~is_driven, ~is_driven)]
        if still.size and Course.from_pair(still, still).comparison is None:
            return None
        for states in np.unique(acting[is_driven], axis=0):
            bounds = _coupled_integrals(F[np.ix_(states, states)], E[states])
            if bounds is None:
                return None
            own = is_driven & (acting == states).all(axis=1)
            result[own] = bounds[own[states]]
    return result if np.isfinite(result).all() else None


def _reach(F: Exact) -> Array:
    """Does state j act on state i, itself or through others? (n, n)."""
    n = len(F)
    acts = np.array(F != 0, dtype=bool) | np.eye(n, dtype=bool)
    for _ in range(n.bit_length()):
        acts = acts @ acts
    return acts


def _coupled_integrals(F: Exact, E: Exact) -> Matrix | None:
    """The same for all states at once."""
    course = Course.from_pair(F, E)
    if course.comparison is None:
        return None
    time, total = rational(0.0), 0 * entries(course.X)
    for count, cell in enumerate(course.cells(time, None), 1):
        total, time = total + cell.integral, cell.end
        if count % _BETWEEN == 0 and _is_settled(course, course.comparison, time, total):
            break
    bounds = total + course.in_units_of_x(_later(course, course.comparison, course.at(time)))
    return np.array([[float_above(value) for value in row] for row in bounds])


def _is_settled(course: Course, comparison: FlowComparison, time: Rational, total: Exact) -> bool:
    """Is what is left at a time hardly more than one mode in each state?"""
    left, sums = course.at(time), np.abs(middles(total)).sum(axis=1)
    others = [basis.coupled_integrals(left) for basis in comparison.bases]
    rows = [to_float(course.units) * each.sum(axis=1) for each in others]
    return any(bool((row <= _REMAINDER * sums).all()) for row in rows)


def _later(course: Course, comparison: FlowComparison, X: Balls) -> Exact:
    """The least of several bounds of the integrals of |e^(Fs) X|, (n, k).

    In units of the course. Many pairs are bounded best by squares (`lmi.bounds.peak_gain`).
    """
    bounds = [_by_subspaces(course, basis, X) for basis in comparison.bases]
    decay, unit = -rightmost(to_float(course.F)).real, exact(np.eye(len(course.F)))
    for share in _SHARES:
        by_squares = decaying_integrals(course.F, unit, share * decay)
        if by_squares is not None:
            bounds.append(upper_balls(by_squares(X)))
    return reduce(least_balls, bounds, comparison.integrals(X))


def _by_subspaces(course: Course, basis: Subspaces, X: Balls) -> Exact:
    """The same as a sum over subspaces."""
    bounds = []
    for part, value in zip(basis.parts(X), basis.eigenvalues, strict=True):
        bound = basis.integrals(part)
        if value.imag:
            bound = least_balls(bound, _by_half_periods(course, basis, part, value))
        bounds.append(bound)
    return upper_balls(sum(bounds[1:], bounds[0]))


def _by_half_periods(course: Course, basis: Subspaces, X: Balls, value: complex) -> Exact:
    """The same for X in the subspace of a pair, about an eigenvalue of which this is."""
    half_period = math.pi / value.imag
    share = scalar(rational(min(math.exp(value.real * half_period), math.nextafter(1, 0))))
    end, own = rational(half_period), replace(course, X=X)
    first = 0 * entries(X)
    for cell in own.cells(rational(0.0), end):
        first = first + cell.integral / course.units[:, None]
    remainder = exp_times(course.F, end) * X + X * share
    return upper_balls((first + basis.integrals(remainder)) / (1 - share))
