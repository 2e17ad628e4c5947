"""Point observer in discrete time: a step of the plant, then the correction by the sample.

x+ = A x + B u + (b_lower + b_upper)/2      in every step
x  = x + L (y - C x)                        at a sample
x  = G x + M (y - C x) + E w + middle of c  at an event
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.equations.luenberger.gains import StepGains
from obsdesign.runtime.base import Estimate, Sample, instant, vector
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.clocks.time_grid import StepMaps, steps_to_row
from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.jump import corrected_jump, no_jumps
from obsdesign.runtime.point_observer import SteppedObserver
from obsdesign.runtime.state_marks import Inputs, Past, States
from obsdesign.runtime.status import MISSING_SAMPLE, OFF_PERIOD, late_sample, status_of


@dataclass(frozen=True, slots=True)
class StepState:
    """t, x (n,), u (m,): from t on; sampled: time of the last sample that was used."""

    t: float
    x: States
    u: Inputs
    guard: DwellGuard
    started: bool
    sampled: Past | None = None


@dataclass(frozen=True)
class StepObserver(SteppedObserver[StepState]):
    """Executes a design of kind `luenberger` in discrete time."""

    gains: StepGains
    kind: ClassVar[str] = "luenberger"
    finds_events: ClassVar[bool] = False

    @property
    def guards(self) -> tuple[DwellGuard, ...]:
        """The guard of the design's jumps."""
        return (DwellGuard.from_gains(self.gains),)

    @classmethod
    def from_gains(cls, gains: Entries) -> StepObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(StepGains.from_document(gains))

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> StepState:
        """State at time t from a guess of x(t), before the first sample and its jump."""
        guess = vector(np.zeros(self.n) if x is None else x, self.n, "x")
        guard = DwellGuard.from_gains(self.gains)
        return StepState(instant(t), guess, np.zeros(self.gains.m), guard, started=False)

    def advance(
        self, state: StepState, t: float, y: Matrix | None, sample: Sample
    ) -> tuple[StepState, Estimate]:
        """Step to t, then correct with the sample, or jump if the sample says so."""
        gains, x = self.gains, self._stepped(state, t)
        guard, late = state.guard.after(t, sample.jump, is_step=True)
        objections: list[str] = [late] if late else []
        used = y is not None
        if sample.jump:
            if gains.G is None:
                raise no_jumps()
            x = corrected_jump(gains, x, sample.w, y, gains.M)
            if y is None and gains.jump_measurement != "none":
                objections.append(MISSING_SAMPLE)
        elif gains.period is not None:
            objection, used = self._objection(state, t, y)
            objections += [objection] if objection else []
            if y is not None and used:
                x = x + gains.L @ (y - gains.C @ x)
        u = state.u if sample.u is None else vector(sample.u, len(state.u), "u")
        hides = sample.jump and gains.jump_measurement == "none"
        sampled = t if used or hides else state.sampled
        following = replace(
            state, t=t, x=np.asarray(x), u=u, guard=guard, started=True, sampled=sampled
        )
        return following, Estimate(t, x=following.x, status=status_of(objections, following.x))

    def _objection(
        self, state: StepState, t: float, y: Matrix | None
    ) -> tuple[str | None, bool]:  # fmt: skip
        """What a row between events keeps of the samples' period, and whether its y is used."""
        gains, last = self.gains, state.sampled
        period = gains.period or 0.0
        if last is None:
            return None if y is not None or t == state.t else MISSING_SAMPLE, y is not None
        apart = t - last
        over, slack = apart - period, time_tolerance(apart, t)
        if y is None:
            return MISSING_SAMPLE if over >= -slack else None, False
        if round(apart / gains.step) % gains.period_steps:
            return OFF_PERIOD, False
        if over > slack:
            return late_sample(apart, period), True
        return None, True

    def _stepped(self, state: StepState, t: float) -> Matrix:
        B = self.gains.B
        forced = self.gains.flow_drift + (0.0 if B is None else B @ state.u)
        return self._steps(
            state.x, forced, steps_to_row(state.t, t, self.gains.step, started=state.started)
        )

    @cached_property
    def _steps(self) -> StepMaps:
        return StepMaps(self.gains.A)
