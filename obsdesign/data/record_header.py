"""The header of a data file: where its columns stand, and what a line below it says."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array
from obsdesign.column_names import MODE, RECEIVED, TRUTH, numbered
from obsdesign.data.arrivals import Remark
from obsdesign.data.bound_columns import BoundColumns, number_in, remark_on_unused_bounds
from obsdesign.data.clock_columns import ClockColumns
from obsdesign.data.csv_lines import cells_of, columns_titled
from obsdesign.data.layout import Layout
from obsdesign.data.plain_rows import NO_JUMP, PlainRows
from obsdesign.errors import InputError
from obsdesign.runtime.base import Sample
from obsdesign.runtime.clocks.time_stamps import time_tolerance

# columns of simulations, which observers do not read
_OF_TRUTH = re.compile(rf"[{''.join(TRUTH)}]\d+")


@dataclass(frozen=True)
class Header:
    """The columns of a data file, and where those of the layout stand among them."""

    titles: list[str]
    places: dict[str, int]
    layout: Layout
    name: str
    bounds: BoundColumns | None

    @classmethod
    def from_line(cls, line: str, layout: Layout, name: str) -> Header:
        """The columns that a first line names; InputError where one is missing."""
        written = cells_of(line, f"{name} line 1", name)
        titles = columns_titled(written, layout.titles)
        if not titles:
            raise InputError(
                f"{name}: a header line with column 't', ... is required; the file is empty."
            )
        places = _places(titles, written, layout, name)
        bounds = None
        if layout.bounds is not None:
            bounds = BoundColumns(layout.bounds, places, layout.unused)
        return cls(titles, places, layout, name, bounds)

    @property
    def may_be_late(self) -> bool:
        """May a row arrive after rows of later times?"""
        return self.layout.lag > 0 or RECEIVED in self.places

    def time(self, line: str) -> float:
        """The time of a line that is no row; NaN where it cannot be read."""
        try:
            t = number_in(cells_of(line, "", ""), self.places, "t", "")
        except (InputError, IndexError):
            return math.nan
        return math.nan if t is None else t

    @property
    def plain(self) -> PlainRows | None:
        """How lines are read together; None where rows have bounds of their own, or names."""
        if self.bounds is not None and self.bounds.titles:
            return None
        return PlainRows.from_header(self.titles, self.places, self.layout)

    def row(self, number: int, line: str, previous: float, *, is_first: bool) -> Sample | None:
        """The sample of a line, None for an empty line; InputError as for `sample`."""
        where = f"{self.name} line {number}"
        cells = cells_of(line, where, self.name)
        if not cells or all(not cell.strip() for cell in cells):
            return None
        return self.sample(cells, where, previous, is_first=is_first)

    def sample(self, cells: list[str], where: str, previous: float, *, is_first: bool) -> Sample:
        """The sample of a line; InputError if it is none, or not after the time `previous`."""
        if len(cells) != len(self.titles):
            hint = " Is the decimal sign a comma?" if len(cells) > len(self.titles) else ""
            raise InputError(
                f"{where}: {len(self.titles)} values are required, one per column; "
                f"got {len(cells)}.{hint}"
            )
        sample = _sample(cells, self.places, self.layout, where)
        if is_first and not self.may_be_late:
            self.layout.first_row.require(sample, where)
        if self.bounds is not None and self.bounds.titles:
            sample = sample._replace(bounds=self.bounds.of_row(cells, where))
        if self.layout.clocks is None and not self.layout.jump and "jump" in self.titles:
            unused = cells[self.titles.index("jump")].strip()
            if unused not in NO_JUMP:
                raise InputError(
                    f"{where}: jump must be 0, since the design's plant has no [jump]; got "
                    f"{unused!r}. Is it the data of another plant?"
                )
        self.layout.check_time(sample.t, previous, where)
        return sample

    def remark_on_unused(self, remark: Remark) -> None:
        """Remarks on columns of outputs beyond those of the plant, and of bounds nobody uses."""
        if self.layout.clocks is not None:
            self._remark_on_unknown(self.layout.clocks, remark)
        else:
            self._remark_on_more_outputs(remark)
        remark_on_unused_bounds(self.titles, self.layout.bounds, self.name, remark)
        if self.bounds is not None:
            self.bounds.remark_on_folded(self.name, remark, self.layout.unused)

    def _remark_on_more_outputs(self, remark: Remark) -> None:
        """A remark on columns of outputs beyond those of the plant."""
        known = {*self.layout.columns(), *self.layout.optional}
        more = [x for x in self.titles if re.fullmatch(r"y[1-9]\d*", x) and x not in known]
        if more:
            outputs = f"{self.layout.y} output{'s' * (self.layout.y != 1)}"
            remark(
                f"{self.name}: {', '.join(more)} of the header are not used, since the design's "
                f"plant has {outputs}. Is it the data of another plant?"
            )

    def _remark_on_unknown(self, clocks: ClockColumns, remark: Remark) -> None:
        """A remark on columns that look like those of events and sensors, and are of none."""
        if more := clocks.unknown(self.titles):
            names = ", ".join([*clocks.events, *clocks.sensors])
            remark(
                f"{self.name}: {', '.join(more)} of the header are not used, since the events and "
                f"sensors of the design's plant are {names}."
            )


def _places(header: list[str], written: list[str], layout: Layout, name: str) -> dict[str, int]:
    """Where the columns of a layout stand in a header; written: its titles as the file has them."""
    required = layout.columns(header)
    for title in required:
        if title not in header:
            titles = ", ".join(each.strip() for each in written)
            others = [other for other, column in layout.titles.items() if column == title]
            hint = ""
            if len(header) == 1 and re.search(r"[;\t|]", titles):
                hint = " Columns are separated by commas."
            elif title.lower() in [name.lower() for name in header]:
                hint = " Names of columns are in small letters."
            elif slips := _unknown_columns(layout, required):
                hint = f" --rename names a column {slips[0]!r}, which the plant's data do not have."
            known = " or ".join(map(repr, [title, *others]))
            raise InputError(f"{name}: column {known} is required; the header has {titles}.{hint}")
    for title in dict.fromkeys((*required, *layout.optional)):
        if header.count(title) > 1:
            raise InputError(
                f"{name}: column {title!r} stands {header.count(title)} times in the header."
            )
    optional = [title for title in layout.optional if title in header]
    return {title: header.index(title) for title in (*required, *optional)}


def _unknown_columns(layout: Layout, required: Sequence[str]) -> list[str]:
    """What titles are to stand for, and is neither a column of the plant nor of the truth."""
    known = {*required, *layout.optional}
    return [x for x in layout.titles.values() if x not in known and not _OF_TRUTH.fullmatch(x)]


def _sample(cells: list[str], places: dict[str, int], layout: Layout, where: str) -> Sample:
    def number(title: str) -> float | None:
        return number_in(cells, places, title, where)

    def group(letter: str, size: int) -> list[float | None]:
        return [number(title) for title in numbered(letter, size)]

    def whole(letter: str, size: int) -> Array | None:
        values = group(letter, size)
        return None if not values or None in values else np.array(values, dtype=np.float64)

    t = number("t")
    if t is None:
        raise InputError(f"{where}: t must be a finite number; it is empty.")
    mode = _mode(cells, places, layout, where)
    if layout.clocks is not None:
        row = layout.clocks.of_row(cells, places, where)
        u, happens = whole("u", layout.u), bool(row.events)
        if row.received is not None and row.received < t - time_tolerance(abs(t), t):
            raise InputError(
                f"{where}: {RECEIVED} must be at least t, {t!r}; got {row.received!r}. Does it "
                "hold times, and not delays?"
            )
        return Sample(t, row.y, u, row.w, happens, events=row.events, received=row.received,
                      mode=mode)  # fmt: skip
    jump = number("jump") if layout.jump else 0.0
    if jump not in (0.0, 1.0):
        raise InputError(f"{where}: jump must be 0 or 1; got {cells[places['jump']]!r}.")
    w = whole("w", layout.w)
    if jump and layout.w and w is None:
        raise InputError(f"{where}: w1 is required at a jump; it is empty.")
    outputs = group("y", layout.y)
    is_missing = all(value is None for value in outputs)
    y = None if is_missing else np.array(outputs, dtype=np.float64)  # NaN for an empty entry
    return Sample(t, y, whole("u", layout.u), w, bool(jump), mode=mode)


def _mode(cells: list[str], places: dict[str, int], layout: Layout, where: str) -> str | None:
    """The mode that a line names; None where it is empty, or the plant has no modes."""
    name = cells[places[MODE]].strip() if layout.modes else ""
    if name and name not in layout.modes:
        known = ", ".join(layout.modes)
        raise InputError(f"{where}: mode must be one of {known}, or empty; got {name!r}.")
    return name or None
