"""Likelihood of onsets of an impulse in a window of few samples.

Of one window; the exact relation of samples, onset and weight is in `engine`. An impulse in the
cell that ends at row c moves the state there by v = e^{A (t_c - onset)} H g, and the scaled
innovations after it by linear functions of v. So two sums for each cell are sufficient statistics,

    score s_c = sum_k Psi_kc' innovation_k,      information I_c = sum_k Psi_kc' Psi_kc,

and the likelihood ratio of an onset is (v's)^2 / v'I v, v for weight 1: no covariance of a whole
window is formed, and another row costs the same however many there are.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.runtime.impulsive_input.samples.filter import Filtered, Row, SampledPlant, triangular
from obsdesign.runtime.impulsive_input.whitening import log_evidence
from obsdesign.runtime.state_marks import Axes
from obsdesign.runtime.step_cache import cached_step

ONSETS = 40  # per period of the samples
_REFINEMENTS = 12  # of the grid of onsets, tenfold each
_MAX_NEIGHBOUR_PROBABILITY = 0.95  # probability of three neighbours from which a grid is too coarse
_LEAST_SPREAD = 1e-8  # smallest deviation of a state kept, relative to its own one
_EQUAL_ULPS = 8  # times closer than this, of the largest of a window, are equal
_RATIO_ROUNDING = 8 * float(np.finfo(np.float64).eps)  # of a likelihood ratio, relative


def _slack(times: Matrix) -> float:
    """By how much equal times of a window may differ."""
    return _EQUAL_ULPS * float(np.spacing(np.abs(times).max()))


@dataclass(frozen=True)
class Grid:
    """Onsets (G,), the cell of each (G,), and e^{A (t_c - onset)} H (G, n), t_c the cell's end."""

    onsets: Annotated[Matrix, Axes("rows")]
    cell: Annotated[Indices, Axes("rows")]
    states: Annotated[Matrix, Axes("rows n")]

    @classmethod
    def empty(cls, n: int) -> Grid:
        """No onsets."""
        return cls(np.zeros(0), np.zeros(0, dtype=int), np.zeros((0, n)))

    def joined(self, onsets: Matrix, cell: int, states: Matrix) -> Grid:
        """With the onsets of one more cell."""
        return Grid(
            np.concatenate([self.onsets, onsets]),
            np.concatenate([self.cell, np.full(len(onsets), cell)]),
            np.concatenate([self.states, states]),
        )

    def without_first(self) -> Grid:
        """Without those of the first cell."""
        k = int(np.searchsorted(self.cell, 1))
        return Grid(self.onsets[k:], self.cell[k:] - 1, self.states[k:])

    def before(self, t: float) -> Grid:
        """Those that lie before a time; one at least."""
        k = max(int(np.searchsorted(self.onsets, t - _slack(np.append(self.onsets[:1], t)))), 1)
        return Grid(self.onsets[:k], self.cell[:k], self.states[:k])


@dataclass(frozen=True)
class Cells:
    """Statistics of an impulse in each cell between two rows of a window, N cells.

    ends (N,): times of rows; propagated (n, N, n): what is left in the filter now (first axis) of
    unit errors at a cell's end (last); information (N, n, n), score (N, n); costs: squares of all
    scaled innovations, one for each row; grid: onsets that are weighed at every step of the window.
    """

    ends: Annotated[Matrix, Axes("cells")]
    propagated: Annotated[Matrix, Axes("n cells n")]
    information: Annotated[Matrix, Axes("cells n n")]
    score: Annotated[Matrix, Axes("cells n")]
    costs: Annotated[Matrix, Axes("cells")]
    grid: Grid

    @classmethod
    def empty(cls, n: int) -> Cells:
        """A window that begins at a row, before the next one."""
        return cls(
            ends=np.zeros(0),
            propagated=np.zeros((n, 0, n)),
            information=np.zeros((0, n, n)),
            score=np.zeros((0, n)),
            costs=np.zeros(0),
            grid=Grid.empty(n),
        )

    def after(self, at: Filtered, opens: bool = True) -> Cells:
        """With one more row; `opens`: an onset in the cell before it is looked for."""
        n, propagated = len(at.x), at.flow @ self.propagated.reshape(len(at.x), -1)
        information, score, ends = self.information, self.score, self.ends
        if opens:
            propagated = np.hstack([propagated, np.eye(n)])
            information = np.concatenate([information, np.zeros((1, n, n))])
            score = np.concatenate([score, np.zeros((1, n))])
            ends = np.append(ends, at.row.t)
        slopes = (at.shown @ propagated).reshape(-1, len(ends), n)
        pairs = (slopes[:, :, :, None] * slopes[:, :, None, :]).sum(axis=0)
        return replace(
            self, ends=ends, propagated=(at.kept @ propagated).reshape(n, -1, n),
            information=information + pairs, score=score + np.tensordot(at.innovation, slopes, 1),
            costs=np.append(self.costs, at.cost),
        )  # fmt: skip

    def without_first(self) -> Cells:
        """The window that begins one row later."""
        return Cells(
            ends=self.ends[1:],
            propagated=self.propagated[:, 1:],
            information=self.information[1:],
            score=self.score[1:],
            costs=self.costs[1:],
            grid=self.grid.without_first(),
        )

    def cell_of(self, onsets: Matrix) -> Indices:
        """Index of the cell of each onset; one at a row belongs to the cell that ends there."""
        before = np.searchsorted(self.ends, onsets - _slack(self.ends))
        return np.minimum(before, len(self.ends) - 1)


@dataclass(frozen=True)
class Fit:
    """A posterior over onsets: probabilities, weights, their precision, likelihood ratios, (G,).

    cost: what the best of them leaves, to be compared with chi-squared.
    """

    grid: Grid
    probability: Matrix
    weights: Matrix
    precision: Matrix
    ratio: Matrix
    cost: float


@dataclass(frozen=True)
class OnsetModel:
    """Posterior of onsets; weights of every size are equally likely before (`log_evidence`)."""

    plant: SampledPlant
    nonnegative: bool
    _grids: OrderedDict[float, tuple[Matrix, Matrix]] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    def window(self, first: Filtered, rows: list[Row], until: float) -> Cells:
        """Cells of a window from `first` on; onsets are looked for up to a time."""
        cells, at = Cells.empty(len(first.x)), first
        for row in rows:
            opens = at.row.t < until
            at = self.plant.after(at, row)
            cells = cells.after(at, opens)
        return cells

    def gridded(self, cells: Cells, since: float, period: float) -> Cells:
        """The cells with a grid of onsets in the last one, which begins at `since`."""
        until, cell = float(cells.ends[-1]), len(cells.ends) - 1

        def build(width: float) -> tuple[Matrix, Matrix]:
            count = min(max(round(ONSETS * width / period), 1), ONSETS)
            late = width / count * np.arange(count, dtype=np.float64)
            return late, self.states(width - late)

        late, states = cached_step(self._grids, until - since, build)
        return replace(cells, grid=cells.grid.joined(since + late, cell, states))

    def states(self, ages: Matrix) -> Matrix:
        """e^{A age} H, (G, n)."""
        return np.asarray((expm(self.plant.A * ages[:, None, None]) @ self.plant.H)[..., 0])

    def grid_at(self, cells: Cells, onsets: Matrix) -> Grid:
        """Any onsets within the cells."""
        cell = cells.cell_of(onsets)
        return Grid(onsets, cell, self.states(np.maximum(cells.ends[cell] - onsets, 0.0)))

    def posterior(self, cells: Cells, grid: Grid) -> Fit:
        """Likelihood ratios, and the posterior for onsets that are evenly spaced.

        The likelihood of (onset, g) with eps_o ~ (0, P) part of the noise. Where ratios are so
        large that rounding changes them by more than one, noise counts as so much larger: onsets
        that they do not tell apart are equally likely.
        """
        cell, states = grid.cell, grid.states
        num = (cells.score[cell] * states).sum(axis=1)
        den = np.einsum("gij,gi,gj->g", cells.information[cell], states, states)
        if self.nonnegative:
            num = np.maximum(num, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(den > 0, num**2 / den, 0.0)
            usable = (den > 0) & ((num > 0) | (not self.nonnegative))
            rounding = max(1.0, _RATIO_ROUNDING * float(ratio.max()))
            log_p = np.where(usable, log_evidence(ratio / rounding, 1), -math.inf)
        p = np.exp(log_p - log_p.max()) if np.isfinite(log_p).any() else np.ones_like(log_p)
        weights = np.where(den > 0, num / np.where(den > 0, den, 1.0), 0.0)
        cost = float(cells.costs.sum() - ratio.max()) / rounding
        # of an onset that samples do not see, and that is ruled out, nothing may be left to sums
        precision = np.where(p > 0, den / rounding, math.inf)
        return Fit(
            grid=grid,
            probability=p / p.sum(),
            weights=weights,
            precision=precision,
            ratio=ratio,
            cost=cost,
        )

    def refined(self, cells: Cells, fit: Fit) -> Fit:
        """The posterior on finer and finer grids, while a few onsets hold all of it.

        No grid is finer than time stamps, whose rounding its step stands for.
        """
        for _ in range(_REFINEMENTS):
            top = int(np.argmax(fit.probability))
            if fit.probability[max(top - 1, 0) : top + 2].sum() < _MAX_NEIGHBOUR_PROBABILITY:
                break
            onsets = fit.grid.onsets
            low, high = onsets[max(top - 2, 0)], onsets[min(top + 2, len(onsets) - 1)]
            if high - low < ONSETS * math.ulp(abs(high)):
                break
            fit = self.posterior(cells, self.grid_at(cells, np.linspace(low, high, ONSETS + 1)))
        return fit

    def collapsed(
        self, fit: Fit, cells: Cells, first: Filtered, rows: list[Row]
    ) -> tuple[list[Matrix], Filtered]:
        """(means at `first` and the rows after it, the filter at the last), over the posterior.

        The filter is affine in what impulses do: it runs once more with their mean.
        """
        n, mean = len(first.x), fit.probability * fit.weights
        jumps = np.zeros((len(rows), n))
        np.add.at(jumps, fit.grid.cell, mean[:, None] * fit.grid.states)
        run, at, reach, score = [], first, np.eye(n), np.zeros(n)
        for row, jump in zip(rows, jumps, strict=True):
            at = self.plant.after(at, row, jump)
            spread = at.flow @ reach
            score = score + (at.shown @ spread).T @ at.innovation
            reach = at.kept @ spread
            run.append(at)
        x, since = first.x + first.P @ score, first.row
        means = [x]
        for there, jump in zip(run, jumps, strict=True):  # smoothed by all samples of the window
            forcing = self.plant.forcing(since.u)
            x = self.plant.free(since.t, x, forcing, there.row.t) + jump
            since = there.row
            means.append(x)
        onto = (cells.propagated[:, fit.grid.cell] * fit.grid.states).sum(
            axis=2
        )  # (n, G): d x / d g
        away = onto * fit.weights - (onto @ mean)[:, None]
        likely = np.sqrt(fit.probability)
        spread = np.hstack([onto * likely / np.sqrt(fit.precision), away * likely])
        factor = triangular(np.hstack([at.factor, spread]))
        # rounding must not leave it singular
        floor = _LEAST_SPREAD * np.linalg.norm(factor, axis=1)
        factor = triangular(np.hstack([factor, np.diag(floor)]))
        return [*means[:-1], at.x], Filtered.without_sample(at.row, at.x, factor)
