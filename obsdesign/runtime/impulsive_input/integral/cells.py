"""Fits of an impulse whose onset lies in a cell between two samples, as samples show it.

Samples of an impulse response, joined linearly, leave other features than the response itself,
which matters where the output jumps with the impulse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array, Indices, Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.equations.impulsive_input.curve import ImpulseCurve
from obsdesign.equations.impulsive_input.fit import Impulse, explained, fit_impulse, peaks
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun
from obsdesign.runtime.impulsive_input.whitening import Weighted

# part of R that an impulse younger than the margin may leave: b goes to zero there, and noise looks
# like an impulse of any weight
_EXACT_SHARE = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class CellFits:
    """Features of a window with rows at t (rows,), and what onsets leave in them.

    onsets (rows, p m, n): of unit states that appear at a row; oldest: age where the search ends.
    """

    run: FreeRun
    t: Matrix
    features: Weighted
    onsets: Matrix
    oldest: float
    nonnegative: bool

    def best(self, cells: set[int]) -> Impulse | None:
        """The best impulse downhill from some cells, no younger than the margin unless exact."""
        impulse, R, margin = self._descended(cells, 0.0), self.features.R, self.run.gains.margin
        if impulse is None or impulse.age >= margin:
            return impulse
        is_exact = impulse.cost <= _EXACT_SHARE**2 * float(R @ R)
        return impulse if is_exact else self._descended(cells, margin)

    def likely(self, features: Weighted) -> set[int]:
        """Cells where an onset at the ends or in the middle explains the features best."""
        ages = self._ages
        cells = self._cells((ages >= self.run.gains.margin) & (ages <= self.oldest))
        shown = self._explained(features, cells)
        return {int(cells[k]) for gains in shown for k in peaks(gains)}

    @property
    def younger_gain(self) -> float:
        """Most that an onset explains of R younger than the margin, or behind the window.

        The best cell is refined: of an impulse far above the noise onsets within it differ by more.
        """
        cells = self._cells(self._ages < self.run.gains.margin)
        shown = self._explained(self.features, cells)
        likely = {int(cells[np.argmax(gains)]) for gains in shown if len(gains)}
        fits = [self._in_cell(cell, 0.0) for cell in likely]
        refined = max((fit.gain for fit in fits if fit is not None), default=0.0)
        return max(refined, *(float(gains.max(initial=0.0)) for gains in shown))

    @property
    def older_gain(self) -> float:
        """Most that an onset of the ages that are searched explains of R, of those compared."""
        ages = self._ages
        cells = self._cells((ages >= self.run.gains.margin) & (ages <= self.oldest))
        shown = self._explained(self.features, cells)
        return max(float(gains.max(initial=0.0)) for gains in shown)

    @property
    def _ages(self) -> Matrix:
        """Of onsets at the rows, at the end of the window; that of a row behind it is negative."""
        return np.asarray(self.t[0] + self.run.tau - self.t)

    def _cells(self, among: Array) -> Indices:
        """Rows that end a cell, of those that are `among` (rows,)."""
        return np.flatnonzero(among & (np.arange(len(self.t)) > 0))

    def _explained(self, features: Weighted, cells: Indices) -> list[Matrix]:
        """What onsets at the ends, in the middles, at the starts of cells explain of features."""
        gains, width = self.run.gains, float(np.median(np.diff(self.t)))
        inside = expm(gains.A * (width * np.array([0.0, 0.5, 1.0]))[:, None, None]) @ gains.H
        return [
            explained(features.T @ (self.onsets[cells] @ jump), features.R, self.nonnegative)
            for jump in inside
        ]

    def _descended(self, cells: set[int], youngest: float) -> Impulse | None:
        """The best of some cells, those after them, and those where it still goes down."""
        fits: dict[int, Impulse | None] = {}

        def cost_in(cell: int) -> float:
            if cell not in fits:
                fits[cell] = self._in_cell(cell, youngest) if 1 <= cell < len(self.t) else None
            fit = fits[cell]
            return math.inf if fit is None else fit.cost

        cost, cell = min((cost_in(c + step), c + step) for c in sorted(cells) for step in (0, 1))
        for step in (-1, 1):  # valleys are flat: go on while it goes down
            while cost_in(cell + step) < cost:
                cell += step
                cost = cost_in(cell)
        return fits[cell]

    def _in_cell(self, cell: int, youngest: float) -> Impulse | None:
        """The best impulse between rows cell - 1 and cell, no younger than an age."""
        t_c, gains = float(self.t[cell]), self.run.gains
        width, age = t_c - float(self.t[cell - 1]), float(self.t[0]) + self.run.tau - t_c
        # an onset at the row before would be one that this row shows already
        ends = max(youngest - age, 0.0), width * (1 - 1e-6)
        if ends[0] >= ends[1]:
            return None
        curve = ImpulseCurve.from_system(gains.A, gains.H, width, points=4, n=0)
        impulse = fit_impulse(
            self.features.R, curve, *ends,
            weighting=self.features.T @ self.onsets[cell], nonnegative=self.nonnegative,
        )  # fmt: skip
        return None if impulse is None else replace(impulse, age=age + impulse.age)
