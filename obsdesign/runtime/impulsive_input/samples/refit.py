"""Fit of an impulse whose window has fired, over every onset that its samples allow.

A strong impulse lies in the first cells of its window. A weak one is recognised late, when the
window has passed it, or early, while noise favours another cell. So the posterior covers every
cell that holds any of it, as far back as one impulse alone can have come: the shortest dwell time
before the end of the window. What it holds where that begins is a doubt.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.runtime.impulsive_input.samples.filter import Filtered, Row
from obsdesign.runtime.impulsive_input.samples.onset import ONSETS, Cells, Fit, Grid, OnsetModel

EARLIER = "may have come before the samples that are compared"
_MOST_ONSETS = 4000  # of a fit
_COARSE_ONSETS = 8  # per period, to leave out cells
_NEGLIGIBLE = 1e-6  # probability of the onsets that are left out, on each side
_LEAST_DOUBT = 1e-3  # of the posterior per period where it begins: there may be as much before it


@dataclass(frozen=True, slots=True)
class Refit:
    """The posterior over onsets after a row `start`, the rows after it, their cells.

    first: place of `start` among the rows that are known; period: of the samples.
    """

    first: int
    period: float
    start: Filtered
    rows: list[Row]
    cells: Cells
    fit: Fit

    @classmethod
    def over(
        cls, model: OnsetModel, known: tuple[Filtered, ...], covered: tuple[int, int], period: float
    ) -> Refit:
        """The posterior over all onsets that the rows allow.

        covered: rows between which onsets are in it in any case; period: of the samples.
        """
        times = np.array([at.row.t for at in known])
        low, high = _allowed(model, known, period)
        first = min(covered[0], int(np.searchsorted(times, low, side="right")) - 1)
        # an onset of a grid as coarse as the period may lie behind rows that are close together
        last = max(covered[1], min(int(np.searchsorted(times, high)), len(times) - 1))
        rows = [at.row for at in known[first + 1 :]]
        cells = model.window(known[first], rows, float(times[last]))
        grid = _grid(model, cells, float(times[first]), float(times[last]), period / ONSETS)
        fit = model.refined(cells, model.posterior(cells, grid))
        return cls(first, period, known[first], rows, cells, fit)

    @property
    def may_be_earlier(self) -> bool:
        """Whether onsets before all rows that are known would hold some of the posterior."""
        first, second = self.fit.grid.onsets[:2]
        density = self.fit.probability[0] / (second - first)
        is_open = self.first == 0 and first <= self.start.row.t
        return bool(is_open and density * self.period > _LEAST_DOUBT)


def _allowed(model: OnsetModel, known: tuple[Filtered, ...], period: float) -> tuple[float, float]:
    """The first and the last onset between which all of the posterior lies."""
    begin, end = known[0].row.t, known[-1].row.t
    cells = model.window(known[0], [at.row for at in known[1:]], end)
    fit = model.posterior(cells, _grid(model, cells, begin, end, period / _COARSE_ONSETS))
    p = fit.probability
    inside = np.flatnonzero(np.minimum(np.cumsum(p), np.cumsum(p[::-1])[::-1]) > _NEGLIGIBLE)
    return float(fit.grid.onsets[inside[0]]), float(fit.grid.onsets[inside[-1]])


def _grid(model: OnsetModel, cells: Cells, begin: float, end: float, step: float) -> Grid:
    """Onsets from one time to another; in a long stretch they are further apart."""
    step = max(step, (end - begin) / _MOST_ONSETS)
    count = max(round((end - begin) / step) - 1, 2)
    return model.grid_at(cells, begin + step * np.arange(count, dtype=np.float64))
