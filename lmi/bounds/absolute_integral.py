"""Integrals of |e^(Fs) E|, by entries, bounded from above in balls.

On a cell on which an entry keeps its sign the integral of its modulus is that of the entry itself,
which is exact; on others it is at most that of the tangent in the middle and its largest deviation.
Cells double in length as fast modes decay. What is left after the last one is bounded by Cauchy and
Schwarz, with P of `lmi.bounds.peak_gain`: it is small, or the bound is as good as that one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

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
    precision,
    rational,
    scalar,
    to_float,
)
from lmi.arithmetic.norms import float_above
from lmi.bounds.peak_gain import decaying_integrals
from lmi.prove.hurwitz import rightmost

_BITS = 160
# the first cells span this much of 1 / ||F||; each stage has cells of twice that length
_REACH, _CELLS, _STAGES = 2.0**-5, 64, 8
# what may remain behind the last cell, relative to the integral before it
_REMAINDER = 1e-4


@dataclass(frozen=True)
class Cell:
    """A stretch of s: largest (n, k) >= |e^(Fs) E| on it, integral (n, k) of |e^(Fs) E| over it."""

    start: Rational
    end: Rational
    largest: Exact
    integral: Exact


def absolute_integrals(F: Exact, E: Exact) -> Matrix | None:
    """Upper bounds of the integrals of |e^(Fs) E| over s >= 0, (n, k) floats.

    F (n, n) Hurwitz, E (n, k), exact. None where decay is not proved.
    """
    if not E.size:
        return np.zeros(E.shape)
    scaling = Scaling.from_pair(F, 0 * F, math.inf)
    own = _integrals(scaling.map(F), scaling.rows(E))
    return None if own is None else np.asarray(own * scaling.sizes[:, None])


def _integrals(F: Exact, E: Exact) -> Matrix | None:
    decay = -rightmost(to_float(F)).real
    if not decay > 0:
        return None
    # half the decay rate: then the bound is exact for a mode that does not oscillate
    rate = float(np.float32(0.5 * decay))
    with precision(_BITS):
        remainder = decaying_integrals(F, exact(np.eye(len(F))), rate)
        if remainder is None:
            return None
        start, total = ball(E), entries(ball(0 * E))
        best = _above(remainder(start))
        size = float(np.abs(to_float(F)).sum(axis=1).max())
        length, time = rational(_REACH / size), rational(0.0)
        for _ in range(_STAGES):
            for cell in cells(F, start, time, length, _CELLS):
                total = total + cell.integral
            time = time + _CELLS * length
            start = exp_times(F, time) * ball(E)
            left = remainder(start)
            best = np.fmin(best, _above(total + left))
            if (_above(left) <= _REMAINDER * best).all():
                break
            length = 2 * length
    return best if np.isfinite(best).all() else None


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


def _above(values: Exact) -> Matrix:
    """Floats above the entries of balls."""
    result = [float_above(value.abs_upper()) for value in values.ravel()]
    return np.array(result).reshape(values.shape)
