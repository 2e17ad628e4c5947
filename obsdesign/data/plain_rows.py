"""Blocks of lines of a data file that hold numbers alone, read together.

Whatever these do not accept is read line by line, which says what is wrong with it; what they
accept has the same numbers there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.column_names import JUMP, RECEIVED, TIME, numbered
from obsdesign.data.layout import Layout
from obsdesign.entries import LARGEST
from obsdesign.errors import InputError
from obsdesign.runtime.columns import Columns

# of which a cell may be read otherwise than as it stands, or not at all
_SPECIAL = '"\0_'
# cells of a column `jump` of a plant without jumps
NO_JUMP = frozenset({"", "0", "0.0"})
# characters of a line, far below what a cell of a CSV file may have
_LONGEST_LINE = 2**16


@dataclass(frozen=True)
class PlainRows:
    """Where the columns of a layout stand in lines of `width` cells.

    unused: place of a column `jump` of a plant without jumps, which has to be zero.
    """

    layout: Layout
    places: Mapping[str, int]
    width: int
    unused: int | None

    @classmethod
    def from_header(
        cls, titles: Sequence[str], places: Mapping[str, int], layout: Layout
    ) -> PlainRows | None:
        """The places; None where a line has more to say than t, y, u, w and jump."""
        if layout.clocks is not None or layout.modes or RECEIVED in places:
            return None
        has_unused = not layout.jump and JUMP in titles
        return cls(layout, places, len(titles), titles.index(JUMP) if has_unused else None)

    def record(self, lines: Sequence[str], previous: float) -> Columns | None:
        """Rows of lines behind one of time `previous`; None unless each is a row in full."""
        if not _is_plain(lines):
            return None
        rows = [line.split(",") for line in lines]
        if set(map(len, rows)) != {self.width}:
            return None
        cells = list(zip(*rows, strict=True))
        try:
            return self._record(cells, previous)
        except (ValueError, InputError):
            return None

    def _record(self, cells: Sequence[Sequence[str]], previous: float) -> Columns:
        """The rows; ValueError or InputError where a line is none, or not in full."""
        t = self._complete(cells, TIME)
        self._check_times(t, previous)
        if self.unused is not None and not {*map(str.strip, cells[self.unused])} <= NO_JUMP:
            raise ValueError
        jump = np.zeros(len(t))
        if self.layout.jump:
            jump = self._complete(cells, JUMP)
            if not ((jump == 0.0) | (jump == 1.0)).all():
                raise ValueError
        happens = jump == 1.0
        y, u, w = (
            self._table(cells, letter, count)
            for letter, count in (("y", self.layout.y), ("u", self.layout.u), ("w", self.layout.w))
        )
        if u is not None and np.isnan(u).any():  # holds what came before
            raise ValueError
        if w is not None:
            if np.isnan(w[happens]).any():
                raise ValueError
            w = np.where(np.isnan(w), 0.0, w)  # of rows without a jump, which has no use for it
        return Columns(t, y, u, w, happens)

    def _check_times(self, t: Matrix, previous: float) -> None:
        """ValueError or InputError unless each row may follow the one before."""
        if self.layout.dt is not None:
            for now in t.tolist():
                self.layout.check_time(now, previous, "")
                previous = now
            return
        steps = np.diff(t, prepend=previous)
        if not (steps >= 0.0 if self.layout.may_repeat else steps > 0.0).all():
            raise ValueError

    def _complete(self, cells: Sequence[Sequence[str]], title: str) -> Matrix:
        """The numbers of a column (rows,); ValueError for a cell that is none."""
        values = np.array(list(map(float, cells[self.places[title]])))
        if not (np.abs(values) <= LARGEST).all():
            raise ValueError
        return values

    def _table(self, cells: Sequence[Sequence[str]], letter: str, count: int) -> Matrix | None:
        """The columns of a signal (rows, count), NaN where a cell is empty; None without any."""
        if not count:
            return None
        columns = []
        for title in numbered(letter, count):
            try:
                columns.append(self._complete(cells, title))
            except ValueError:
                columns.append(_with_gaps(cells[self.places[title]]))
        return np.column_stack(columns)


def _is_plain(lines: Sequence[str]) -> bool:
    """Are cells what stands between commas, and numbers what Python takes for them?"""
    text = "".join(lines)
    is_special = not text.isascii() or any(special in text for special in _SPECIAL)
    return not is_special and max(map(len, lines)) <= _LONGEST_LINE


def _with_gaps(cells: Sequence[str]) -> Matrix:
    """Numbers of cells (rows,), NaN where they are empty; ValueError for any other text."""
    stripped = list(map(str.strip, cells))
    values = np.array([float(cell) if cell else math.nan for cell in stripped])
    if not (np.abs(values) <= LARGEST)[[bool(cell) for cell in stripped]].all():
        raise ValueError
    return values
