"""Step 2 at run time: an impulse from one window, with what noise leaves open about it.

plain: the paper's (18). gls: the features are whitened. With taps Psi and noise deviations s_k of
the samples, the singular vectors U of diag(s) Psi give features U'(e / s) with unit covariance, of
which b and V are the same linear map T; no Gramian is formed or inverted. The error e(t_o), of
covariance P, is part of the noise: R = V e(t_o) + b g + v has covariance I + V P V'. Both go
beyond the paper.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.exponential import expm
from obsdesign.equations.impulsive_input.curve import ImpulseCurve
from obsdesign.equations.impulsive_input.features import feature_scales, window_taps
from obsdesign.equations.impulsive_input.fit import Impulse, explained, fit_impulse, peaks
from obsdesign.runtime.base import Vector
from obsdesign.runtime.impulsive_input.event import MISFIT, Event
from obsdesign.runtime.impulsive_input.whitening import (
    Z_SCORE,
    chi_squared_limit,
    covariance_of,
    noise_covariance,
    plain_deviations,
    root_of_sum,
    whitened,
)

Array = NDArray[Any]

# gls: likelihood ratio of an impulse against none
_LEAST_GAIN = 36.0
# plain, without noise: part of R that a fit may leave at the start of a search
_GOOD_FIT = 1e-3


@dataclass(frozen=True, slots=True)
class Decision:
    """What a window said: an event (None: no impulse), the correction of the state at t_o, P after.

    covariance: of the error at the end of the window, None without tracking. cost, freedom: what
    the fit leaves of whitened features, chi-squared of so many degrees of freedom; 0 without.
    """

    event: Event | None
    age: float
    correction: Vector
    covariance: Array | None
    cost: float = 0.0
    freedom: int = 0


@dataclass(frozen=True, slots=True)
class Window:
    """Rows from t_o on: times, taps Psi (rows, m), residual (rows, p), deviations of its noise.

    onsets (rows, p m, n): features of unit states that appear at a row.
    """

    t: Array
    taps: Array
    error: Array
    spread: Array
    onsets: Array


@dataclass(frozen=True)
class Evaluator:
    """Parameters of step 2; A, D (n, n), C (p, n), H (n, q); V = V(tau), (p m, n)."""

    A: Array
    D: Array
    C: Array
    H: Array
    exponents: Vector
    tau: float
    margin: float
    V: Array
    curve: ImpulseCurve
    gls: bool
    state_correction: bool
    nonnegative: bool

    @functools.cached_property
    def oldest(self) -> float:
        """Ages that are searched end here; the end of the window if that leaves none."""
        oldest = self.curve.oldest
        return oldest if oldest > self.margin else self.tau

    def taps(self, times: Array) -> Array:
        """Psi (rows, m) of the window from times[0] on; the last row may lie beyond its end.

        Then the residual at the end of the window is interpolated.
        """
        end = times[0] + self.tau
        before, after = times[-2], times[-1]
        share = (end - before) / (after - before)
        if share > 1 - 1e-6:
            return self._scaled_taps(times)
        taps = self._scaled_taps(np.append(times[:-1], end))
        last = taps[-1].copy()
        taps[-1] = share * last
        taps[-2] += (1 - share) * last
        return taps

    def _scaled_taps(self, times: Array) -> Array:
        return window_taps(self.exponents, times) * feature_scales(self.exponents, self.tau)

    def decide(self, R: Vector, window: Window, P: Array | None, at_start: bool) -> Decision | None:
        """Evaluate a window; None: nothing there that counts.

        R (p m,) features; P covariance of the error at t_o (gls); at_start: only a good fit counts.
        """
        if self.gls and P is not None:
            return self._weighted(window, P, at_start)
        unit = window.spread if window.spread.all() else np.ones_like(window.spread)
        alike = whitened(window.taps, window.error, unit)
        found = self._fitted(R, window, np.eye(len(R)), alike)
        if found is None:
            return None
        noisy = bool(window.spread.any())
        if at_start:
            allowed = _GOOD_FIT**2 * float(R @ R)
            if noisy:
                N = noise_covariance(window.taps, window.spread)
                allowed += float(np.trace(N)) + Z_SCORE * math.sqrt(2 * float((N * N).sum()))
            if found.cost > allowed or not found.inside:
                return None
        stds = plain_deviations(found, window.taps, window.spread) if noisy else (None, None)
        event = Event(self._time(window, found), found.weights, *stds)
        return Decision(event, found.age, np.zeros(len(self.D)), None)

    def _time(self, window: Window, found: Impulse) -> float:
        return float(window.t[0]) + self.tau - found.age

    def _fitted(
        self, R: Array, window: Window, T: Array, whitened_too: tuple[Array, Array] | None = None
    ) -> Impulse | None:
        """The best impulse for weighted features R, with b weighted by T.

        Samples of an impulse response, joined linearly, leave other features than the response
        itself, which matters where the output jumps with the impulse. So all onsets are looked at
        again as samples show them. Features under the plain norm are nearly dependent; where to
        look is seen better in `whitened_too`, features and T without that.
        """
        found = fit_impulse(R, self.curve, self.margin, self.oldest, T, self.nonnegative)
        if found is None:
            return None
        ages = window.t[0] + self.tau - window.t
        searched = (ages >= self.margin) & (ages <= self.oldest)
        cells = np.flatnonzero(searched & (np.arange(len(ages)) > 0))
        width = float(np.median(np.diff(window.t)))
        inside = expm(self.A * (width * np.array([0.0, 0.5, 1.0]))[:, None, None]) @ self.H
        likely = {int(np.searchsorted(window.t, self._time(window, found), "left"))}
        for features, weighting in ((R, T), whitened_too or (R, T)):
            for jump in inside:
                seen = weighting @ (window.onsets[cells] @ jump)
                gains = explained(seen, features, self.nonnegative)
                likely |= {int(cells[k]) for k in peaks(gains)}
        tried: dict[int, Impulse] = {}

        def look(cell: int) -> float:
            if cell not in tried and 1 <= cell < len(window.t):
                there = self._in_cell(R, window, T, cell)
                if there is not None:
                    tried[cell] = there
            return tried[cell].cost if cell in tried else math.inf

        cost, cell = min((look(c + step), c + step) for c in sorted(likely) for step in (0, 1))
        for step in (-1, 1):  # valleys are flat: go on while it goes down
            while look(cell + step) < cost:
                cell += step
                cost = tried[cell].cost
        return replace(tried[cell], inside=found.inside) if cell in tried else found

    def _in_cell(self, R: Array, window: Window, T: Array, cell: int) -> Impulse | None:
        """The best impulse with its onset between rows cell - 1 and cell."""
        t_c = float(window.t[cell])
        width = t_c - float(window.t[cell - 1])
        curve = ImpulseCurve.of(self.A, self.H, width, points=4, n=0)
        M = T @ window.onsets[cell]
        # an onset at the row before would be one that this row shows already
        found = fit_impulse(R, curve, 0.0, width * (1 - 1e-6), M, self.nonnegative)
        if found is None:
            return None
        return replace(found, age=float(window.t[0]) + self.tau - t_c + found.age)

    def _weighted(self, window: Window, P: Array, at_start: bool) -> Decision | None:
        R, T = whitened(window.taps, window.error, window.spread)
        V = T @ self.V
        half = root_of_sum(V, P)
        R, T, V = (np.linalg.solve(half, part) for part in (R, T, V))
        found = self._fitted(R, window, T)
        if found is None or found.gain <= _LEAST_GAIN:
            return None
        freedom = len(R) - 1 - len(found.weights)
        limit = chi_squared_limit(freedom)
        if at_start and (found.cost > limit or not found.inside):
            return None
        J = np.column_stack([found.b_dot @ found.weights, found.b])  # d(b g)/d(age, g)
        spread_of = covariance_of(J)
        status = "ok" if found.cost <= limit else MISFIT
        event = Event(
            self._time(window, found), found.weights,
            math.sqrt(spread_of[0, 0]), np.sqrt(np.diag(spread_of)[1:]), status,
        )  # fmt: skip
        decision = self._with_state(event, found, R, J, spread_of, V, P)
        return replace(decision, cost=found.cost, freedom=freedom)

    def _with_state(
        self, event: Event, found: Impulse, R: Array, J: Array, spread_of: Array, V: Array,
        P: Array,
    ) -> Decision:  # fmt: skip
        """The covariance at the end of the window, and where asked the corrected state at t_o."""
        flow = expm(self.D * self.tau)
        state = self.curve.at(found.age)[: len(self.D)]  # e^{D age} H
        moves = np.column_stack([self.D @ state @ found.weights, state])
        correction = np.zeros(len(self.D))
        if self.state_correction:
            gain = P @ V.T
            correction = gain @ (R - found.b @ found.weights)
            P = P - gain @ gain.T
            moves = moves - flow @ gain @ J
        covariance = flow @ P @ flow.T + moves @ spread_of @ moves.T
        return Decision(event, found.age, correction, (covariance + covariance.T) / 2)
