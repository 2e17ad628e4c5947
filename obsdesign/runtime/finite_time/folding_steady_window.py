"""The usual step of a finite-time observer: from one instant to the next, with a full window.

The same estimate as the moves of `sampling_window`, with what stays the same computed once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from obsdesign.runtime.base import MODERATE, Estimate, Sample, Vector, centred, vector
from obsdesign.runtime.finite_time.error_radius import window_length
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
