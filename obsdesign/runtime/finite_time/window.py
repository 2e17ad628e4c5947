"""The window of a finite-time observer: how it moves with the plant, takes samples, estimates.

A state is never changed: every move returns a new one.

What follows from the gains of a finite-time observer, worked out once.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.equations.finite_time import gains as equations
from obsdesign.runtime.base import MODERATE, Vector, vector
from obsdesign.runtime.finite_time.error_radius import WindowError, window_length
from obsdesign.runtime.finite_time.flow_maps import FlowMaps, flow_maps
from obsdesign.runtime.finite_time.known_inputs import ApproximateInputs, Known
from obsdesign.runtime.finite_time.tape import Tape
from obsdesign.runtime.point_observer import SteppedObserver
from obsdesign.runtime.step_cache import shared_step

_LEAST_TICKS = 64
_UNSEEN = 1e-12


@dataclass(frozen=True)
class WindowConstants:
    """The gains of a design, and matrices made of them."""

    gains: Mapping[str, Any]
    _steps: OrderedDict[tuple[float, int], Any] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    @cached_property
    def k(self) -> int:
        """Samples in the window."""
        return int(self.gains["samples"])

    @cached_property
    def _most_ticks(self) -> int:
        """Instants that are counted from the same one: a window, and not too few."""
        return max(self.k, _LEAST_TICKS)

    @cached_property
    def bounded(self) -> bool:
        """Are there bounds for disturbance or noise, and hence for the state?"""
        return bool(np.any(self.gains.get("radius", 0.0)))

    def _drive(self, u: Vector) -> Vector:
        return np.asarray(self._once_and_seen.dot(self._forced(u)))

    def _forced(self, u: Vector) -> Vector:
        return self._middle + self.gains["B"].dot(u) if len(u) else self._middle

    @cached_property
    def _p(self) -> int:
        return len(self.gains["C"])

    @cached_property
    def _gain(self) -> Vector:
        return np.ascontiguousarray(self.gains["window_gain"])

    @cached_property
    def _moderate_gains(self) -> bool:
        """Are products of the gains with a moderate window finite?"""
        return bool(np.abs(self._gain).max() < MODERATE)

    @cached_property
    def _middle(self) -> Vector:
        return np.asarray((self.gains["flow_lower"] + self.gains["flow_upper"]) / 2)

    @cached_property
    def _period(self) -> float:
        return float(self.gains["period"])

    @cached_property
    def _driven(self) -> bool:
        """Does anything known drive the plant? If not, w is zero and stays so."""
        return "B" in self.gains or bool(np.any(self._forced(np.zeros(0))))

    @cached_property
    def _period_maps(self) -> FlowMaps:
        return flow_maps(self.gains, self._period, 0.0)

    @cached_property
    def _flow_and_seen(self) -> Vector:
        flow = self._period_maps.flow
        return np.vstack([flow, self.gains["C"] @ flow])

    @cached_property
    def _once_and_seen(self) -> Vector:
        if self._inputs is not None:  # (14) as printed has its own way, and no need of w
            return self._inputs.of_period
        once = self._period_maps.once
        return np.vstack([once, self.gains["C"] @ once])

    @cached_property
    def _rows(self) -> Vector:
        """C A_d^(j-k), or C A_d^j where the window speaks of its start, (k p, n)."""
        gains = self.gains
        rows = equations.sample_rows(gains["A"], gains["C"], self._period, self.k, self._reference)
        return rows.reshape(-1, len(self.gains["A"]))

    @cached_property
    def _reference(self) -> str:
        return str(self.gains.get("reference", equations.END))

    @cached_property
    def _last(self) -> Vector:
        """x(t_i) as a function of what `_rows` speak of."""
        if self.bounded and self._error.start is not None:
            return self._error.start.last.mid
        return equations.last_state(self.gains["A"], self.k * self._period, self._reference)

    @cached_property
    def _of_start(self) -> Vector | None:
        """x(t_i - T) - w from the window; None where the window speaks of its end."""
        if self._reference == equations.END:
            return None
        # what the window does not see need not move
        return equations.least_squares_gain(self._rows, np.ones(len(self._rows)), _UNSEEN)

    @cached_property
    def _scales(self) -> Vector:
        A, C = self.gains["A"], self.gains["C"]
        return np.asarray(equations.state_scales(A, C, self.k * self._period))

    @cached_property
    def _seen_back(self) -> Vector:
        """sum_j G_j C A_d^(j-k): the identity, but for (14) with its delay taken off."""
        if self.gains["method"] != "approximate":
            return np.eye(len(self.gains["A"]))
        return np.asarray(self.gains["window_gain"] @ self._rows)

    @cached_property
    def _error(self) -> WindowError:
        return WindowError.of(self.gains)

    @cached_property
    def _has_bounds(self) -> bool:
        """Is the radius of ordinary data finite? States that no sample shows have no bound."""
        one = np.ones(len(self.gains["A"]))
        with np.errstate(over="ignore", invalid="ignore"):
            radius = self._error.radius(1.0, one, one, 0 * one, one)
        return self.bounded and bool(np.isfinite(radius).all())

    @cached_property
    def _inputs(self) -> ApproximateInputs | None:
        """How (14) as printed treats known inputs; None for every other method."""
        if self.gains["method"] != "approximate" or self.gains["half_sample"] != "printed":
            return None
        return ApproximateInputs.of(self.gains)


# rounding of y - C w, as a part of w
SEEN_ROUNDING = 2.0**-48
# the scaled rows of an incomplete window must be that far from losing rank
_DETERMINED = 1e-11
# w is that much larger than the estimate before it is replaced where bounds are told
_GROWN = 2.0


class Cover(NamedTuple):
    """A radius that holds as long as everything it depends on stays below what is stored here."""

    w: Vector
    x: Vector
    forced: Vector
    square: float
    lift: Vector
    slip: Vector
    radius: Vector


class FiniteTimeState(NamedTuple):  # a frozen dataclass of this size costs more than the step
    """Everything the next step needs, just after time t.

    x: estimate; w: known response; drive: what the input u adds to (w, C w) in a period; window:
    (k p,) residuals y - C w, oldest first, NaN where a sample is missing; filled: instants in it;
    since: instants since w was moved; sampled: time of the last instant; good: was x taken from
    a full window, False with gaps, None not yet; |state - centre| <= radius; slip: rounding of w
    per step; lift: what moving w has cost the window; anchor, ticks: an instant, and how many ago
    it was; tape, end: where the window may grow; cover: the last radius, and how long it holds;
    moderate: x, w and the residuals are below `MODERATE`.
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
    lift: Vector
    anchor: float
    ticks: int
    started: bool
    tape: Tape | None = None
    end: int = 0
    cover: Cover | None = None
    moderate: bool = False


@dataclass(frozen=True)
class SamplingWindow(WindowConstants, SteppedObserver[FiniteTimeState]):
    """What a window of samples needs: the gains, what follows from them, and its moves."""

    def _flow(self, state: FiniteTimeState, t: float) -> FiniteTimeState:
        """Everything that moves with the plant, to time t."""
        h = t - state.t
        if h <= 0:
            return state._replace(t=t)
        size = max(abs(t), abs(state.t))
        maps = shared_step(self._steps, h, size, self._maps)
        forced = self._forced(state.u)
        x = maps.flow @ state.x + maps.once @ forced
        w = maps.flow @ state.w + maps.once @ forced
        known = state.known
        if known is not None and self._inputs is not None:
            known = self._inputs.moved(known, forced, h, maps)
        if not self.bounded:
            return state._replace(t=t, x=x, w=w, known=known)
        centre = maps.flow @ state.centre + maps.once @ forced
        slip = np.maximum(state.slip, maps.error(state.w, forced) + SEEN_ROUNDING * np.abs(w))
        radius = maps.spread(state.radius) + maps.error(state.centre, forced)
        return state._replace(t=t, x=x, w=w, known=known, centre=centre, radius=radius, slip=slip)

    def _maps(self, h: float, error: float) -> Any:
        return flow_maps(self.gains, h, error)

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
            state = state._replace(good=False, since=state.since + 1)
            return self._refreshed(state if x is None else state._replace(x=x))
        if state.known is not None and self._inputs is not None:
            x = self.gains["window_gain"] @ state.window + self._inputs.known_part(state.known)
            return state._replace(x=x, good=True)
        x = self._seen_back @ state.w + self.gains["window_gain"] @ state.window
        if self.bounded:
            size, away = window_length(state.window), np.abs(x - state.w)
            w = np.abs(state.w)
            radius = self._error.radius(size, w, np.abs(x), state.slip, away) + state.lift
            state = state._replace(centre=x, radius=radius)
        return self._refreshed(state._replace(x=x, good=True, since=state.since + 1))

    def _refreshed(self, state: FiniteTimeState) -> FiniteTimeState:
        """Once per window another response w, through the estimate: it may grow where x does not.

        Where bounds are told, only if it has grown: moving it rounds the residuals (`lift`).
        """
        if state.since < self.k or not self._driven or state.known is not None:
            return state
        if self.bounded and not np.abs(state.w).max() > _GROWN * np.abs(state.x).max():
            return state._replace(since=0, lift=np.zeros(self.n))
        if self._of_start is None:
            away, w = state.x - state.w, state.x
        else:  # back in time fast modes would explode: from the window's start instead
            away = self._of_start @ np.nan_to_num(state.window)
            w = state.w + self._last @ away
        if self.bounded:
            window, lift = self._error.moved(state.window, away, w)
        else:
            window, lift = state.window - self._rows @ away, state.lift
        return state._replace(w=w, window=window, lift=lift, since=0, tape=None)

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
        return np.asarray(state.w + self._last @ (gain @ state.window[there]))

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
        return state._replace(window=window, filled=filled, missing=missing, known=known, tape=None)

    def _base(self, state: FiniteTimeState) -> Vector:
        """What is taken off the measurements: nothing for (14), which has its own way."""
        return np.zeros(self.n) if state.known is not None else state.w

    def _emptied(self, state: FiniteTimeState) -> FiniteTimeState:
        known = Known.zero(self.n, self.k) if state.known is not None else None
        window = np.full_like(state.window, np.nan)
        return state._replace(
            window=window, filled=0, missing=0, since=0, sampled=None, good=None,
            w=np.zeros(self.n), known=known, slip=np.zeros(self.n), lift=np.zeros(self.n),
            tape=None,
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
