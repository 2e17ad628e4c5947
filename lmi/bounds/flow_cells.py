"""|e^(Fs) X| on cells of s of equal length, by entries, bounded from above in balls.

On a cell on which an entry keeps its sign the integral of its modulus is that of the entry itself,
which is exact; on others it is at most that of the tangent in the middle and its largest deviation.
Where the flow decays, neither is more than `lmi.bounds.flow_comparison` says of all later s: the
deviation, by ||F||, grows with the length of cells beyond all bounds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

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
    scalar,
)
from lmi.arithmetic.norms import upper_balls
from lmi.bounds.flow_comparison import FlowComparison

# after so many cells e^(Fs) is computed anew: products of balls grow wide
_PRODUCTS = 32


@dataclass(frozen=True)
class Cell:
    """A stretch of s: largest (n, k) >= |e^(Fs) X| on it, integral (n, k) of |e^(Fs) X| over it."""

    largest: Exact
    integral: Exact


@dataclass(frozen=True)
class Course:
    """X(s) = e^(Fs) X, F (n, n) exact, X (n, k); comparison: None where F need not decay."""

    F: Exact
    X: Balls
    comparison: FlowComparison | None

    @staticmethod
    def from_pair(F: Exact, X: Exact) -> Course:
        """At the current precision."""
        return Course(F, ball(X), FlowComparison.from_flow(F))

    def at(self, time: Rational) -> Balls:
        """X at a time."""
        return exp_times(self.F, time) * self.X

    def later(self, time: Rational) -> Cell | None:
        """All s from a time on; None where the flow is not proved to decay."""
        if self.comparison is None:
            return None
        state = self.at(time)
        return Cell(self.comparison.largest(state), self.comparison.integrals(state))

    def cells(self, start: Rational, length: Rational, count: int) -> Iterator[Cell]:
        """Cells of equal length from a time on."""
        n, F = len(self.F), self.F
        unit, zero = exact(np.eye(n)), 0 * F
        whole = entries(exp_times(np.block([[F, unit], [zero, zero]]), length))
        step_matrix, step_integral = ball_matrix(whole[:n, :n]), ball_matrix(whole[:n, n:])
        half = length / 2
        to_middle, flow = exp_times(F, half), ball(F)
        around = exp_around(F, math.nextafter(nearest_float(half), math.inf))
        state = self.at(start)
        for index in range(count):
            if index and index % _PRODUCTS == 0:
                state = self.at(start + index * length)
            middle = to_middle * state
            signed, slopes = entries(step_integral * state), entries(around * (flow * middle))
            tangent = _tangent_cell(abs(entries(middle)), abs(signed), abs(slopes), length)
            yield self._cut(tangent, state, length)
            state = step_matrix * state

    def _cut(self, cell: Cell, state: Balls, length: Rational) -> Cell:
        """The cell, where the flow decays no larger than all that follows from its first state."""
        largest, integral = upper_balls(cell.largest), upper_balls(cell.integral)
        if self.comparison is not None:
            largest = _least(largest, self.comparison.largest(state))
            integral = _least(integral, upper_balls(largest * scalar(length)))
        return Cell(largest, integral)


def _tangent_cell(values: Exact, signed: Exact, slopes: Exact, length: Rational) -> Cell:
    """By moduli in the middle, of integrals, and the largest ones of slopes."""
    half = scalar(length / 2)
    deviation = slopes * half
    bent = values * scalar(length) + deviation * half
    return Cell(values + deviation, np.where(values > deviation, signed, bent))


def _least(first: Exact, other: Exact) -> Exact:
    pairs = zip(first.ravel(), other.ravel(), strict=True)
    return np.array([a.min(b) for a, b in pairs], dtype=object).reshape(first.shape)
