"""Sampling instants of a finite-time observer: regular, missed and irregular times."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from obsdesign.runtime.clocks.time_stamps import RELATIVE_TIME_TOLERANCE, time_tolerance
from obsdesign.runtime.finite_time.constants import WindowConstants
from obsdesign.runtime.finite_time.flow_maps import flow_maps
from obsdesign.runtime.finite_time.state import FiniteTimeState
from obsdesign.runtime.finite_time.window import emptied, flowed, sampled
from obsdesign.runtime.status import Reason


@dataclass(frozen=True)
class _Timing:
    """A time t against the instants so far.

    count: whole periods since the last instant; regular: t is an instant; drifted: it would be one
    but for small deviations of the same sign, which add up since the anchor.
    slack: how far the last instant, and t where it is one, are off their stamps beyond rounding.
    """

    elapsed: float
    count: int
    regular: bool
    drifted: bool
    slack: float

    @classmethod
    def from_times(cls, state: FiniteTimeState, t: float, period: float) -> _Timing:
        elapsed = t - (state.last_instant or 0.0)
        count = round(elapsed / period)
        # stamps whose spacing exceeds a period cannot identify a sample
        is_resolved = count >= 1 and math.ulp(t) <= period
        is_near = is_resolved and abs(elapsed - count * period) <= time_tolerance(elapsed, t)
        periods = state.periods_since_anchor
        since_anchor = (periods + count) * period
        deviation = abs(t - state.anchor_time - since_anchor)
        is_near_anchor = deviation <= time_tolerance(since_anchor, t)
        regular = is_near and is_near_anchor
        slack = 0.0
        if state.last_instant is not None:
            off = abs(state.last_instant - state.anchor_time - periods * period)
            slack += _beyond_rounding(off, state.last_instant)
        slack += _beyond_rounding(deviation, t) if regular else 0.0
        return cls(elapsed, count, regular, is_near and not is_near_anchor, slack)

    def missed(self, period: float) -> int:
        """Instants before t at which no sample arrived."""
        if self.regular or self.drifted:
            return self.count - 1
        return math.floor(self.elapsed / period)


def _beyond_rounding(deviation: float, t: float) -> float:
    """The deviation of an instant from its stamp t; zero where it rounds to that stamp."""
    return deviation if deviation > 0.5001 * math.ulp(t) else 0.0


def moved_to(
    constants: WindowConstants, state: FiniteTimeState, t: float, has_sample: bool
) -> tuple[FiniteTimeState, bool, Reason | None]:
    """The state at t; whether t is a sampling instant; the status of an irregular sample."""
    period, last = constants.period, state.last_instant
    if last is None:
        state = flowed(constants, state, t, 0.0)
        return anchored(state, t) if has_sample else state, has_sample, None
    timing = _Timing.from_times(state, t, period)
    missed = timing.missed(period)
    periods = state.periods_since_anchor + timing.count
    has_gap = missed > constants.k
    if has_gap:
        state = flowed(constants, state, t, 0.0, timing.slack)
        state, missed = anchored(emptied(constants, state), t), 0
    for i in range(missed):
        instant = last + (i + 1) * period
        state = sampled(constants, flowed(constants, state, instant, 0.0, timing.slack), None)
    remaining = 0.0 if timing.regular else (timing.missed(period) + 1) * period - timing.elapsed
    state = flowed(constants, state, t, remaining, timing.slack)
    if timing.regular:
        # the stamp of a row without a sample is only near to the instant
        if has_gap or (has_sample and periods >= constants.most_periods_counted):
            return anchored(state, t), True, None
        return state._replace(last_instant=t, periods_since_anchor=periods), True, None
    if missed:
        counted = state.periods_since_anchor + missed
        state = state._replace(last_instant=last + missed * period, periods_since_anchor=counted)
    if not has_sample:
        return state, False, None
    since = t - state.anchor_time if timing.drifted else timing.elapsed
    return (
        state,
        False,
        Reason.measured("sampling time", since, f"is not a multiple of {period:.9g}"),
    )


def anchored(state: FiniteTimeState, t: float) -> FiniteTimeState:
    """The state with an instant at t from which the coming ones are counted."""
    return state._replace(last_instant=t, anchor_time=t, periods_since_anchor=0)


def at_stamp(constants: WindowConstants, state: FiniteTimeState) -> FiniteTimeState:
    """The state at an instant, with bounds for the stamp of a row that is only near to it."""
    if not (constants.has_bounds and np.isfinite(state.bounds.radius).all()):
        return state
    since = state.periods_since_anchor * constants.period
    off = abs(state.t - state.anchor_time - since) + math.ulp(state.t)
    maps = flow_maps(constants.gains, 0.0, off)
    bounds = state.bounds
    error = maps.error(bounds.centre, state.held.size)
    return state._replace(bounds=bounds._replace(radius=maps.spread(bounds.radius) + error))


def is_next_instant(state: FiniteTimeState, t: float, period: float, periods: int) -> bool:
    """Is t the instant after the last one, by the tolerances of `time_tolerance`?

    periods: from the anchor to t.
    """
    slack = math.ulp(t)
    return (
        state.last_instant == state.t
        and slack <= period
        and abs(t - state.t - period) <= RELATIVE_TIME_TOLERANCE * period + slack
        and abs(t - state.anchor_time - periods * period)
        <= RELATIVE_TIME_TOLERANCE * periods * period + slack
    )
