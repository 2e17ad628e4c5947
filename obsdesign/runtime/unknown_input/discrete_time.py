"""Unknown-input observer in discrete time: x_hat and d_hat of the step that ends at a row."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.column_names import numbered
from obsdesign.equations.unknown_input.steps import StepInputGains
from obsdesign.runtime.base import Estimate, Sample, instant, vector
from obsdesign.runtime.clocks.time_grid import StepMaps, steps_to_row
from obsdesign.runtime.jump import no_jumps
from obsdesign.runtime.point_observer import SteppedObserver
from obsdesign.runtime.state_marks import Inputs, States
from obsdesign.runtime.status import MISSING_SAMPLE, status_of


@dataclass(frozen=True, slots=True)
class StepInputState:
    """x (n,) at t; u (m,): from t on."""

    t: float
    x: States
    u: Inputs
    started: bool


@dataclass(frozen=True)
class StepInputObserver(SteppedObserver[StepInputState]):
    """Executes a design of kind `unknown_input` in discrete time."""

    gains: StepInputGains
    kind: ClassVar[str] = "unknown_input"
    finds_events: ClassVar[bool] = False

    @classmethod
    def from_gains(cls, gains: Entries) -> StepInputObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(StepInputGains.from_document(gains))

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t."""
        return super().names + numbered("d", self.gains.D.shape[1])

    @cached_property
    def _steps(self) -> StepMaps:
        return StepMaps(self.gains.A)

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> StepInputState:
        """State at time t from a guess of x(t), before the first sample."""
        guess = vector(np.zeros(self.n) if x is None else x, self.n, "x")
        return StepInputState(instant(t), guess, np.zeros(self.gains.m), started=False)

    def advance(
        self, state: StepInputState, t: float, y: Matrix | None, sample: Sample
    ) -> tuple[StepInputState, Estimate]:
        """Step to t, then correct state and input with the sample.

        d is NaN where it is not known: in the first row, without a sample, and after steps that
        were left out.
        """
        if sample.jump:
            raise no_jumps()
        gains = self.gains
        count, reasons = steps_to_row(state.t, t, gains.step, started=state.started), list[str]()
        forced = gains.flow_drift + (0.0 if gains.B is None else gains.B @ state.u)
        x = self._steps(state.x, forced, count)
        d = np.full(gains.D.shape[1], np.nan)
        if y is None or count > 1:
            reasons.append(MISSING_SAMPLE)
        if y is not None and count:
            residual = y - gains.C @ x
            x = x + gains.M @ residual
            d = gains.N @ residual if count == 1 else d
        u = state.u if sample.u is None else vector(sample.u, len(state.u), "u")
        following = replace(state, t=t, x=np.asarray(x), u=u, started=True)
        return following, Estimate(t, x=following.x, d=d, status=status_of(reasons, following.x))
