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
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.equations import finite_time as equations
from obsdesign.errors import InputError
from obsdesign.runtime.approximate_inputs import ApproximateInputs, Known
from obsdesign.runtime.base import (
    RELATIVE_TIME_TOLERANCE,
    Batch,
    Estimate,
    Sample,
    Vector,
    collect,
    later,
    optional_measurement,
    rows_of,
    run,
    vector,
)
from obsdesign.runtime.step_cache import cached_step
from obsdesign.runtime.window_error import FlowMaps, WindowError, flow_maps

# rounding of y - C w, as a part of w
_SEEN = 2.0**-48
# the scaled rows of an incomplete window must be that far from losing rank
_DETERMINED = 1e-11


class FiniteTimeState(NamedTuple):  # a frozen dataclass of this size costs more than the step
    """Everything the next step needs, just after time t.

    x: estimate; w: known response; drive: what the input u adds to (w, C w) in a period; window:
    (k p,) residuals y - C w, oldest first, NaN where a sample is missing; filled: instants in it;
    since: instants since w was moved; sampled: time of the last instant; good: was x taken from
    a full window, False with gaps, None not yet; |state - centre| <= radius; slip: rounding of w
    per step.
    """

    t: float
    x: Vector
    w: Vector
    u: Vector
    drive: Vector
    window: Vector
    known: Known | None
    filled: int
    missing: int
    since: int
    sampled: float | None
    good: bool | None
    centre: Vector
    radius: Vector
    slip: Vector
    started: bool


@dataclass(frozen=True)
class FiniteTimeObserver:
    """Executes a design of kind `finite_time`."""

    gains: Mapping[str, Any]
    kind: ClassVar[str] = "finite_time"
    finds_events: ClassVar[bool] = False
    _steps: OrderedDict[tuple[float, int], Any] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    @classmethod
    def from_gains(cls, gains: Mapping[str, Any]) -> FiniteTimeObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        _require_shapes(gains)
        return cls(gains)

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.gains["A"])

    @cached_property
    def k(self) -> int:
        """Samples in the window."""
        return int(self.gains["samples"])

    @cached_property
    def bounded(self) -> bool:
        """Are there bounds for disturbance or noise, and hence for the state?"""
        return bool(np.any(self.gains.get("radius", 0.0)))

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t: x1, ..., and x1_lo, x1_hi, ... where it has bounds."""
        points = tuple(f"x{i + 1}" for i in range(self.n))
        ends = tuple(f"{name}_{end}" for name in points for end in ("lo", "hi"))
        return points + (ends if self.bounded else ())

    @property
    def reads(self) -> dict[str, int | bool]:
        """How many y, u, w a sample has, and whether jumps are reported."""
        u, w = (self.gains[x].shape[1] if x in self.gains else 0 for x in ("B", "E"))
        return {"y": len(self.gains["C"]), "u": u, "w": w, "jump": "G" in self.gains}

    def start(self, t: float, initial: Sequence[float] | None) -> FiniteTimeState:
        """State from x1, ..., xn, default zeros; InputError if they are not n finite numbers."""
        x = [0.0] * self.n if initial is None else list(initial)
        if len(x) != self.n or not np.isfinite(x).all():
            names = ",".join(f"x{i + 1}" for i in range(self.n))
            raise InputError(
                f"--initial must be the {self.n} finite numbers {names}; got {len(x)} numbers."
            )
        return self.init(t, x=x)

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
            started=False,
        )  # fmt: skip

    def step(self, state: FiniteTimeState, sample: Sample) -> tuple[FiniteTimeState, Estimate]:
        """Move to the time of the sample, estimate, take the sample in, and jump if it says so.

        ValueError if time does not increase (the first sample may share the initial time).
        """
        t = later(sample.t, state.t, state.started)
        if state.good and not sample.jump and sample.u is None:
            steady = self._steady(state, t, sample.y)
            if steady is not None:
                return steady, Estimate(t, x=steady.x)
        y = optional_measurement(sample.y, self._p)
        state, at_instant, irregular = self._to(state, t, y is not None)
        if sample.jump and self.gains.get("jump_measurement") != "before":
            y_before, y_after = None, y
        else:
            y_before, y_after = y, None
        if at_instant:
            state = self._instant(state, y_before)
        if irregular:
            state = self._emptied(state)._replace(sampled=t)
            state = self._pushed(state, y_before)
        if sample.jump:
            state = self._jumped(state, sample.w)
            if y_after is not None and self.gains["jump_measurement"] == "after":
                state = self._pushed(state._replace(sampled=t), y_after)
        if sample.u is not None:
            u = vector(sample.u, len(state.u), "u")
            state = state._replace(u=u, drive=self._drive(u))
        state = state._replace(started=True)
        return state, self._estimate(state, irregular)

    def _steady(
        self, state: FiniteTimeState, t: float, y: ArrayLike | None
    ) -> FiniteTimeState | None:
        """The usual step, from one instant to the next with a full window; None for any other."""
        regular = state.sampled == state.t and not state.missing and state.since + 1 < self.k
        if self._special or not regular or state.filled < self.k:
            return None
        period = self._period
        if abs(t - state.t - period) > self._slack(t, period):
            return None
        if not isinstance(y, np.ndarray) or y.shape != (self._p,) or not math.isfinite(y.sum()):
            return None
        # one product for w and what it measures; dot, as its overhead is half that of @
        moved = self._flow_and_seen.dot(state.w) + state.drive
        w = moved[: -self._p]
        x = w + self._gain.dot(state.window)
        window = np.concatenate((state.window[self._p :], y - moved[-self._p :]))
        return FiniteTimeState(
            t, x, w, state.u, state.drive, window, None, state.filled, 0, state.since + 1, t,
            True, x, state.radius, state.slip, True,
        )  # fmt: skip

    def run(self, state: FiniteTimeState, samples: Iterable[Sample]) -> Iterator[Estimate]:
        """Estimates for a stream of samples."""
        return run(self, state, samples)

    def run_batch(
        self,
        t: ArrayLike,
        y: ArrayLike | None = None,
        u: ArrayLike | None = None,
        w: ArrayLike | None = None,
        jump: ArrayLike | None = None,
        *,
        x: ArrayLike | None = None,
    ) -> Batch:
        """The whole record at once: a loop over `step` from a guess of x at its first row."""
        times = np.asarray(t, dtype=np.float64)
        state = self.init(float(times[0]), x=x)
        return collect(self.run(state, rows_of(times, y, u, w, jump)))

    # --- time ---------------------------------------------------------------------------------

    def _to(
        self, state: FiniteTimeState, t: float, measured: bool
    ) -> tuple[FiniteTimeState, bool, str | None]:
        """The state at t; is t an instant of the sampling, and what is wrong with it if not."""
        period = float(self.gains["period"])
        if state.sampled is None:
            state = self._flow(state, t)
            if measured:
                state = state._replace(sampled=t)
            return state, measured, None
        elapsed = t - state.sampled
        count = round(elapsed / period)
        slack = self._slack(t, elapsed)
        regular = count >= 1 and abs(elapsed - count * period) <= slack
        passed = (count if regular else math.floor(elapsed / period)) - (1 if regular else 0)
        if passed > self.k:
            state = self._emptied(self._flow(state, t))._replace(sampled=t)
            passed = 0
        first = state.sampled
        for i in range(passed):
            state = self._instant(self._flow(state, float(first or 0.0) + (i + 1) * period), None)
        state = self._flow(state, t)
        if regular:
            return state._replace(sampled=t), True, None
        told = f"sampling time {elapsed:.9g} is not a multiple of {period:.9g}"
        return state, False, told if measured else None

    def _flow(self, state: FiniteTimeState, t: float) -> FiniteTimeState:
        """Everything that moves with the plant, to time t."""
        h = t - state.t
        if h <= 0:
            return state._replace(t=t)
        size = max(abs(t), abs(state.t))
        maps = cached_step(self._steps, h, size, self._maps)
        forced = self._forced(state.u)
        x = maps.flow @ state.x + maps.once @ forced
        w = maps.flow @ state.w + maps.once @ forced
        known = state.known
        if known is not None and self._inputs is not None:
            known = self._inputs.moved(known, forced, h, maps)
        if not self.bounded:
            return state._replace(t=t, x=x, w=w, known=known)
        centre = maps.flow @ state.centre + maps.once @ forced
        slip = np.maximum(state.slip, maps.error(state.w, forced) + _SEEN * np.abs(w))
        radius = maps.spread(state.radius) + maps.error(state.centre, forced)
        return state._replace(t=t, x=x, w=w, known=known, centre=centre, radius=radius, slip=slip)

    @staticmethod
    def _slack(t: float, elapsed: float) -> float:
        """Time stamps are decimal: how far two of them may be from `elapsed` apart."""
        return RELATIVE_TIME_TOLERANCE * elapsed + 8 * math.ulp(t)

    def _drive(self, u: Vector) -> Vector:
        once = self._period_maps.once @ self._forced(u)
        return np.concatenate([once, self.gains["C"] @ once])

    def _maps(self, h: float, error: float) -> Any:
        return flow_maps(self.gains, h, error)

    def _forced(self, u: Vector) -> Vector:
        middle = (self.gains["flow_lower"] + self.gains["flow_upper"]) / 2
        return np.asarray(middle + self.gains["B"] @ u if len(u) else middle)

    # --- the window -----------------------------------------------------------------------------

    def _instant(self, state: FiniteTimeState, y: Vector | None) -> FiniteTimeState:
        """At a sampling instant: estimate from the window, then take the sample (or none) in."""
        if state.known is not None and self._inputs is not None and state.filled:
            state = state._replace(known=self._inputs.closed(state.known))
        if state.filled == self.k:
            state = self._estimated(state)
        return self._pushed(state, y)

    def _estimated(self, state: FiniteTimeState) -> FiniteTimeState:
        if state.missing:
            x = self._from_the_rest(state)
            return state._replace(good=False) if x is None else state._replace(x=x, good=False)
        if state.known is not None and self._inputs is not None:
            x = self.gains["window_gain"] @ state.window + self._inputs.known_part(state.known)
            return state._replace(x=x, good=True)
        x = self._seen_back @ state.w + self.gains["window_gain"] @ state.window
        if self.bounded:
            radius = self._error.radius(state.window, state.w, x, state.slip)
            state = state._replace(centre=x, radius=radius)
        state = state._replace(x=x, good=True, since=state.since + 1)
        # where bounds are told, w stays: moving it rounds the residuals
        return self._moved_onto(state, x) if self._due(state) else state

    def _due(self, state: FiniteTimeState) -> bool:
        return state.since >= self.k and not self.bounded

    def _moved_onto(self, state: FiniteTimeState, x: Vector) -> FiniteTimeState:
        """Another response w through x: the residuals of the window follow."""
        window = state.window - self._rows @ (x - state.w)
        return state._replace(w=x, window=window, since=0)

    def _from_the_rest(self, state: FiniteTimeState) -> Vector | None:
        """Least squares on the samples that are there; None if they do not determine the state."""
        if self.gains["method"] != "least_squares":
            return None
        there = np.isfinite(state.window)
        rows = self._rows[there]
        if equations.approx_determinacy(rows, self._scales) < _DETERMINED:
            return None
        deviations = np.tile(self.gains["deviations"], self.k)[there]
        gain = equations.least_squares_gain(rows, deviations)
        return np.asarray(state.w + gain @ state.window[there])

    def _pushed(self, state: FiniteTimeState, y: Vector | None) -> FiniteTimeState:
        p = len(self.gains["C"])
        fresh = np.full(p, np.nan) if y is None else y - self.gains["C"] @ self._base(state)
        leaving = state.filled == self.k and bool(np.isnan(state.window[0]))
        window = np.concatenate([state.window[p:], fresh])
        missing = state.missing + (y is None) - leaving
        known = state.known
        if known is not None:
            known = known.opened()
        filled = min(state.filled + 1, self.k)
        return state._replace(window=window, filled=filled, missing=missing, known=known)

    def _base(self, state: FiniteTimeState) -> Vector:
        """What is taken off the measurements: nothing for (14), which has its own way."""
        return np.zeros(self.n) if state.known is not None else state.w

    def _emptied(self, state: FiniteTimeState) -> FiniteTimeState:
        known = Known.zero(self.n, self.k) if state.known is not None else None
        window = np.full_like(state.window, np.nan)
        return state._replace(
            window=window, filled=0, missing=0, since=0, sampled=None, good=None,
            w=np.zeros(self.n), known=known, slip=np.zeros(self.n),
        )  # fmt: skip

    def _jumped(self, state: FiniteTimeState, w: ArrayLike | None) -> FiniteTimeState:
        """After a jump the samples before it say nothing: the window starts again."""
        gains = self.gains
        if "G" not in gains:
            raise ValueError("this plant has no jumps ([jump] is absent), but a sample says jump.")
        moved = (gains["jump_lower"] + gains["jump_upper"]) / 2
        if "E" in gains:
            inputs = int(self.reads["w"])
            moved = moved + gains["E"] @ (np.zeros(inputs) if w is None else vector(w, inputs, "w"))
        spread = np.full(self.n, np.inf)
        x = gains["G"] @ state.x + moved
        return self._emptied(state)._replace(x=x, centre=x, radius=spread)

    def _estimate(self, state: FiniteTimeState, irregular: str | None) -> Estimate:
        reasons = [irregular] if irregular else []
        if not state.good:
            reasons.append("window not full" if state.good is None else "missing sample")
        status = "; ".join(reasons) or "ok"
        if not self.bounded:
            return Estimate(state.t, x=state.x, status=status)
        low, high = state.centre - state.radius, state.centre + state.radius
        low, high = np.nextafter(low, -np.inf), np.nextafter(high, np.inf)
        return Estimate(state.t, x=state.x, lower=low, upper=high, status=status)

    # --- what follows from the gains --------------------------------------------------------------

    @cached_property
    def _p(self) -> int:
        return len(self.gains["C"])

    @cached_property
    def _gain(self) -> Vector:
        return np.ascontiguousarray(self.gains["window_gain"])

    @cached_property
    def _period(self) -> float:
        return float(self.gains["period"])

    @cached_property
    def _special(self) -> bool:
        """Has a step more to do than the estimate alone?"""
        return self.bounded or self.gains["method"] == "approximate"

    @cached_property
    def _period_maps(self) -> FlowMaps:
        return flow_maps(self.gains, self._period, 0.0)

    @cached_property
    def _flow_and_seen(self) -> Vector:
        flow = self._period_maps.flow
        return np.vstack([flow, self.gains["C"] @ flow])

    @cached_property
    def _rows(self) -> Vector:
        """C A_d^(j-k), (k p, n)."""
        gains = self.gains
        rows = equations.sample_rows(gains["A"], gains["C"], float(gains["period"]), self.k)
        return rows.reshape(-1, self.n)

    @cached_property
    def _scales(self) -> Vector:
        A, C = self.gains["A"], self.gains["C"]
        return np.asarray(equations.state_scales(A, C, self.k * self._period))

    @cached_property
    def _seen_back(self) -> Vector:
        """sum_j G_j C A_d^(j-k): the identity, but for (14) with its delay taken off."""
        if self.gains["method"] != "approximate":
            return np.eye(self.n)
        return np.asarray(self.gains["window_gain"] @ self._rows)

    @cached_property
    def _error(self) -> WindowError:
        return WindowError.of(self.gains)

    @cached_property
    def _inputs(self) -> ApproximateInputs | None:
        """How (14) as printed treats known inputs; None for every other method."""
        if self.gains["method"] != "approximate" or self.gains["half_sample"] != "printed":
            return None
        return ApproximateInputs.of(self.gains)


def _require_shapes(gains: Mapping[str, Any]) -> None:
    """ValueError unless the matrices are there and fit each other."""
    n, p = np.shape(gains.get("A", ()))[:1], np.shape(gains.get("C", ()))[:1]
    k = gains.get("samples", 0)
    if not isinstance(k, int | float) or not (k >= 1 and k == int(k)):
        raise ValueError(f"gains.samples must be a whole number >= 1; got {k!r}.")
    shapes = {"A": n + n, "C": p + n, "flow_lower": n, "flow_upper": n, "noise_bound": p}
    shapes["window_gain"] = (*n, int(k) * p[0] if p else 0)
    if gains.get("method") == "approximate":
        shapes["L"] = n + p
    else:
        shapes |= {"radius": n, "state_error": n + n}
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
