"""Finite-time observer at run time: the state from the samples of one window.

    xhat(t_i) = w(t_i) + sum_j G_j (y_{i-k+j} - C w(t_{i-k+j})),     w' = A w + B u + b_mid

w is any response of the plant to what is known: what it leaves of x has no input, and the term of
known inputs collapses into one running response, also when they change between samples. From time
to time w is moved onto the estimate, so that it neither drifts nor grows. Method `approximate`
follows (14) to the letter instead (`approximate_inputs`), as its bias depends on the inputs.

Between samples, and where a window is not complete, the plant predicts. Row t is about x(t); the
sample at t itself enters the next window, as in the paper.

The usual step of a finite-time observer: from one instant to the next, with a full window.

The same estimate as the moves of `sampling_window`, with what stays the same computed once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.equations.finite_time import gains as equations
from obsdesign.runtime.base import (
    MODERATE,
    Estimate,
    Sample,
    Vector,
    centred,
    centred_measurement,
    later,
    status_of,
    vector,
)
from obsdesign.runtime.finite_time.error_radius import window_length
from obsdesign.runtime.finite_time.known_inputs import Known
from obsdesign.runtime.finite_time.tape import Tape
from obsdesign.runtime.finite_time.window import (
    SEEN_ROUNDING,
    Cover,
    FiniteTimeState,
    SamplingWindow,
)
from obsdesign.runtime.time_stamps import time_tolerance


@dataclass(frozen=True)
class SteadyWindow(SamplingWindow):
    """A window whose usual step is one product with the gains, and a few of size n."""

    def _steady(
        self, state: FiniteTimeState, t: float, sample: Sample
    ) -> tuple[FiniteTimeState, Estimate] | None:
        """Step and estimate; None for any step but the usual one. The window is full and whole."""
        period, p, size, most_ticks, plain, gain = self._plan
        ticks = state.ticks + 1
        if ticks > most_ticks or not self._on_time(state, t, period, ticks):
            return None
        y = sample.y
        if not isinstance(y, np.ndarray) or y.shape != (p,):
            if y is None:
                return None
            y = vector(y, p, "y")
        y = centred(y, self.gains)
        if not (abs(y.item()) if p == 1 else math.hypot(*y.tolist())) < MODERATE:
            return None  # larger numbers may overflow
        u, drive = state.u, state.drive
        if sample.u is not None:
            u = vector(sample.u, len(u), "u")
            if not math.hypot(*u.tolist()) < MODERATE:
                return None
            drive = drive if (u == state.u).all() else self._drive(u)
        # dot, as its overhead is half that of @
        x, w, residual, known = gain.dot(state.window), state.w, y, state.known
        radius, slip, cover = state.radius, state.slip, None
        low = high = None
        if not plain:
            more = self._more(state, x, y)
            if more is None:
                return None
            x, w, residual, known, cover = more
            if cover is None or cover is not state.cover:  # an old one bounds x
                ends = x.tolist() if cover is None else [*cover.x.tolist(), *cover.radius.tolist()]
                if not math.hypot(*ends) < MODERATE:
                    return None
            if cover is not None:
                slip, radius = cover.slip, cover.radius
                low, high = self._ends(x, radius)
        tape, end = state.tape, state.end
        window = None if tape is None else tape.after(end, residual, size)
        if window is None:
            tape, end = Tape(state.window, p), size
            window = tape.after(size, residual, size)
        new = (t, x, w, u, drive, window, known, state.filled, 0, state.since + 1, t, True, x,
               radius, slip, state.lift, state.anchor, ticks, True, tape, end + p,
               cover, True)  # fmt: skip
        return tuple.__new__(FiniteTimeState, new), Estimate(t, x, low, high)

    @staticmethod
    def _on_time(state: FiniteTimeState, t: float, period: float, ticks: int) -> bool:
        """Is t the next instant after a whole window, also as counted from the anchor?"""
        counted = ticks * period
        return (
            state.sampled == state.t
            and not state.missing
            and state.moderate
            and math.ulp(t) <= period
            and abs(t - state.t - period) <= time_tolerance(period, t)
            and abs(t - state.anchor - counted) <= time_tolerance(counted, t)
        )

    def _more(self, state: FiniteTimeState, x: Vector, y: Vector) -> Any:
        """x, w, the residual, known inputs and the radius, where there is more than the window.

        None where the usual step does not do. x arrives as the product with the window.
        """
        w, residual, known = state.w, y, state.known
        if self._with_inputs and known is not None and self._inputs is not None:
            if known.age:
                return None  # an input changed before the last sample
            known = self._inputs.passed(known, state.drive)
            return x + self._inputs.weights.dot(known.closed), w, residual, known, None
        if self._driven:  # one product for w and what it measures
            if state.since + 1 >= self.k:
                return None  # w is to be moved onto the estimate
            moved = self._flow_and_seen.dot(w) + state.drive
            if not math.hypot(*moved.tolist()) < MODERATE:
                return None
            w, residual = moved[: -self._p], y - moved[-self._p :]
            x = x + (w if self._unbiased else self._seen_back.dot(w))
        return x, w, residual, known, self._cover(state, x, w) if self.bounded else None

    def _cover(self, state: FiniteTimeState, x: Vector, w: Vector) -> Cover:
        """The radius at x, with the rounding of w up to now: the last one as long as it holds.

        It is worked out for twice the sizes it depends on: what it adds to `proved` is rounding.
        """
        cover, square = state.cover, float(state.window.dot(state.window))
        forced = self._forced(state.u) if len(state.u) else self._middle
        if (
            cover is not None
            and square <= cover.square
            and state.lift is cover.lift
            and (np.abs(x) <= cover.x).all()
            and (not self._driven or (np.abs(w) <= cover.w).all())
            and (forced is self._middle or (np.abs(forced) <= cover.forced).all())
        ):
            return cover
        most_x, most = 2 * np.abs(x), 2 * np.maximum(np.abs(w), np.abs(state.w))
        push = 2 * np.abs(forced)
        slip = state.slip
        if self._driven:
            slip = np.maximum(slip, self._period_maps.error(most, push) + SEEN_ROUNDING * most)
        away = most_x + most if self._driven else most_x
        size = 2 * window_length(state.window)
        radius = self._error.radius(size, most, most_x, slip, away) + state.lift
        return Cover(most, most_x, push, 4 * square, state.lift, slip, radius)

    @staticmethod
    def _ends(centre: Vector, radius: Vector) -> tuple[Vector, Vector]:
        """Lower and upper bound, outwards."""
        low, high = centre - radius, centre + radius
        return np.nextafter(low, -np.inf), np.nextafter(high, np.inf)

    @cached_property
    def _plan(self) -> tuple[float, int, int, int, bool, Vector]:
        """What every step asks, in one look."""
        plain = not self._driven and not self.bounded
        size = self.k * self._p
        return (self._period, self._p, size, self._most_ticks, plain, self._gain)

    @cached_property
    def _with_inputs(self) -> bool:
        """Does (14) as printed have known inputs to integrate? Without any it is a product."""
        return self._inputs is not None and self._driven

    @cached_property
    def _unbiased(self) -> bool:
        return bool(self.gains["method"] != "approximate")


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
