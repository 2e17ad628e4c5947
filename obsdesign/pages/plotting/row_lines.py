"""Lines through the rows of a record, broken where nothing is known between two rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix

# rows are too close for dots where more of them than these fill the time that is drawn
MOST_DOTS = 150
# so many times the usual distance of two rows is a gap of the record
_GAP = 10.0
# rows up to so many steps apart are neighbours in discrete time
_ONE_STEP = 1.5
# part of the rows above which rows with a sample or an event are most of them
_MOST = 0.5


@dataclass(frozen=True, eq=False)
class RowLines:
    """Which neighbouring rows a line joins, and where it steps.

    t (rows,): times, in order; instants: of events and of samples that do not come at every row;
    step: of discrete time, within which there is nothing, 0 where time is continuous.
    What a line shows changes there at once, and between two of them it is that of neither row:
    bounds are wider. So two such rows, the first row of all among them, are not joined, nor rows
    with a gap of the record between them, unless they are too close for dots. Where most rows are
    such, none are joined, or all.
    """

    t: Matrix
    instants: Matrix
    step: float = 0.0

    @cached_property
    def joined(self) -> NDArray[np.bool_]:
        """Is a row joined with the next, (rows - 1,)?"""
        apart = np.diff(self.t)
        if not apart.size:
            return np.zeros(0, bool)
        usual = float(np.median(apart))
        least = max((self.t[-1] - self.t[0]) / MOST_DOTS, _ONE_STEP * self.step)
        happens = np.isin(self.t, self.instants)
        happens[0] = True  # bounds start there
        unknown = happens[:-1] & happens[1:] & (apart > least)
        if happens.mean() > _MOST:
            unknown[:] = usual > least
        joined: NDArray[np.bool_] = ~(unknown | (apart > max(_GAP * usual, least)))
        return joined

    @cached_property
    def alone(self) -> NDArray[np.bool_]:
        """Is a row joined with none, (rows,)? It is drawn by itself."""
        return ~(np.append(self.joined, False) | np.insert(self.joined, 0, False))

    def pieces(self, series: Sequence[Matrix], steps: Matrix) -> tuple[Matrix, list[Matrix]]:
        """Times and values of lines through the rows, NaN between rows that are not joined.

        steps: times at which the value before is held up to the row and then steps.
        """
        behind = np.arange(1, len(self.t))
        stepping = self.joined & np.isin(self.t[1:], steps)
        at = np.concatenate([behind[stepping], behind[~self.joined]])
        order = np.argsort(at, kind="stable")
        held = np.concatenate([behind[stepping] - 1, np.full((~self.joined).sum(), -1)])[order]
        at = at[order]
        values = [np.where(held < 0, np.nan, own[held]) for own in series]
        lines = [np.insert(own, at, x) for own, x in zip(series, values, strict=True)]
        return np.insert(self.t, at, self.t[at]), lines
