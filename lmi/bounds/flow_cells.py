"""|e^(Fs) E| on cells of s of equal length, by entries, bounded from above in balls.

On a cell on which an entry keeps its sign the integral of its modulus is that of the entry itself,
which is exact; on others it is at most that of the tangent in the middle and its largest deviation.
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


@dataclass(frozen=True)
class Cell:
    """A stretch of s: largest (n, k) >= |e^(Fs) E| on it, integral (n, k) of |e^(Fs) E| over it."""

    start: Rational
    end: Rational
    largest: Exact
    integral: Exact


def cells(F: Exact, first: Balls, time: Rational, length: Rational, count: int) -> Iterator[Cell]:
    """Cells of equal length from a time on, where e^(Fs) E is `first`; at the current precision."""
    n = len(F)
    unit, zero = exact(np.eye(n)), 0 * F
    whole = entries(exp_times(np.block([[F, unit], [zero, zero]]), length))
    onwards, over = ball_matrix(whole[:n, :n]), ball_matrix(whole[:n, n:])
    half = length / 2
    to_middle, flow = exp_times(F, half), ball(F)
    around = exp_around(F, math.nextafter(nearest_float(half), math.inf))
    span, state = scalar(half), first
    for index in range(count):
        middle = to_middle * state
        slopes = abs(entries(around * (flow * middle)))
        values, signed = abs(entries(middle)), abs(entries(over * state))
        deviation = slopes * span
        bent = values * scalar(length) + slopes * (span * span)
        is_fixed = values > deviation
        integral = np.where(is_fixed, signed, bent)
        begin = time + index * length
        yield Cell(begin, begin + length, values + deviation, integral)
        state = onwards * state
