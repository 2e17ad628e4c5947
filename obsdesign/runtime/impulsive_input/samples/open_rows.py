"""Rows of operator `samples` from the window's start on, and the first of a record.

How large noise and states may be is taken from samples where a problem does not state it, and may
be known only after some rows: then the filter runs over them again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.impulsive_input.deviations import square_root
from obsdesign.equations.impulsive_input.gains import SamplesGains
from obsdesign.runtime.impulsive_input.initial import Initial, initial_sizes, largest_outputs
from obsdesign.runtime.impulsive_input.samples.filter import Filtered, Row
from obsdesign.runtime.impulsive_input.samples.live import SampledLive
from obsdesign.runtime.impulsive_input.samples.onset import Cells, OnsetModel
from obsdesign.runtime.impulsive_input.samples.steady_input import SteadyInputs
from obsdesign.runtime.impulsive_input.whitening import noise_deviation, noise_level

_AGES = 64  # of an impulse in a window, at which its states are looked at
_LEAST_RANGE_SAMPLES = 2  # of a window that shows a range of y


@dataclass(frozen=True)
class OpenRows:
    """Parameters: gains, and the model of a window."""

    gains: SamplesGains
    model: OnsetModel

    @cached_property
    def outputs(self) -> Matrix:
        """The largest outputs of it, (p,): units in which outputs are of like size.

        Of an output that no impulse reaches: its largest coefficient.
        """
        states = self.model.states(np.linspace(0.0, self.gains.window, _AGES + 1))[:, :, None]
        shown, C = largest_outputs(self.gains.C, states)[:, 0], self.gains.C
        units = np.where(shown > 0, shown, np.abs(C).max(axis=1))
        return np.where(units > 0, units, 1.0)

    def row(self, t: float, y: Matrix, u: Matrix, level: Matrix) -> Row:
        """A row with its deviations; level (p,): largest outputs so far."""
        if not np.isfinite(y).all():
            return Row(t, None, u, self.gains.noise_std)
        level = self.outputs * noise_level(level / self.outputs)
        return Row(t, y, u, noise_deviation(self.gains, y, level, np.abs(y)))

    def scaled(self, live: SampledLive, y: Matrix) -> SampledLive:
        """The state at the level of a further y; open rows at rest get their noise from the first.

        NaN: no measurement.
        """
        level = np.maximum(live.level, np.abs(y)) if np.isfinite(y).all() else live.level
        if live.level.any() or not level.any():
            return replace(live, level=level)
        rows = [
            at.row if at.row.y is None else self.row(at.row.t, at.row.y, at.row.u, level)
            for at in live.rows[1:]
        ]
        return self._filtered_again(replace(live, level=level), live.rows[0], rows)

    def _filtered_again(self, live: SampledLive, first: Filtered, rows: list[Row]) -> SampledLive:
        """The state with other open rows, before any impulse."""
        live = replace(
            live, rows=(first,), cells=Cells.empty(len(first.x)), before=(),
            steady=SteadyInputs.begin(first),
        )  # fmt: skip
        for row in rows:
            live = self.appended(live, row)
        return live

    def begun(self, initial: Initial, t: float, y: Matrix, u: Matrix) -> SampledLive:
        """The state at the first row."""
        plant, P = self.model.plant, initial.covariance
        x = plant.free(initial.t, initial.x, plant.forcing(initial.u), t)
        level = np.abs(self.gains.C @ x)
        level = np.maximum(level, np.abs(y)) if np.isfinite(y).all() else level
        row = self.row(t, y, u, level)
        factor = np.diag(self._guess(x, [row])) if P is None else square_root(P)
        at = plant.start(initial.t, initial.x, factor, initial.u, row)
        return SampledLive(
            rows=(at,),
            cells=Cells.empty(len(x)),
            steady=SteadyInputs.begin(at),
            level=level,
            first=t,
            guess=x if P is None else None,
        )

    def _guess(self, x: Matrix, rows: list[Row]) -> Matrix:
        """Deviations of a guess x at the first row: states that would explain the range of y."""
        y = np.array([row.y for row in rows if row.y is not None])
        size = self.outputs / 2
        if len(y):
            size = np.ptp(y, axis=0) + np.abs(y[0] - self.gains.C @ x) + rows[-1].spread
        return initial_sizes(self.model.plant, self.gains.window, size)

    def opened(self, live: SampledLive) -> SampledLive:
        """The state at its first window that holds samples: they show how large states may be.

        The first sample alone does not: a record may begin where y crosses zero.
        """
        first, *later = [at.row for at in live.rows]
        samples = sum(at.row.y is not None for at in live.rows)
        if live.guess is None or samples < _LEAST_RANGE_SAMPLES:
            return live
        factor = np.diag(self._guess(live.guess, [first, *later]))
        at = self.model.plant.start(first.t, live.guess, factor, first.u, first)
        return self._filtered_again(replace(live, guess=None), at, later)

    def appended(self, live: SampledLive, row: Row) -> SampledLive:
        """One more row in the window."""
        last = live.rows[-1]
        at = self.model.plant.after(last, row)
        cells = self.model.gridded(live.cells.after(at), last.row.t, self.gains.sample_period)
        return replace(live, rows=(*live.rows, at), cells=cells)

    def guess_after(self, live: SampledLive) -> Matrix | None:
        """The guess at the second open row, where deviations of the guess are still open."""
        if live.guess is None:
            return None
        plant, first = self.model.plant, live.rows[0].row
        return plant.free(first.t, live.guess, plant.forcing(first.u), live.rows[1].row.t)
