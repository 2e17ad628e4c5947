"""Finite-time observer at run time: the state from the samples of one window.

    xhat(t_i) = w(t_i) + sum_j G_j (y_{i-k+j} - C w(t_{i-k+j})),     w' = A w + B u + b_mid

w is any response of the plant to what is known: what it leaves of x has no input, and the term of
known inputs collapses into one running response, also when they change between samples. From time
to time w is moved onto the estimate, so that it neither drifts nor grows. Method `approximate`
follows (14) to the letter instead (`approximate_inputs`), as its bias depends on the inputs.

Between samples, and where a window is not complete, the plant predicts. Row t is about x(t); the
sample at t itself enters the next window, as in the paper.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.equations.finite_time import gains as equations
from obsdesign.runtime.base import (
    MODERATE,
    Estimate,
    Sample,
    centred_measurement,
    later,
    status_of,
    vector,
)
from obsdesign.runtime.finite_time.folding_steady_window import SteadyWindow
from obsdesign.runtime.finite_time.known_inputs import Known
from obsdesign.runtime.finite_time.window import FiniteTimeState
from obsdesign.runtime.time_stamps import time_tolerance


@dataclass(frozen=True)
class FiniteTimeObserver(SteadyWindow):
    """Executes a design of kind `finite_time`."""

    kind: ClassVar[str] = "finite_time"
    finds_events: ClassVar[bool] = False

    @classmethod
    def from_gains(cls, gains: Mapping[str, Any]) -> FiniteTimeObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        _require_shapes(gains)
        return cls(gains)

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t: x1, ..., and x1_lo, x1_hi, ... where it has bounds."""
        points = tuple(f"x{i + 1}" for i in range(self.n))
        ends = tuple(f"{name}_{end}" for name in points for end in ("lo", "hi"))
        return points + (ends if self.bounded else ())

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> FiniteTimeState:
        """State at time t; x is a guess that is shown until the window is full, default zeros."""
        n, p = self.n, len(self.gains["C"])
        guess = vector(np.zeros(n) if x is None else x, n, "x")
        zero = np.zeros(n)
        known = Known.zero(n, self.k) if self._inputs is not None else None
        return FiniteTimeState(
            t=float(t), x=guess, w=zero,
            u=np.zeros(int(self.reads["u"])), drive=self._drive(np.zeros(int(self.reads["u"]))),
            window=np.full(self.k * p, np.nan), known=known, filled=0, missing=0, since=0,
            sampled=None, good=None, centre=guess, radius=np.full(n, np.inf), slip=zero,
            lift=zero, anchor=float(t), ticks=0, started=False,
        )  # fmt: skip

    def step(self, state: FiniteTimeState, sample: Sample) -> tuple[FiniteTimeState, Estimate]:
        """Move to the time of the sample, estimate, take the sample in, and jump if it says so.

        ValueError if time does not increase (the first sample may share the initial time).
        """
        t = later(sample.t, state.t, state.started)
        if state.good and not sample.jump:
            steady = self._steady(state, t, sample)
            if steady is not None:
                return steady
        with np.errstate(over="ignore", invalid="ignore"):  # the status names what is not finite
            return self._step(state, t, sample)

    def _step(
        self, state: FiniteTimeState, t: float, sample: Sample
    ) -> tuple[FiniteTimeState, Estimate]:
        y = centred_measurement(sample.y, self.gains)
        state, at_instant, irregular = self._to(state, t, y is not None)
        if sample.jump and self.gains.get("jump_measurement") != "before":
            y_before, y_after = None, y
        else:
            y_before, y_after = y, None
        if at_instant:
            state = self._instant(state, y_before)
        if irregular:
            state = self._anchored(self._emptied(state), t)
            state = self._pushed(state, y_before)
        if sample.jump:
            state = self._jumped(state, sample.w)
            if y_after is not None and self.gains["jump_measurement"] == "after":
                state = self._pushed(self._anchored(state, t), y_after)
        if sample.u is not None:
            u = vector(sample.u, len(state.u), "u")
            state = state._replace(u=u, drive=self._drive(u))
        numbers = np.concatenate((state.x, state.w, state.window))
        moderate = self._moderate_gains and bool(np.abs(numbers).max() < MODERATE)
        state = state._replace(started=True, cover=None, moderate=moderate)
        return state, self._estimate(state, irregular)

    # --- time ---------------------------------------------------------------------------------

    def _to(
        self, state: FiniteTimeState, t: float, measured: bool
    ) -> tuple[FiniteTimeState, bool, str | None]:
        """The state at t; is t an instant of the sampling, and what is wrong with it if not."""
        period = float(self.gains["period"])
        if state.sampled is None:
            state = self._flow(state, t)
            return self._anchored(state, t) if measured else state, measured, None
        elapsed = t - state.sampled
        count = round(elapsed / period)
        # stamps further apart than a period do not tell which sample it is
        resolved = count >= 1 and math.ulp(t) <= period
        regular = resolved and abs(elapsed - count * period) <= time_tolerance(elapsed, t)
        # small deviations of the same sign add up within a window
        ticks = state.ticks + count
        together = abs(t - state.anchor - ticks * period) <= time_tolerance(ticks * period, t)
        drifted, regular = regular and not together, regular and together
        passed = count - 1 if regular or drifted else math.floor(elapsed / period)
        if passed > self.k:
            state = self._anchored(self._emptied(self._flow(state, t)), t)
            passed = 0
        first = state.sampled
        for i in range(passed):
            state = self._instant(self._flow(state, float(first or 0.0) + (i + 1) * period), None)
        state = self._flow(state, t)
        if regular:
            if ticks >= self._most_ticks or state.ticks + count != ticks:
                return self._anchored(state, t), True, None
            return state._replace(sampled=t, ticks=ticks), True, None
        if passed:
            at = float(first or 0.0) + passed * period
            state = state._replace(sampled=at, ticks=state.ticks + passed)
        since = t - state.anchor if drifted else elapsed
        told = f"sampling time {since:.9g} is not a multiple of {period:.9g}"
        return state, False, told if measured else None

    @staticmethod
    def _anchored(state: FiniteTimeState, t: float) -> FiniteTimeState:
        """An instant at t from which the coming ones are counted."""
        return state._replace(sampled=t, anchor=t, ticks=0)

    def _estimate(self, state: FiniteTimeState, irregular: str | None) -> Estimate:
        reasons = [irregular] if irregular else []
        if not state.good:
            reasons.append("window not full" if state.good is None else "missing sample")
        if not self.bounded:
            return Estimate(state.t, x=state.x, status=status_of(reasons, state.x))
        low, high = self._ends(state.centre, state.radius)
        checked = (state.x, low, high) if state.good and self._has_bounds else (state.x,)
        return Estimate(state.t, state.x, low, high, status=status_of(reasons, *checked))


def _require_shapes(gains: Mapping[str, Any]) -> None:
    """ValueError unless the matrices are there and fit each other."""
    n, p = np.shape(gains.get("A", ()))[:1], np.shape(gains.get("C", ()))[:1]
    k = gains.get("samples", 0)
    if not isinstance(k, int | float) or not (k >= 1 and k == int(k)):
        raise ValueError(f"gains.samples must be a whole number >= 1; got {k!r}.")
    shapes = {"A": n + n, "C": p + n, "flow_lower": n, "flow_upper": n}
    shapes |= {"noise_bound": p, "radius": n} if "radius" in gains else {}
    shapes["window_gain"] = (*n, int(k) * p[0] if p else 0)
    if gains.get("method") == "approximate":
        shapes["L"] = n + p
    else:
        shapes |= {"state_error": n + n}
    if gains.get("method") == "least_squares":
        shapes["deviations"] = p
    if "G" in gains:
        shapes |= {"G": n + n, "jump_lower": n, "jump_upper": n}
    for name, shape in shapes.items():
        value = gains.get(name)
        if not shape or not isinstance(value, np.ndarray) or value.shape != shape:
            found = "nothing" if value is None else f"shape {np.shape(value)}"
            raise ValueError(f"gains.{name} must have shape {shape}; got {found}.")
    period = gains.get("period")
    if not isinstance(period, int | float) or not 0 < period < math.inf:
        raise ValueError(f"gains.period must be a positive number; got {period!r}.")
    if gains.get("method") not in equations.METHODS:
        raise ValueError(f"gains.method must be one of {', '.join(equations.METHODS)}.")
    if gains["method"] == "approximate" and gains.get("half_sample") not in (
        "printed",
        "corrected",
    ):
        raise ValueError("gains.half_sample must be printed or corrected.")
