"""When samples of an interval observer are in time, and what is said when they are not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from obsdesign.runtime.base import RELATIVE_TIME_TOLERANCE, Sample, Vector
from obsdesign.runtime.interval_state import IntervalState


@dataclass(frozen=True)
class SampleClock:
    """What a design says of the times of its samples.

    period: of periodic samples, else None; limit: the longest step of a continuous y for which a
    width is guaranteed; when: jump_measurement; corrects: does L use the measurements?
    """

    period: float | None
    limit: float
    when: str
    corrects: bool

    @classmethod
    def of(cls, gains: Mapping[str, Any]) -> SampleClock:
        """The clock of a design's gains."""
        period = float(gains["period"]) if "period" in gains else None
        limit = float(gains.get("step_limit", math.inf))
        return cls(period, limit, str(gains["jump_measurement"]), bool(np.any(gains["L"])))

    @property
    def latest(self) -> float:
        """How long after a sample the next one is in time; the longest step of a continuous y."""
        return (self.period or self.limit) * (1 + RELATIVE_TIME_TOLERANCE)

    @property
    def earliest(self) -> float:
        """How soon after a sample the next one is a period later."""
        return (self.period or 0.0) * (1 - RELATIVE_TIME_TOLERANCE)

    def in_time(self, state: IntervalState, t: float) -> bool:
        """A whole number of periods since the last sample on the period, and not late."""
        assert self.period is not None
        apart = t - state.phase
        if not apart > 0:
            return False
        off = abs(apart - max(round(apart / self.period), 1) * self.period)
        near = off <= self.latest - self.period + 4 * math.ulp(t)
        return near and not self._is_late(state, t)

    def off_period(self, state: IntervalState, t: float) -> bool:
        """Is a sample at t early, so that what is claimed of the width does not count it?"""
        if self.period is None or math.isnan(state.phase):
            return False
        return not self.in_time(state, t) and not self._is_late(state, t)

    def admits_stretch(self, state: IntervalState, t: float) -> bool:
        """May rows begin at t that are done together: an ordinary sample, in time?"""
        h, slack = t - state.t, 4 * math.ulp(t)
        if self.period is None:
            return not max(h, t - state.sampled) > self.latest + slack
        near = self.earliest - slack <= h <= self.latest + slack
        return near and self.in_time(state, t)

    def objections(
        self, state: IntervalState, sample: Sample, y: Vector | None, t: float
    ) -> list[str]:
        """What the time of a sample, or its absence, takes from the guarantee."""
        if self.period is None:
            return self._continuous(state, sample, y, t)
        if y is None and not sample.jump:
            return ["missing sample"]
        if state.started and self._is_late(state, t):
            if state.sampled != state.phase == state.phase:  # others came, off the period
                after = f"{self.period:.9g} after the one at {state.phase:.9g}"
                return [f"no sample {after}: no width is guaranteed"]
            apart = t - state.sampled
            return [f"time {apart:.9g} since the last sample, above {self.period:.9g}"]
        return []

    def _continuous(
        self, state: IntervalState, sample: Sample, y: Vector | None, t: float
    ) -> list[str]:
        needed = y is None and not (sample.jump and self.when == "none")
        found = ["missing sample"] if needed else []
        step = t - state.t
        unseen = state.y is None and y is None and not needed and step > 0
        if state.started and unseen and self.corrects:
            found.append("no sample at either end of the step: no width is guaranteed")
        if state.started and step > self.latest + 4 * math.ulp(t):
            found.append(f"step {step:.9g} above {self.limit:.9g}: no width is guaranteed")
        return found

    def _is_late(self, state: IntervalState, t: float) -> bool:
        """More than a period since the last sample; two, where a jump took the place of one."""
        assert self.period is not None
        slack = 4 * math.ulp(t)  # what a difference of two time stamps is off by
        last = state.sampled if math.isnan(state.phase) else state.phase
        apart = t - last
        if apart <= self.latest + slack:
            return False
        jump = state.guard.last_jump
        if self.when != "none" or jump is None:
            return True
        waited = jump - last
        on_sample = abs(waited - self.period) <= self.latest - self.period + slack
        return not (on_sample and t - jump <= self.latest + slack)
