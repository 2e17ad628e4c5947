"""Noise of the windows along a record, by which a search judges |R| and its parts.

Proportional noise changes with the outputs, by decades where a record begins at rest or impulses
die out. So the map that makes features white, and the deviation of |R|, are made again where the
noise of a window differs much from that for which they were; in between they are scaled. What
rounding leaves of the features counts as noise too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Array, Indices, Matrix
from obsdesign.equations.impulsive_input.deviations import square_root
from obsdesign.runtime.impulsive_input.integral.covariance import propagated
from obsdesign.runtime.impulsive_input.integral.evaluate import Evaluator, Window
from obsdesign.runtime.impulsive_input.integral.free_run import Track
from obsdesign.runtime.impulsive_input.integral.matched_filter import MatchedFilter
from obsdesign.runtime.impulsive_input.integral.search import Position
from obsdesign.runtime.impulsive_input.integral.window_noise import Responses
from obsdesign.runtime.impulsive_input.whitening import least_cv, noise_level, whitening
from obsdesign.runtime.state_marks import Outputs

_SCALED = 16.0  # ratio of variances up to which noise is scaled
_STEADY_WINDOWS = 20.0  # after which noise alone is left in the error of the state
_ROUNDING = 1e-14  # of features, by the running integrals they are differences of


class Scores(NamedTuple):
    """Of windows, (k,) each: values of a search, their deviations, those of a matched filter."""

    values: Matrix
    sigmas: Matrix
    matched: Matrix


@dataclass(frozen=True, slots=True)
class NoiseLevel:
    """Noise of a window whose samples have the mean variances (p,).

    sigma: deviation of |R|; position: the values by which position is judged, if it is; matched:
    what |R| does not show, where the rule is `peak`.
    """

    variances: Outputs
    sigma: float
    position: Position | None
    matched: MatchedFilter | None

    def reaches(self, variances: Matrix) -> Array:
        """Whether scaling does for windows of variances (k, p), (k,)."""
        ratio = variances / self.variances
        return np.asarray(((ratio <= _SCALED) & (ratio * _SCALED >= 1)).all(axis=1))

    def scored(self, R: Matrix, variances: Matrix, oldest: Matrix) -> Scores:
        """Values of a search for R (k, p m), variances (k, p); oldest (k,): admissible ages."""
        scale = np.sqrt((variances / self.variances).max(axis=1))
        if self.position is not None:
            return Scores(self.position.values(R) / scale, np.ones(len(R)), np.zeros(len(R)))
        matched = np.zeros(len(R))
        if self.matched is not None:
            matched = self.matched.deviations(R / scale[:, None], oldest)
        return Scores(np.linalg.norm(R, axis=1), self.sigma * scale, matched)


@dataclass(frozen=True)
class Whitener:
    """Noise levels of windows, by what an evaluator makes of them."""

    evaluator: Evaluator

    def variances(self, track: Track, first: int, last: int) -> Matrix:
        """Mean variances of the samples of windows that begin at rows first .. last - 1, (k, p)."""
        gains = self.evaluator.gains
        ends = np.searchsorted(track.t, track.t[first:last] + gains.window, side="right")
        counts = np.minimum(ends, len(track.t)) - np.arange(first, last)
        squares = sums_from(track.y[first:] ** 2, counts) / counts[:, None]
        level = noise_level(np.sqrt(squares))
        return np.asarray(gains.noise_std**2 + (least_cv(gains) * level) ** 2)

    def level(self, window: Window, variances: Matrix) -> NoiseLevel:
        """The noise of a window."""
        evaluator, n = self.evaluator, self.evaluator.gains.n
        responses = evaluator.responses(window)
        noise = responses.sources(np.zeros((n, n)), window.spread)
        position, matched, rule = None, None, evaluator.gains.rule
        if rule == "position":
            position = self._position(window, responses, self._whitening(window, responses))
        if rule == "peak":
            ages = MatchedFilter.compared(evaluator.curve.ages[1:], evaluator.oldest)
            matched = MatchedFilter.from_curve(
                self._whitening(window, responses), ages,
                self._shown(window, responses, ages), evaluator.nonnegative,
            )  # fmt: skip
        return NoiseLevel(variances, float(np.linalg.norm(noise, 2)), position, matched)

    def exact_position(self, window: Window) -> tuple[Position, float]:
        """The values for y that is exact, and what the output itself leaves in them."""
        T = whitening(window.taps, np.ones_like(window.spread)).T
        own = T @ (window.taps.T @ window.y).T.reshape(-1)
        position = self._position(window, self.evaluator.responses(window), T)
        return position, float(np.linalg.norm(own))

    def _position(self, window: Window, responses: Responses, T: Matrix) -> Position:
        """The values by which position is judged, features made white by T."""
        ages = self.evaluator.curve.ages[1:]
        b = self._shown(window, responses, ages)
        return Position.from_curve(T, ages, b, self.evaluator.oldest)

    def _shown(self, window: Window, responses: Responses, ages: Matrix) -> Matrix:
        """Raw features (G, p m, q) of impulses of weight 1 and ages (G,), as samples show them.

        Where K copies what one sensor shows into the residual of another that is all but exact,
        their difference to smooth responses stands out of its noise.
        """
        onsets = window.t[0] + self.evaluator.run.tau - ages
        return responses.impulses(self.evaluator.gains, window.t, onsets)[0]

    def _whitening(self, window: Window, responses: Responses) -> Matrix:
        """T (r, p m): white with the noise that K makes of earlier samples, and with rounding."""
        evaluator, n, spread = self.evaluator, self.evaluator.gains.n, window.spread
        steady = _STEADY_WINDOWS * evaluator.run.tau
        P = propagated(evaluator.run, np.zeros((n, n)), steady, window.t, spread)
        T = whitening(window.taps, spread).T
        noise = responses.sources(square_root(P), spread)
        size = (np.abs(window.taps.T) @ np.abs(window.y)).T.reshape(-1)
        upper = np.linalg.qr(np.vstack([noise, np.diag(_ROUNDING * size)]) @ T.T)[1]
        return np.asarray(np.linalg.solve(upper.T, T))


def sums_from(values: Matrix, counts: Indices) -> Matrix:
    """Sums (k, p) of as many rows as counts (k,) says, from rows 0 .. k - 1 of values on.

    By sums of 1, 2, 4, ... rows: no difference of running sums, in which an outlier would leave its
    rounding for ever, and the same whatever rows are before and behind.
    """
    sums, at, size = np.zeros((len(counts), values.shape[1])), np.arange(len(counts)), 1
    while size <= counts.max(initial=0):
        used = (counts & size) > 0
        sums[used] += values[at[used]]
        at[used] += size
        values, size = values[:-size] + values[size:], 2 * size
    return sums
