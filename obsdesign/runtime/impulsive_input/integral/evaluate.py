"""Step 2 at run time: an impulse from one window, with its deviations.

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

import numpy as np

from lmi.arithmetic.exponential import expm
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.gains import Array
from obsdesign.equations.impulsive_input.curve import ImpulseCurve
from obsdesign.equations.impulsive_input.features import (
    feature_scales,
    filtered_system,
    window_matrix,
    window_taps,
)
from obsdesign.equations.impulsive_input.fit import Impulse, explained, fit_impulse, peaks
from obsdesign.equations.impulsive_input.gains import IntegralGains
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

# gls: likelihood ratio of an impulse against none
_LEAST_GAIN = 36.0
# plain, without noise: part of R that a fit may leave at the start of a search
_MAX_MISFIT_SHARE = 1e-3


@dataclass(frozen=True, slots=True)
class Decision:
    """Result of a window: an event (None: no impulse), the correction at t_o, P after.

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


@dataclass(frozen=True, slots=True)
class _Whitened:
    """Features R (r,) of unit covariance, V (r, n) of the error at t_o, its covariance P."""

    R: Array
    V: Array
    P: Array


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

    @classmethod
    def from_gains(cls, gains: IntegralGains) -> Evaluator:
        """The evaluation of windows for a design's gains."""
        C, H, exponents, tau = gains.C, gains.H, gains.exponents, gains.window
        D = flow_error_matrix(gains.A, gains.K, C)
        scales = feature_scales(exponents, tau)
        F = filtered_system(D, C, exponents, scales)
        return cls(
            A=gains.A,
            D=D,
            C=C,
            H=H,
            exponents=exponents,
            tau=tau,
            margin=gains.margin,
            V=window_matrix(D, C, exponents, tau, scales),
            curve=ImpulseCurve.from_system(F, H, tau),
            gls=gains.weighting == "gls",
            state_correction=bool(gains.state_correction),
            nonnegative=bool(gains.nonnegative),
        )

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
        impulse = self._fitted(R, window, np.eye(len(R)), alike)
        if impulse is None:
            return None
        noisy = bool(window.spread.any())
        if at_start:
            allowed = _MAX_MISFIT_SHARE**2 * float(R @ R)
            if noisy:
                N = noise_covariance(window.taps, window.spread)
                allowed += float(np.trace(N)) + Z_SCORE * math.sqrt(2 * float((N * N).sum()))
            if impulse.cost > allowed or not impulse.inside:
                return None
        stds = plain_deviations(impulse, window.taps, window.spread) if noisy else (None, None)
        t = self._time(window, impulse)
        event = Event(t=t, weights=impulse.weights, t_std=stds[0], weights_std=stds[1])
        return Decision(
            event=event, age=impulse.age, correction=np.zeros(len(self.D)), covariance=None
        )

    def _time(self, window: Window, impulse: Impulse) -> float:
        return float(window.t[0]) + self.tau - impulse.age

    def _fitted(
        self,
        R: Array,
        window: Window,
        T: Array,
        whitened_features: tuple[Array, Array] | None = None,
    ) -> Impulse | None:
        """The best impulse for weighted features R, with b weighted by T.

        Samples of an impulse response, joined linearly, leave other features than the response
        itself, which matters where the output jumps with the impulse. So all onsets are fitted
        again as samples show them. Features under the plain norm are nearly dependent; where to
        look is clearer in `whitened_features`, features and T without that.
        """
        impulse = fit_impulse(
            R, self.curve, self.margin, self.oldest, weighting=T, nonnegative=self.nonnegative
        )
        if impulse is None:
            return None
        likely = {int(np.searchsorted(window.t, self._time(window, impulse), "left"))}
        pairs = [(R, T)] if whitened_features is None else [(R, T), whitened_features]
        for features, weighting in pairs:
            likely |= self._likely_cells(window, features, weighting)
        fits: dict[int, Impulse] = {}

        def cost_in(cell: int) -> float:
            if cell not in fits and 1 <= cell < len(window.t):
                there = self._in_cell(R, window, T, cell)
                if there is not None:
                    fits[cell] = there
            return fits[cell].cost if cell in fits else math.inf

        cost, cell = min((cost_in(c + step), c + step) for c in sorted(likely) for step in (0, 1))
        for step in (-1, 1):  # valleys are flat: go on while it goes down
            while cost_in(cell + step) < cost:
                cell += step
                cost = fits[cell].cost
        return replace(fits[cell], inside=impulse.inside) if cell in fits else impulse

    def _likely_cells(self, window: Window, features: Array, weighting: Array) -> set[int]:
        """Cells where an onset at the ends or in the middle explains the features best."""
        ages = window.t[0] + self.tau - window.t
        searched = (ages >= self.margin) & (ages <= self.oldest)
        cells = np.flatnonzero(searched & (np.arange(len(ages)) > 0))
        width = float(np.median(np.diff(window.t)))
        inside = expm(self.A * (width * np.array([0.0, 0.5, 1.0]))[:, None, None]) @ self.H
        likely: set[int] = set()
        for jump in inside:
            shown = weighting @ (window.onsets[cells] @ jump)
            gains = explained(shown, features, self.nonnegative)
            likely |= {int(cells[k]) for k in peaks(gains)}
        return likely

    def _in_cell(self, R: Array, window: Window, T: Array, cell: int) -> Impulse | None:
        """The best impulse with its onset between rows cell - 1 and cell."""
        t_c = float(window.t[cell])
        width = t_c - float(window.t[cell - 1])
        curve = ImpulseCurve.from_system(self.A, self.H, width, points=4, n=0)
        M = T @ window.onsets[cell]
        # an onset at the row before would be one that this row shows already
        impulse = fit_impulse(
            R, curve, 0.0, width * (1 - 1e-6), weighting=M, nonnegative=self.nonnegative
        )
        if impulse is None:
            return None
        return replace(impulse, age=float(window.t[0]) + self.tau - t_c + impulse.age)

    def _weighted(self, window: Window, P: Array, at_start: bool) -> Decision | None:
        R, T = whitened(window.taps, window.error, window.spread)
        V = T @ self.V
        half = root_of_sum(V, P)
        R, T, V = (np.linalg.solve(half, part) for part in (R, T, V))
        impulse = self._fitted(R, window, T)
        if impulse is None or impulse.gain <= _LEAST_GAIN:
            return None
        freedom = len(R) - 1 - len(impulse.weights)
        limit = chi_squared_limit(freedom)
        if at_start and (impulse.cost > limit or not impulse.inside):
            return None
        J = np.column_stack([impulse.b_dot @ impulse.weights, impulse.b])  # d(b g)/d(age, g)
        spread_of = covariance_of(J)
        event = Event(
            t=self._time(window, impulse),
            weights=impulse.weights,
            t_std=math.sqrt(spread_of[0, 0]),
            weights_std=np.sqrt(np.diag(spread_of)[1:]),
            doubts=() if impulse.cost <= limit else (MISFIT,),
        )
        white = _Whitened(R, V, P)
        decision = self._decision(event, impulse, white, J, spread_of)
        return replace(decision, cost=impulse.cost, freedom=freedom)

    def _decision(
        self, event: Event, impulse: Impulse, white: _Whitened, J: Array, spread_of: Array
    ) -> Decision:
        """The covariance at the end of the window; with `state_correction` the state at t_o.

        J: derivatives of b g by age and g; spread_of: covariance of both.
        """
        P = white.P
        flow = expm(self.D * self.tau)
        state = self.curve.value(impulse.age)[: len(self.D)]  # e^{D age} H
        moves = np.column_stack([self.D @ state @ impulse.weights, state])
        correction = np.zeros(len(self.D))
        if self.state_correction:
            gain = P @ white.V.T
            correction = gain @ (white.R - impulse.b @ impulse.weights)
            P = P - gain @ gain.T
            moves = moves - flow @ gain @ J
        covariance = flow @ P @ flow.T + moves @ spread_of @ moves.T
        covariance = (covariance + covariance.T) / 2
        return Decision(event=event, age=impulse.age, correction=correction, covariance=covariance)
