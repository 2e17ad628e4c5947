"""The usual step of a finite-time observer: from one instant to the next, with a full window.

The same estimate as the moves of `sampling_window`, with what stays the same computed once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from obsdesign.runtime.base import Estimate, Sample, Vector, vector
from obsdesign.runtime.sampling_window import SEEN_ROUNDING, FiniteTimeState, SamplingWindow
from obsdesign.runtime.window_tape import Tape


@dataclass(frozen=True)
class SteadyWindow(SamplingWindow):
    """A window whose usual step is one product with the gains, and a few of size n."""

    def _steady(
        self, state: FiniteTimeState, t: float, sample: Sample
    ) -> tuple[FiniteTimeState, Estimate] | None:
        """Step and estimate; None for any step but the usual one. The window is full and whole."""
        period, p, size, with_inputs, moves, plain, gain = self._plan
        if with_inputs or state.sampled != state.t or state.missing:
            return None
        if moves and state.since + 1 >= self.k:
            return None  # w is to be moved onto the estimate
        if abs(t - state.t - period) > self._slack(t, period):
            return None
        y = sample.y
        if not isinstance(y, np.ndarray) or y.shape != (p,):
            if y is None:
                return None
            y = vector(y, p, "y")
        if not math.isfinite(y.item() if p == 1 else y.dot(y)):
            return None  # a square that overflows takes the long way too
        u, drive = state.u, state.drive
        if sample.u is not None:
            u = vector(sample.u, len(u), "u")
            drive = drive if (u == state.u).all() else self._drive(u)
        # dot, as its overhead is half that of @
        x = gain.dot(state.window)
        if plain:
            w, residual, slip, radius, low, high = state.w, y, state.slip, state.radius, None, None
        else:
            x, w, residual, slip, radius, low, high = self._driven_or_bounded(state, x, y)
        tape, end = state.tape, state.end
        window = None if tape is None else tape.after(end, residual, size)
        if window is None:
            tape, end = Tape(state.window), size
            window = tape.after(size, residual, size)
        new = (t, x, w, u, drive, window, state.known, state.filled, 0, state.since + 1, t, True, x,
               radius, slip, True, tape, end + p)  # fmt: skip
        return tuple.__new__(FiniteTimeState, new), Estimate(t, x, low, high)

    def _driven_or_bounded(self, state: FiniteTimeState, x: Vector, y: Vector) -> Any:
        """x, w, y - C w, slip, radius and bounds; x arrives as the product with the window."""
        w, residual, slip = state.w, y, state.slip
        if self._driven:  # one product for w and what it measures
            moved = self._flow_and_seen.dot(w) + state.drive
            if self.bounded:
                slip = self._slipped(state, moved[: -self._p])
            w, residual = moved[: -self._p], y - moved[-self._p :]
            x = x + (w if self._unbiased else self._seen_back.dot(w))
        if not self.bounded:
            return x, w, residual, slip, state.radius, None, None
        radius = self._error.radius(state.window, w, x, slip)
        return x, w, residual, slip, radius, *self._ends(x, radius)

    def _slipped(self, state: FiniteTimeState, w: Vector) -> Vector:
        """Rounding of w per step, and of what it measures: at most this so far."""
        error = self._period_maps.error(state.w, self._forced(state.u))
        return np.maximum(state.slip, error + SEEN_ROUNDING * np.abs(w))

    @staticmethod
    def _ends(centre: Vector, radius: Vector) -> tuple[Vector, Vector]:
        """Lower and upper bound, outwards."""
        low, high = centre - radius, centre + radius
        return np.nextafter(low, -np.inf), np.nextafter(high, np.inf)

    @cached_property
    def _plan(self) -> tuple[float, int, int, bool, bool, bool, Vector]:
        """What every step asks, in one look."""
        plain = not self._driven and not self.bounded
        size = self.k * self._p
        return (self._period, self._p, size, self._with_inputs, self._moves, plain, self._gain)

    @cached_property
    def _with_inputs(self) -> bool:
        """Does (14) as printed have known inputs to integrate? Without any it is a product."""
        return self._inputs is not None and self._driven

    @cached_property
    def _moves(self) -> bool:
        """Is w moved onto the estimate, once per window?"""
        return self._driven and not self.bounded

    @cached_property
    def _unbiased(self) -> bool:
        return bool(self.gains["method"] != "approximate")
