"""Posterior over onsets of an impulse in a window, from its features as samples show them.

Between two samples time and weight of an onset may leave nearly the same, or exactly the same
where A H g stays in the span of H, while the next sample tells: a deviation linearised in the age
is then any number. So the likelihood is summed over a grid of onsets, wider while its ends still
count, and made finer in each valley of the cost where a few of them hold all of it: onsets in two
cells may explain as many numbers as are unknown alike. Weights of every size are equally likely
before (`log_prior`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.impulsive_input.event import Event, onset_statistics
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun
from obsdesign.runtime.impulsive_input.integral.window_noise import Responses, first_rows
from obsdesign.runtime.impulsive_input.whitening import Weighted, log_prior

_POINTS = 80  # of a grid of onsets
_CELLS = 2.0  # cells between samples on each side of the fit, at first
_REFINEMENTS = 12  # of the grid, tenfold each
_MAX_NEIGHBOUR_PROBABILITY = 0.8  # probability of three neighbours from which a grid is too coarse
_LEAST_SHARE = 1e-12  # of responses to several directions that a grid tells apart
_LEAST_RIDGE = 2.0  # twice the log-likelihood that a ridge between two valleys has above both
_NEGLECTED_RATIO = 40.0  # twice the log-likelihood by which the ends of a grid must be behind


@dataclass(frozen=True, kw_only=True, eq=False)
class Posterior:
    """Onsets (G,) that increase, each for a stretch of `steps` (G,), and their weights (G, q).

    log_density (G,): of an onset, up to a constant. cost (G,): what the best weights leave of the
    features, chi-squared; nothing: what they leave without an impulse.
    roots (G, q, q): F of the covariance F F' of weights at an onset; states (G, n, q): what unit
    weights leave of the error at the end of the window; b (G, r, q): in the features.
    """

    onsets: Matrix
    steps: Matrix
    log_density: Matrix
    cost: Matrix
    nothing: float
    weights: Matrix
    roots: Matrix
    states: Matrix
    b: Matrix

    @property
    def gain(self) -> float:
        """By how much the cost of the best onset is less than without an impulse."""
        return self.nothing - float(self.cost.min())

    @cached_property
    def probability(self) -> Matrix:
        """Of each onset, (G,)."""
        p = np.exp(self.log_density - self.log_density.max()) * self.steps
        return np.asarray(p / p.sum())

    @classmethod
    def joined(cls, parts: Sequence[Posterior]) -> Posterior:
        """Parts one after the other, of the same features."""
        return cls(
            nothing=parts[0].nothing,
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _BY_ONSET},
        )

    def part(self, of: slice) -> Posterior:
        """Some of the onsets."""
        return replace(self, **{name: getattr(self, name)[of] for name in _BY_ONSET})

    @property
    def weight(self) -> Matrix:
        """Mean of the weights, (q,)."""
        return np.asarray(self.probability @ self.weights)

    @property
    def weight_std(self) -> Matrix:
        """Deviations of the weights, (q,)."""
        own = (self.roots**2).sum(axis=2)
        return np.asarray(np.sqrt(self.probability @ ((self.weights - self.weight) ** 2 + own)))

    def error_covariance(self, gain: Matrix, left: Matrix) -> Matrix:
        """E[d d'], (n, n), of d = U g - left, U = states - gain b, at the end of the window.

        gain (n, r): of white features, the error that they make likely; left (n,): what was added
        to the estimate, less what `gain` makes of the features without any impulse.
        """
        U = self.states - gain @ self.b
        away = np.einsum("gnq,gq->gn", U, self.weights) - left
        spread = np.concatenate([away[:, :, None], U @ self.roots], axis=2)
        likely = spread * np.sqrt(self.probability)[:, None, None]
        columns = likely.transpose(1, 0, 2).reshape(len(gain), -1)
        return np.asarray(columns @ columns.T)


_BY_ONSET = tuple(f.name for f in fields(Posterior) if f.name != "nothing")


@dataclass(frozen=True, kw_only=True, eq=False)
class OnsetGrid:
    """Onsets in a window: times (rows,) since its first row, white features and their map.

    responses: to samples; youngest, oldest: ages that are searched.
    """

    run: FreeRun
    times: Matrix
    features: Weighted
    responses: Responses
    youngest: float
    oldest: float
    nonnegative: bool

    def posterior(self, onset: float) -> Posterior | None:
        """The posterior around a fitted onset; None where no onset there explains anything."""
        half = _CELLS * float(np.diff(self.times).max())
        ends, end = self._searched(onset), self.times[0] + self.run.tau
        ends = min(end - self.oldest, ends[0]), max(end - self.youngest, ends[1])
        while True:
            low, high = max(onset - half, ends[0]), min(onset + half, ends[1])
            posterior = self._at(low, high)
            if posterior is None:
                return None
            behind = posterior.cost - posterior.cost.min() > _NEGLECTED_RATIO
            if (low <= ends[0] or behind[0]) and (high >= ends[1] or behind[-1]):
                break
            half *= 2
        parts = [posterior.part(valley) for valley in valleys(posterior.cost)]
        return Posterior.joined([self._resolved(part) for part in parts])

    def _resolved(self, part: Posterior) -> Posterior:
        """A valley on a grid as fine as it is narrow."""
        ends = part.onsets[0] - part.steps[0] / 2, part.onsets[-1] + part.steps[-1] / 2
        for _ in range(_REFINEMENTS):
            top = int(np.argmax(part.log_density))
            onset, reach = part.onsets[top], 4 * part.steps[top]
            share = part.probability[max(top - 1, 0) : top + 2].sum()
            if share < _MAX_NEIGHBOUR_PROBABILITY or reach < _POINTS * np.spacing(abs(onset)):
                break
            finer = self._at(max(onset - reach, ends[0]), min(onset + reach, ends[1]))
            if finer is None:
                break
            part = finer
        return part

    def left_by(self, onset: float, weights: Matrix) -> Matrix:
        """What an impulse leaves of the error at the end of the window, (n,)."""
        return np.asarray(self._left(np.array([onset]))[1][0] @ weights)

    def _searched(self, onset: float) -> tuple[float, float]:
        """Ends of the cell between samples that holds a fitted onset."""
        c = first_rows(self.times, np.array([onset]), self.run.tau)[0]
        return float(self.times[c - 1]), float(self.times[c])

    def _left(self, onsets: Matrix) -> tuple[Matrix, Matrix]:
        """(b (G, r, q), states (G, n, q)) of impulses of weight 1."""
        raw, states = self.responses.impulses(self.run.gains, self.times, onsets)
        return self.features.T @ raw, states

    def _at(self, low: float, high: float) -> Posterior | None:
        """The posterior on an even grid, in the middles of its steps."""
        step = (high - low) / _POINTS
        onsets: Matrix = np.asarray(low + step * (np.arange(_POINTS) + 0.5), np.float64)
        b, states = self._left(onsets)
        Q, root = np.linalg.qr(b)
        size = np.abs(np.einsum("gqq->gq", root))
        usable = size.min(axis=1) > _LEAST_SHARE * size.max(axis=1)
        root[~usable] = np.eye(b.shape[2])
        R = self.features.R
        onto = np.einsum("grq,r->gq", Q, R)
        weights = np.linalg.solve(root, onto[:, :, None])[:, :, 0]
        if self.nonnegative:
            usable &= (weights >= 0).all(axis=1)
        if not usable.any():
            return None
        # a sum of squares left, no difference of large ones: rounding hides no likelihood
        cost = ((R - np.einsum("grq,gq->gr", Q, onto)) ** 2).sum(axis=1)
        cost, ratio = np.where(usable, cost, float(R @ R)), (onto**2).sum(axis=1)
        log_density = np.where(usable, -cost / 2 + log_prior(ratio, b.shape[2]), -math.inf)
        return Posterior(
            onsets=onsets, steps=np.full(_POINTS, step), log_density=log_density, cost=cost,
            nothing=float(R @ R), weights=weights, roots=np.linalg.inv(root), states=states, b=b,
        )  # fmt: skip


def valleys(cost: Matrix) -> list[slice]:
    """Parts of a row of costs (G,) with a valley each, by the ridges between them."""
    borders, low, high, ridge, is_falling = [0], cost[0], cost[0], 0, True
    for k, value in enumerate(cost.tolist()):
        if is_falling:
            low = min(low, value)
            if value > low + _LEAST_RIDGE:
                is_falling, high, ridge = False, value, k
        elif value >= high:
            high, ridge = value, k
        elif value < high - _LEAST_RIDGE:
            borders.append(ridge)
            is_falling, low = True, value
    return [slice(a, b) for a, b in pairwise([*borders, len(cost)])]


def expected(fit: Event, posterior: Posterior | None, since: float) -> Event:
    """The fit with the means of time and weights, and their deviations.

    since: the time from which onsets are counted; a stamp stands for its last digit.
    """
    if posterior is None:
        return fit
    age, spread = onset_statistics(posterior.onsets, posterior.probability, posterior.steps)
    t = since + age
    return replace(
        fit, t=t, weights=posterior.weight, t_std=math.hypot(spread, math.ulp(t) / math.sqrt(12)),
        weights_std=posterior.weight_std,
    )  # fmt: skip
