"""Point observer with jumps at run time: exact steps, linear interpolation between samples.

    xhat' = F xhat + L y(t) + B u + b_mid,   F = A - L C        between jumps
    xhat+ = G xhat- + M (y- - C xhat-) + E w + c_mid            at jumps

M may depend on the dwell time that ends at the jump (a schedule). Between two samples y is
interpolated linearly; a measurement taken before a jump says nothing about the time after it, and
then the next sample stands alone. Without any, the plant alone predicts.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.runtime.base import Estimate, Sample, instant, vector
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.flow_response import Maps, responses
from obsdesign.runtime.jump import corrected_jump, no_jumps
from obsdesign.runtime.point_observer import SteppedObserver
from obsdesign.runtime.state_marks import Inputs, Outputs, States
from obsdesign.runtime.status import MISSING_SAMPLE, status_of
from obsdesign.runtime.step_cache import cached_step


@dataclass(frozen=True, slots=True)
class LuenbergerState:
    """Everything the next step needs: the estimate x just after time t."""

    t: float
    x: States
    u: Inputs
    y: Outputs | None
    guard: DwellGuard
    started: bool


@dataclass(frozen=True)
class LuenbergerObserver(SteppedObserver[LuenbergerState]):
    """Executes a design of kind `luenberger`."""

    gains: LuenbergerGains
    kind: ClassVar[str] = "luenberger"
    finds_events: ClassVar[bool] = False
    _steps: OrderedDict[float, dict[bool, Maps]] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    @property
    def guards(self) -> tuple[DwellGuard, ...]:
        """The guard of the design's jumps."""
        return (DwellGuard.from_gains(self.gains),)

    @classmethod
    def from_gains(cls, gains: Entries) -> LuenbergerObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(LuenbergerGains.from_document(gains))

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> LuenbergerState:
        """State at time t from a guess of x(t), before the first sample and its jump."""
        guess = vector(np.zeros(self.n) if x is None else x, self.n, "x")
        guard = DwellGuard.from_gains(self.gains)
        inputs = np.zeros(self.gains.m)
        return LuenbergerState(instant(t), guess, inputs, None, guard, started=False)

    def advance(
        self, state: LuenbergerState, t: float, y: Matrix | None, sample: Sample
    ) -> tuple[LuenbergerState, Estimate]:
        """Flow to t with the measurements at both ends, then jump if the sample says so."""
        when = self.gains.jump_measurement
        x = self._flow(state, t, y if not sample.jump or when == "before" else None)
        guard, late = state.guard.after(t, sample.jump)
        objections = [late] if late else []
        # without L, samples between jumps are of no use and none is missed
        is_expected = when != "none" if sample.jump else np.any(self.gains.L)
        if y is None and is_expected:
            objections.append(MISSING_SAMPLE)
        usable = y
        if sample.jump:
            if self.gains.G is None:
                raise no_jumps()
            M = self._jump_gain(state.guard.last_jump, t)
            x = corrected_jump(self.gains, x, sample.w, y, M)
            usable = y if when == "after" else None
        u = state.u if sample.u is None else vector(sample.u, len(state.u), "u")
        following = replace(state, t=t, x=x, u=u, y=usable, guard=guard, started=True)
        return following, Estimate(t, x=x, status=status_of(objections, x))

    def _flow(self, state: LuenbergerState, t: float, y_end: Matrix | None) -> Matrix:
        if t == state.t:
            return state.x
        start = state.y if state.y is not None else y_end
        end = y_end if y_end is not None else start
        maps = cached_step(self._steps, t - state.t, self._maps)
        flow, once, ramp = maps[start is not None]
        forced = self.gains.flow_drift + (0.0 if self.gains.B is None else self.gains.B @ state.u)
        if start is None or end is None:
            return np.asarray(flow @ state.x + once @ forced)
        L = self.gains.L
        return np.asarray(flow @ state.x + once @ (L @ start + forced) + ramp @ (L @ (end - start)))

    def _maps(self, h: float) -> dict[bool, Maps]:
        """(e^{Xh}, its integral, the response to a unit ramp over the step), X = A or A - L C."""
        A, L, C = self.gains.A, self.gains.L, self.gains.C
        return {False: responses(A, h), True: responses(flow_error_matrix(A, L, C), h)}

    def _jump_gain(self, last_jump: float | None, t: float) -> Matrix:
        """M, or where gains follow a schedule, the one for the dwell time that ends at t."""
        gains = self.gains
        if last_jump is None or gains.M_cells is None or gains.dwell_borders is None:
            return gains.M
        cell = np.searchsorted(gains.dwell_borders, t - last_jump, side="right")
        return np.asarray(gains.M_cells[cell])
