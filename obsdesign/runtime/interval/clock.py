"""Samples in time, late, missing or off the period, with the status messages of those."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.runtime.base import Sample
from obsdesign.runtime.clocks.time_stamps import (
    RELATIVE_TIME_TOLERANCE,
    time_tolerance,
    time_tolerances,
)
from obsdesign.runtime.interval.state import IntervalState
from obsdesign.runtime.status import MISSING_SAMPLE, Reason, late_sample

_NO_WIDTH = ": no width is guaranteed"


@dataclass(frozen=True)
class SampleClock:
    """Sampling times that a design is for.

    period: of periodic samples, else None; limit: the longest step of a continuous y for which a
    width is guaranteed; skips_jumps: no sample is taken at the time of a jump;
    before_jumps: a sample at a jump is taken before it; corrects: does L use the measurements?
    """

    period: float | None
    limit: float
    skips_jumps: bool
    before_jumps: bool
    corrects: bool

    @classmethod
    def from_gains(cls, gains: IntervalGains) -> SampleClock:
        """The clock of a design."""
        limit = math.inf if gains.step_limit is None else gains.step_limit
        return cls(
            period=gains.period,
            limit=limit,
            skips_jumps=gains.jump_measurement == "none",
            before_jumps=gains.jump_measurement == "before",
            corrects=bool(np.any(gains.L)),
        )

    @cached_property
    def latest(self) -> float:
        """Time after a sample up to which the next one is certainly in time."""
        return (self.period or 0.0) * (1 + RELATIVE_TIME_TOLERANCE)

    @cached_property
    def earliest(self) -> float:
        """Time after a sample from which the next one is certainly a period later."""
        return (self.period or 0.0) * (1 - RELATIVE_TIME_TOLERANCE)

    @cached_property
    def longest(self) -> float:
        """Step of a continuous y up to which a width is certainly guaranteed."""
        return self.limit * (1 + RELATIVE_TIME_TOLERANCE)

    def is_in_time(self, state: IntervalState, t: float) -> bool:
        """Is t whole periods after the last sample on the period, and not late?"""
        assert self.period is not None
        apart = t - state.phase
        if not apart > 0:
            return False
        off = abs(apart - max(round(apart / self.period), 1) * self.period)
        return off <= time_tolerance(apart, t) and not self._is_late(state, t)

    def is_off_period(self, state: IntervalState, t: float) -> bool:
        """Is a sample at t early, so that claims about the width do not count it?"""
        if self.period is None or math.isnan(state.phase):
            return False
        return not self.is_in_time(state, t) and not self._is_late(state, t)

    def is_regular(self, state: IntervalState) -> bool:
        """Did the last row bring a sample in time, and nothing that later rows depend on?"""
        on_period = self.period is None or state.phase == state.t
        return state.is_ordinary and state.y is not None and on_period

    def regular_steps(self, steps: Matrix, times: Matrix) -> NDArray[np.bool_]:
        """Which of the steps that end at `times` are one period, or within the step limit."""
        tolerance = time_tolerances(steps, times)
        if self.period is None:
            return np.asarray(steps <= self.limit + tolerance)
        return np.asarray(np.abs(steps - self.period) <= tolerance)

    def objections(
        self, state: IntervalState, sample: Sample, y: Matrix | None, t: float
    ) -> list[Reason]:
        """Sentences on what the time of a sample, or its absence, takes from the guarantee."""
        if self.period is None:
            return self._continuous(state, sample, y, t)
        if y is None and not sample.jump:
            return [MISSING_SAMPLE]
        if state.started and self._is_late(state, t):
            if state.sampled != state.phase == state.phase:  # others came, off the period
                kind = f"no sample {self.period:.9g} after the one"
                return [
                    Reason(f"{kind} at {state.phase:.9g}{_NO_WIDTH}", f"{kind} before{_NO_WIDTH}")
                ]
            return [late_sample(t - state.sampled, self.period)]
        return self._second_jump(state, sample, y)

    def _second_jump(self, state: IntervalState, sample: Sample, y: Matrix | None) -> list[Reason]:
        """Whether two jumps follow one sample, as dwell times of a period allow but for tolerance.

        The widths that are claimed are those of one jump at most between samples.
        """
        guard, since = state.guard, state.phase
        if not sample.jump or guard.last_jump is None or (y is not None and self.before_jumps):
            return []
        between = guard.last_jump > since or (guard.last_jump == since and self.before_jumps)
        if not between or guard.shortest < (self.period or 0.0):
            return []
        kind = "second jump since the sample"
        return [Reason(f"{kind} at {since:.9g}{_NO_WIDTH}", f"{kind} before{_NO_WIDTH}")]

    def _continuous(
        self, state: IntervalState, sample: Sample, y: Matrix | None, t: float
    ) -> list[Reason]:
        # between jumps y counts where L uses it, or a width rests on samples within the limit
        counts = not self.skips_jumps if sample.jump else self.corrects or math.isfinite(self.limit)
        needed = y is None and counts
        sentences = [MISSING_SAMPLE] if needed else []
        step = t - state.t
        without_sample = state.y is None and y is None and not needed and step > 0
        if state.started and without_sample and self.corrects:
            sentences.append(Reason(f"no sample at either end of the step{_NO_WIDTH}"))
        if state.started and step > self.limit + time_tolerance(step, t):
            sentences.append(Reason.measured("step", step, f"above {self.limit:.9g}{_NO_WIDTH}"))
        return sentences

    def _is_late(self, state: IntervalState, t: float) -> bool:
        """Is the last sample more than a period ago (two, where a jump replaced one)?"""
        assert self.period is not None
        last = state.sampled if math.isnan(state.phase) else state.phase
        apart = t - last
        if apart <= self.period + time_tolerance(apart, t):
            return False
        jump = state.guard.last_jump
        if not self.skips_jumps or jump is None:
            return True
        waited, since = jump - last, t - jump
        on_sample = abs(waited - self.period) <= time_tolerance(waited, jump)
        return not (on_sample and since <= self.period + time_tolerance(since, t))
