"""When samples of an interval observer are in time, and what is said when they are not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.runtime.base import Sample, Vector
from obsdesign.runtime.interval.state import IntervalState
from obsdesign.runtime.time_stamps import RELATIVE_TIME_TOLERANCE, time_tolerance, time_tolerances


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
        """Time after a sample up to which the next one is certainly in time."""
        return (self.period or 0.0) * (1 + RELATIVE_TIME_TOLERANCE)

    @property
    def earliest(self) -> float:
        """Time after a sample from which the next one is certainly a period later."""
        return (self.period or 0.0) * (1 - RELATIVE_TIME_TOLERANCE)

    def in_time(self, state: IntervalState, t: float) -> bool:
        """A whole number of periods since the last sample on the period, and not late."""
        assert self.period is not None
        apart = t - state.phase
        if not apart > 0:
            return False
        off = abs(apart - max(round(apart / self.period), 1) * self.period)
        return off <= time_tolerance(apart, t) and not self._is_late(state, t)

    def off_period(self, state: IntervalState, t: float) -> bool:
        """Is a sample at t early, so that what is claimed of the width does not count it?"""
        if self.period is None or math.isnan(state.phase):
            return False
        return not self.in_time(state, t) and not self._is_late(state, t)

    def admits_stretch(self, state: IntervalState, t: float) -> bool:
        """May rows begin at t that are done together: an ordinary sample, in time?"""
        h = t - state.t
        if self.period is None:
            step = max(h, t - state.sampled)
            return not step > self.limit + time_tolerance(step, t)
        return abs(h - self.period) <= time_tolerance(h, t) and self.in_time(state, t)

    def regular_steps(self, steps: Vector, times: Vector) -> NDArray[np.bool_]:
        """Which of the steps that end at `times` are one period, or within the step limit."""
        tolerance = time_tolerances(steps, times)
        if self.period is None:
            return np.asarray(steps <= self.limit + tolerance)
        return np.asarray(np.abs(steps - self.period) <= tolerance)

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
        return self._second_jump(state, sample, y)

    def _second_jump(self, state: IntervalState, sample: Sample, y: Vector | None) -> list[str]:
        """Whether two jumps follow one sample, as dwell times of a period allow but for tolerance.

        The widths that are claimed are those of one jump at most between samples.
        """
        guard, since = state.guard, state.phase
        if not sample.jump or guard.last_jump is None or (y is not None and self.when == "before"):
            return []
        between = guard.last_jump > since or (guard.last_jump == since and self.when == "before")
        if not between or guard.shortest < (self.period or 0.0):
            return []
        return [f"second jump since the sample at {since:.9g}: no width is guaranteed"]

    def _continuous(
        self, state: IntervalState, sample: Sample, y: Vector | None, t: float
    ) -> list[str]:
        needed = y is None and not (sample.jump and self.when == "none")
        found = ["missing sample"] if needed else []
        step = t - state.t
        unseen = state.y is None and y is None and not needed and step > 0
        if state.started and unseen and self.corrects:
            found.append("no sample at either end of the step: no width is guaranteed")
        if state.started and step > self.limit + time_tolerance(step, t):
            found.append(f"step {step:.9g} above {self.limit:.9g}: no width is guaranteed")
        return found

    def _is_late(self, state: IntervalState, t: float) -> bool:
        """More than a period since the last sample; two, where a jump took the place of one."""
        assert self.period is not None
        last = state.sampled if math.isnan(state.phase) else state.phase
        apart = t - last
        if apart <= self.period + time_tolerance(apart, t):
            return False
        jump = state.guard.last_jump
        if self.when != "none" or jump is None:
            return True
        waited, since = jump - last, t - jump
        on_sample = abs(waited - self.period) <= time_tolerance(waited, jump)
        return not (on_sample and since <= self.period + time_tolerance(since, t))


def refuting(t: float, objections: list[str]) -> str:
    """Status of every row after one that refutes the bounds; empty where none does."""
    found = [text for text in objections if "outside" in text or "crossed" in text]
    return f"void since time {t:.9g} ({found[0]})" if found else ""
