"""Step 2 at run time: an impulse from one window, with its deviations.

plain: the paper's (18). gls: the features are whitened, with the error e(t_o), of covariance P, and
the samples' noise through K as parts of the noise (`window_noise`). Both go beyond the paper.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.impulsive_input.curve import ImpulseCurve
from obsdesign.equations.impulsive_input.deviations import square_root
from obsdesign.equations.impulsive_input.features import (
    feature_scales,
    filtered_system,
    window_taps,
)
from obsdesign.equations.impulsive_input.fit import Impulse, fit_impulse, left_inverse
from obsdesign.equations.impulsive_input.gains import IntegralGains
from obsdesign.runtime.impulsive_input.event import FAINT, MISFIT, Event
from obsdesign.runtime.impulsive_input.integral.cells import CellFits
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun
from obsdesign.runtime.impulsive_input.integral.onsets import OnsetGrid, expected
from obsdesign.runtime.impulsive_input.integral.window_noise import Responses, WindowNoise
from obsdesign.runtime.impulsive_input.significance import is_significant
from obsdesign.runtime.impulsive_input.whitening import (
    Z_SCORE,
    Weighted,
    chi_squared_limit,
    raw_taps,
    whitening,
)

# plain, without noise: part of R that a fit may leave at the start of a search
_MAX_MISFIT_SHARE = 1e-3
# twice the log-likelihood by which an onset younger than the margin must be ahead: ages whose
# features are alike differ by less
_LEAST_LEAD = 2.0
# twice the log-likelihood by which an onset younger than the margin may be behind the best and
# count: a posterior that ends there is cut off (three deviations)
_MOST_LAG = 9.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """Result of a window: an event, the correction of the estimates, P after.

    fit: time and weights that explain the features best, which the estimate takes in; the event has
    their means. correction (rows, n): of the estimates of the window beside it. covariance: of the
    error at its last row, None without noise. cost, freedom: what the fit leaves of whitened
    features, chi-squared of so many degrees of freedom; 0 without.
    """

    event: Event
    fit: Event
    correction: Matrix | None = None
    covariance: Matrix | None = None
    cost: float = 0.0
    freedom: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """Rows from t_o on: times, y, residual and deviations of noise (rows, p), taps (rows, m).

    The last row may lie beyond the end of the window.
    """

    t: Matrix
    y: Matrix
    error: Matrix
    taps: Matrix
    spread: Matrix


@dataclass(frozen=True)
class Evaluator:
    """A free run, and what impulses of all ages leave in the features."""

    run: FreeRun
    curve: ImpulseCurve

    @classmethod
    def from_run(cls, run: FreeRun) -> Evaluator:
        """The evaluation of windows along a free run."""
        C, exponents, tau = run.gains.C, run.gains.exponents, run.tau
        scales = feature_scales(exponents, tau)
        D = flow_error_matrix(run.gains.A, run.gains.K, C)
        F = filtered_system(D, C, exponents, scales)
        return cls(run, ImpulseCurve.from_system(F, run.gains.H, tau))

    @property
    def gains(self) -> IntegralGains:
        """Gains of the design."""
        return self.run.gains

    @property
    def gls(self) -> bool:
        """Whether features are whitened."""
        return self.gains.weighting == "gls"

    @property
    def nonnegative(self) -> bool:
        """Whether weights are not negative."""
        return bool(self.gains.nonnegative)

    @cached_property
    def oldest(self) -> float:
        """Ages that are searched end here; the end of the window if that leaves none."""
        oldest = self.curve.oldest
        return oldest if oldest > self.gains.margin else self.run.tau

    def taps(self, times: Matrix) -> Matrix:
        """Psi (rows, m) of the window from times[0] on; the last row may lie beyond its end.

        Then the residual at the end of the window is interpolated.
        """
        end = times[0] + self.run.tau
        before, after = times[-2], times[-1]
        share = (end - before) / (after - before)
        if share > 1 - 1e-6:
            return self._scaled_taps(times)
        taps = self._scaled_taps(np.append(times[:-1], end))
        last = taps[-1].copy()
        taps[-1] = share * last
        taps[-2] += (1 - share) * last
        return taps

    def _scaled_taps(self, times: Matrix) -> Matrix:
        exponents = self.gains.exponents
        return window_taps(exponents, times) * feature_scales(exponents, self.run.tau)

    def responses(self, window: Window) -> Responses:
        """What states and samples of a window leave in its raw features and at its end."""
        return Responses.from_run(self.run, window.t, raw_taps(window.taps, self.gains.p))

    def plain(self, R: Matrix, window: Window, P: Matrix, at_start: bool) -> Decision | None:
        """Evaluate features R (p m,) of a window by the plain norm; None: nothing that counts.

        P (n, n): covariance of the error at t_o, which the fit does not count: deviations do, and
        whether there is an impulse at all. at_start: only a good fit counts.
        """
        noisy, root = bool(window.spread.any()), square_root(P)
        if noisy and not is_significant(self._fitted_in_noise(window, P)[1]):
            return None
        unit = window.spread if noisy else np.ones_like(window.spread)
        white, responses = whitening(window.taps, unit), self.responses(window)
        features = Weighted(R, np.eye(len(R)))
        alike = Weighted(white.features(window.error), white.T)
        impulse = self._fitted(window, responses, features, smooth=features.T, alike=alike)
        if impulse is None:
            return None
        if at_start:
            allowed = _MAX_MISFIT_SHARE**2 * float(R @ R)
            if noisy:
                sources = responses.sources(root, window.spread)
                N = sources.T @ sources
                allowed += float(np.trace(N)) + Z_SCORE * math.sqrt(2 * float((N * N).sum()))
            if impulse.cost > allowed or not impulse.inside:
                return None
        event = Event(t=self._time(window, impulse), weights=impulse.weights)
        if not noisy:
            return Decision(event=event, fit=event)
        back = self._plain_inverse(impulse)
        noise = WindowNoise.from_features(Weighted(back @ R, back), responses, root, window.spread)
        return self._decided(window, noise, event)

    def weighted(self, window: Window, P: Matrix, at_start: bool) -> Decision | None:
        """Evaluate whitened features of a window; P (n, n): covariance of the error at t_o."""
        noise, impulse = self._fitted_in_noise(window, P)
        if impulse is None or not is_significant(impulse):
            return None
        R = noise.features.R
        freedom = len(R) - 1 - len(impulse.weights)
        limit = chi_squared_limit(freedom)
        if at_start and (impulse.cost > limit or not impulse.inside):
            return None
        event = Event(
            t=self._time(window, impulse),
            weights=impulse.weights,
            doubts=() if impulse.cost <= limit else (MISFIT,),
        )
        correction = None
        if self.gains.state_correction:
            start, samples = noise.sources(R - impulse.b @ impulse.weights)
            correction = self.run.smoothing(window.t, start, samples)
        decision = self._decided(window, noise, event, correction)
        return replace(decision, cost=impulse.cost, freedom=freedom)

    def _fitted_in_noise(self, window: Window, P: Matrix) -> tuple[WindowNoise, Impulse | None]:
        """White features of a window, and the impulse that explains them best.

        None where an onset explains them better that is younger than the margin, or shown by the
        row behind the window alone, where the rule comes to it once more, older: `peak` does not.
        """
        noise = self.noise(window, P)
        smooth = noise.features.T @ whitening(window.taps, window.spread).T
        impulse = self._fitted(window, noise.responses, noise.features, smooth=smooth)
        if impulse is not None and self.gains.rule != "peak":
            younger = self._cells(window, noise.responses, noise.features).younger_gain
            impulse = None if younger > impulse.gain + _LEAST_LEAD else impulse
        return noise, impulse

    def may_be_younger(self, window: Window, P: Matrix) -> bool:
        """Whether an onset younger than the margin explains a window in noise about as well."""
        noise = self.noise(window, P)
        cells = self._cells(window, noise.responses, noise.features)
        return cells.younger_gain > cells.older_gain - _MOST_LAG

    def noise(self, window: Window, P: Matrix) -> WindowNoise:
        """White features of a window in noise; P (n, n): covariance of the error at t_o."""
        white = whitening(window.taps, window.spread)
        R = white.features(window.error)
        return WindowNoise.from_features(
            Weighted(R, np.eye(len(R))),
            Responses.from_run(self.run, window.t, white.taps),
            square_root(P),
            window.spread,
        )

    def _decided(
        self, window: Window, noise: WindowNoise, fit: Event, correction: Matrix | None = None
    ) -> Decision:
        """The decision with the posterior of the onset, and of the error it leaves."""
        since = float(window.t[0])  # time stamps may be too coarse for onsets
        grid = OnsetGrid(
            run=self.run, times=window.t - since, features=noise.features,
            responses=noise.responses, youngest=self.gains.margin, oldest=self.oldest,
            nonnegative=self.nonnegative,
        )  # fmt: skip
        posterior, after = grid.posterior(fit.t - since), noise.covariance()
        faint = not is_significant(posterior)
        if posterior is not None:
            left = grid.left_by(fit.t - since, fit.weights) - noise.gain @ noise.features.R
            left = left if correction is None else left + correction[-1]
            after = after + posterior.error_covariance(noise.gain, left)
        fit = replace(fit, doubts=(*fit.doubts, *([FAINT] if faint else [])))
        event = expected(fit, posterior, since)
        return Decision(event=event, fit=fit, correction=correction, covariance=after)

    def _plain_inverse(self, impulse: Impulse) -> Matrix:
        """J^+, (1 + q, p m): what the plain norm makes of features.

        J: of the smooth curve, which tells age from weights where those between two samples do not.
        """
        b = self.curve.value(impulse.age)
        J = np.column_stack([(self.curve.F @ b)[self.curve.n :] @ impulse.weights,
                             b[self.curve.n :]])  # fmt: skip
        return left_inverse(J)

    def _time(self, window: Window, impulse: Impulse) -> float:
        return float(window.t[0]) + self.run.tau - impulse.age

    def _fitted(
        self,
        window: Window,
        responses: Responses,
        features: Weighted,
        *,
        smooth: Matrix,
        alike: Weighted | None = None,
    ) -> Impulse | None:
        """The best impulse for the features; smooth (r, p m): them from raw ones.

        All onsets are fitted again as samples show them (`cells`). Features under the plain norm
        are nearly dependent; where to look is clearer in those that are `alike`, without that.
        """
        impulse = fit_impulse(
            features.R, self.curve, self.gains.margin, self.oldest,
            weighting=smooth, nonnegative=self.nonnegative,
        )  # fmt: skip
        if impulse is None:
            return None
        fits = self._cells(window, responses, features)
        likely = {int(np.searchsorted(window.t, self._time(window, impulse), "left"))}
        for each in (features,) if alike is None else (features, alike):
            likely |= fits.likely(each)
        best = fits.best(likely)
        return impulse if best is None else replace(best, inside=impulse.inside)

    def _cells(self, window: Window, responses: Responses, features: Weighted) -> CellFits:
        """Fits of onsets in the cells of a window."""
        return CellFits(
            run=self.run, t=window.t, features=features, onsets=responses.onsets,
            oldest=self.oldest, nonnegative=self.nonnegative,
        )  # fmt: skip
