"""Passages of graphs of clocks, whose times are rationals: rounded outward to floats."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from lmi.bounds.graph_tube import Passage, Strategy
from obsdesign.analysis.interval.marks import NO_TIME, Range

# a range of a single time, rounded outward, is made as long as that, for a proof to divide it
_LEAST_SHARE = 2.0**-30


def passage(source: int, event: int | None, time: Range = NO_TIME) -> Passage:
    """From a node through an event, after a time in a range."""
    low, high = _down(time[0]), _up(time[1])
    if low < high and high * (1 - _LEAST_SHARE) < low:
        low = high * (1 - _LEAST_SHARE)
    return Passage(source, event, low, high)


def held(
    n: int, passages: Strategy, through: tuple[int, ...], touched: tuple[bool, ...]
) -> list[Strategy]:
    """A strategy where all states flow, and for each state one where the others are held.

    touched: states that it bounds: of the others it says what holds already; through: as in
    `Passage`.
    """
    silent = None if all(touched) else tuple(not is_bounded for is_bounded in touched)
    strategies = [tuple(_restricted(each, None, (), silent) for each in passages)]
    for i in np.flatnonzero(touched) if n > 1 else ():
        others = tuple(j != i for j in range(n))
        strategies.append(tuple(_restricted(each, others, through, None) for each in passages))
    return strategies


def _restricted(
    own: Passage,
    is_held: tuple[bool, ...] | None,
    through: tuple[int, ...],
    silent: tuple[bool, ...] | None,
) -> Passage:
    return Passage(own.source, own.event, own.low, own.high, is_held, through, silent)


def _down(value: Fraction) -> float:
    """The largest float at most as large."""
    near = float(value)
    return math.nextafter(near, -math.inf) if Fraction(near) > value else near


def _up(value: Fraction | None) -> float:
    """The least float at least as large; infinite for None."""
    if value is None:
        return math.inf
    near = float(value)
    return math.nextafter(near, math.inf) if Fraction(near) < value else near
