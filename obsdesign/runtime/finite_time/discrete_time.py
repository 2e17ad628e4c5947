"""Finite-time observer in discrete time: the state from the samples of one window.

Row t is about x(t), with the sample at t. Between samples and where a window is not complete the
plant predicts. A sample that is missing, or a jump, begins the window anew; a sample off the period
is not used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.equations.finite_time.steps import StepWindowGains
from obsdesign.runtime.base import Estimate, Sample, instant, vector
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.clocks.time_grid import StepMaps, steps_between, steps_to_row
from obsdesign.runtime.jump import corrected_jump, no_jumps
from obsdesign.runtime.point_observer import SteppedObserver
from obsdesign.runtime.state_marks import Axes, Inputs, Past, States
from obsdesign.runtime.status import MISSING_SAMPLE, OFF_PERIOD, status_of


@dataclass(frozen=True, slots=True)
class StepWindowState:
    """x (n,): the last estimate, moved to t; u (m,): from t on.

    y (s, p), forced (s, n): the samples of the window, and what known inputs added to the state
    since the sample before each; since (n,): the same since the last of them; steps: since then.
    sampled: time of the last sample of the grid; full: is x the estimate of a full window?
    """

    t: float
    x: States
    u: Inputs
    y: Annotated[Matrix, Axes("s p")]
    forced: Annotated[Matrix, Axes("s n")]
    since: States
    guard: DwellGuard
    started: bool
    full: bool = False
    sampled: Past | None = None


@dataclass(frozen=True)
class StepWindowObserver(SteppedObserver[StepWindowState]):
    """Executes a design of kind `finite_time` in discrete time."""

    gains: StepWindowGains
    kind: ClassVar[str] = "finite_time"
    finds_events: ClassVar[bool] = False

    @property
    def guards(self) -> tuple[DwellGuard, ...]:
        """The guard of the design's jumps."""
        return (DwellGuard.from_gains(self.gains),)

    @classmethod
    def from_gains(cls, gains: Entries) -> StepWindowObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(StepWindowGains.from_document(gains))

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> StepWindowState:
        """State at time t; x is a guess that is shown until the window is full, default zeros."""
        guess = vector(np.zeros(self.n) if x is None else x, self.n, "x")
        guard = DwellGuard.from_gains(self.gains)
        nothing = np.zeros(self.n)
        return StepWindowState(
            instant(t), guess, np.zeros(self.gains.m), *self._empty, nothing, guard, started=False
        )

    def advance(
        self, state: StepWindowState, t: float, y: Matrix | None, sample: Sample
    ) -> tuple[StepWindowState, Estimate]:
        """Step to t, take the sample in, and jump if the row says so."""
        when = self.gains.jump_measurement
        guard, late = state.guard.after(t, sample.jump, is_step=True)
        reasons: list[str] = [late] if late else []
        hidden = sample.jump and when == "none"
        state, reason = self._moved(state, t, None if hidden else y, hidden=hidden)
        reasons += [reason] if reason else []
        taken_after = sample.jump and when == "after"
        if state.sampled == t and y is not None and not hidden and not taken_after:
            state = self._taken(state, y)
        if sample.jump:
            if self.gains.G is None:
                raise no_jumps()
            x = corrected_jump(self.gains, state.x, sample.w)
            ys, forced = self._empty
            state = replace(
                state, x=x, y=ys, forced=forced, since=np.zeros(self.n), full=False
            )  # fmt: skip
            if taken_after and y is not None and state.sampled == t:
                state = self._taken(state, y)
        u = state.u if sample.u is None else vector(sample.u, len(state.u), "u")
        state = replace(state, u=u, guard=guard, started=True)
        if not state.full and not reason:
            reasons.append("window not full")
        return state, Estimate(t, x=state.x, status=status_of(reasons, state.x))

    @property
    def _empty(self) -> tuple[Matrix, Matrix]:
        return np.zeros((0, self.gains.p)), np.zeros((0, self.n))

    @cached_property
    def _steps(self) -> StepMaps:
        return StepMaps(self.gains.A)

    def _moved(
        self, state: StepWindowState, t: float, y: Matrix | None, *, hidden: bool
    ) -> tuple[StepWindowState, str | None]:
        """The state at t, and what its sample does not keep of the period."""
        gains = self.gains
        count = steps_to_row(state.t, t, gains.step, started=state.started)
        forced = gains.flow_drift + (0.0 if gains.B is None else gains.B @ state.u)
        x, since = (self._steps(each, forced, count) for each in (state.x, state.since))
        state = replace(state, t=t, x=x, since=since)
        if state.sampled is None:
            return replace(state, sampled=None if y is None else t), None
        apart = steps_between(state.sampled, t, gains.step)
        if apart < gains.period_steps:
            is_off = y is not None and apart > 0
            return state, OFF_PERIOD if is_off else None
        on_grid = apart % gains.period_steps == 0
        missed = apart > gains.period_steps or (on_grid and y is None)
        if missed:
            ys, added = self._empty
            state = replace(state, y=ys, forced=added, since=np.zeros(self.n), full=False)
        if on_grid:
            state = replace(state, sampled=t)
        elif y is not None:
            return state, OFF_PERIOD
        return state, MISSING_SAMPLE if missed and not hidden else None

    def _taken(self, state: StepWindowState, y: Matrix) -> StepWindowState:
        """The state with a sample in its window, and the estimate where the window is full."""
        k, zero = self.gains.samples, np.zeros(self.n)
        ys = np.vstack([state.y, y])[-k:]
        forced = np.vstack([state.forced, state.since])[-k:]
        state = replace(state, y=ys, forced=forced, since=zero, full=len(ys) == k)
        if not state.full:
            return state
        A, phi, total = np.linalg.matrix_power(self.gains.A, self.gains.period_steps), zero, zero
        for i, own in enumerate(self.gains.of_samples):
            phi = A @ phi + forced[i] if i else zero
            total = total + own @ (ys[i] - self.gains.C @ phi)
        return replace(state, x=np.asarray(phi + total))
