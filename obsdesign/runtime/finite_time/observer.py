"""Finite-time observer at run time: the state from the samples of one window.

    xhat(t_i) = w(t_i) + sum_j G_j (y_{i-k+j} - C w(t_{i-k+j})),     w' = A w + B u + b_mid

w is any response of the plant to the known input: x - w has no input, and the term of known inputs
collapses into one running response, also when they change between samples. Once per window w is
shifted onto the estimate, so that it neither drifts nor grows. Method `approximate` follows (14) to
the letter instead (`known_inputs`), as its bias depends on the inputs.

Between samples, and where a window is not complete, the plant predicts. Row t is about x(t); the
sample at t itself enters the next window, as in the paper.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.column_names import pairs
from obsdesign.equations.finite_time.gains import FiniteTimeGains
from obsdesign.runtime.base import MODERATE, Estimate, Sample, instant, later, vector
from obsdesign.runtime.finite_time.clock import anchored, at_stamp, moved_to
from obsdesign.runtime.finite_time.constants import WindowConstants
from obsdesign.runtime.finite_time.state import FiniteTimeState
from obsdesign.runtime.finite_time.steady import outward_ends, steady_step
from obsdesign.runtime.finite_time.window import (
    emptied,
    held_input,
    initial_state,
    jumped,
    pushed,
    sampled,
)
from obsdesign.runtime.point_observer import SteppedObserver
from obsdesign.runtime.status import MISSING_SAMPLE, status_of


@dataclass(frozen=True)
class FiniteTimeObserver(SteppedObserver[FiniteTimeState]):
    """Executes a design of kind `finite_time`."""

    gains: FiniteTimeGains
    kind: ClassVar[str] = "finite_time"
    finds_events: ClassVar[bool] = False

    @classmethod
    def from_gains(cls, gains: Entries) -> FiniteTimeObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(FiniteTimeGains.from_document(gains))

    @cached_property
    def constants(self) -> WindowConstants:
        """Matrices that follow from the gains."""
        return WindowConstants(self.gains)

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of axes: as for points, of the window, and d of the contributions of an input."""
        k, n = self.constants.k, self.n
        driven = self.constants.driven(np.zeros(self.gains.m)).size
        return super().sizes | {"kp": k * self.constants.p, "2nk": 2 * n * k, "d": driven}

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t: x1, ..., and x1_lo, x1_hi, ... where it has bounds."""
        points = super().names
        return points + (pairs(points) if self.constants.has_bounds else ())

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> FiniteTimeState:
        """State at time t; x is a guess that is shown until the window is full, default zeros."""
        guess = vector(np.zeros(self.n) if x is None else x, self.n, "x")
        inputs = np.zeros(self.gains.m)
        return initial_state(self.constants, instant(t), guess, inputs)

    def step(self, state: FiniteTimeState, sample: Sample) -> tuple[FiniteTimeState, Estimate]:
        """Move to the time of the sample, estimate, take the sample in, and jump if it says so.

        ValueError if time does not increase (the first sample may share the initial time).
        """
        if state.filling.full and not sample.jump:
            t = later(sample, state.t, state.started)
            steady = steady_step(self.constants, state, t, sample)
            if steady is not None:
                return steady
        return super().step(state, sample)

    def advance(
        self, state: FiniteTimeState, t: float, y: Matrix | None, sample: Sample
    ) -> tuple[FiniteTimeState, Estimate]:
        """Move to t, take y in before or after a jump, and estimate."""
        constants, when = self.constants, self.gains.jump_measurement
        is_taken_after = sample.jump and when != "before"
        y_before, y_after = (None, y) if is_taken_after else (y, None)
        state, is_instant, irregular = moved_to(constants, state, t, y is not None)
        if is_instant:
            state = sampled(constants, state, y_before)
            if y is None:  # a row at its own time, which is only near to the instant
                state = at_stamp(constants, state)
        if irregular:
            state = pushed(constants, anchored(emptied(constants, state), t), y_before)
        if sample.jump:
            state = jumped(constants, state, sample.w)
            if y_after is not None and when == "after":
                state = pushed(constants, anchored(state, t), y_after)
        if sample.u is not None:
            u = vector(sample.u, len(state.held.u), "u")
            state = state._replace(held=held_input(constants, u))
        moderate = constants.has_moderate_gains and _is_moderate(state.x, state.w, state.window)
        state = state._replace(
            filling=state.filling._replace(moderate=moderate),
            bounds=state.bounds._replace(cached_radius=None),
            started=True,
        )
        return state, self._estimate(state, irregular)

    def _estimate(self, state: FiniteTimeState, irregular: str | None) -> Estimate:
        reasons = [irregular] if irregular else []
        full = state.filling.full
        if not full:
            reasons.append("window not full" if full is None else MISSING_SAMPLE)
        if not self.constants.has_bounds:
            return Estimate(state.t, x=state.x, status=status_of(reasons, state.x))
        low, high = outward_ends(state.bounds.centre, state.bounds.radius)
        is_bounded = full and self.constants.has_finite_radius
        checked = (state.x, low, high) if is_bounded else (state.x,)
        return Estimate(state.t, state.x, low, high, status=status_of(reasons, *checked))


def _is_moderate(*values: Matrix) -> bool:
    return bool(np.abs(np.concatenate(values)).max() < MODERATE)
