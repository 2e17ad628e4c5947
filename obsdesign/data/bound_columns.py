"""Columns b1_lo, b1_hi, ..., c1_lo, ..., v1_lo, ... of a data file: bounds of a row."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.column_names import BOUNDED, ENDS, SIGNALS
from obsdesign.entries import LARGEST, number_from_text, shown
from obsdesign.errors import InputError, naming
from obsdesign.runtime.bounds import Bounds, DeclaredBounds

_TITLE = rf"[{''.join(BOUNDED)}][1-9]\d*_({'|'.join(ENDS)})"


@dataclass(frozen=True)
class BoundColumns:
    """Declared bounds, and where the columns of a file that narrow them are.

    unused: letters of bounds that stay as declared.
    """

    declared: DeclaredBounds
    places: Mapping[str, int]
    unused: str = ""

    @cached_property
    def titles(self) -> tuple[str, ...]:
        """Columns that the file has and that are used."""
        columns = self.declared.columns
        return tuple(x for x in columns if x in self.places and x[0] not in self.unused)

    def of_row(self, cells: Sequence[str], where: str) -> Bounds | None:
        """Bounds of a row; None if all are as declared. InputError if they are not inside these."""
        values = {title: number_in(cells, self.places, title, where) for title in self.titles}
        given = {title: value for title, value in values.items() if value is not None}
        pairs: dict[str, tuple[Matrix, Matrix]] = {}
        for box in self.declared.boxes:
            if not any(title in given for title in box.columns):
                continue
            ends = np.array([given.get(title, math.nan) for title in box.columns]).reshape(-1, 2)
            with naming(where, ValueError):
                pairs[box.name] = box.completed((ends[:, 0], ends[:, 1]))
        return Bounds(**pairs) if pairs else None

    def where_lines_are_skipped(self, name: str, remark: Callable[[str], None]) -> BoundColumns:
        """The columns less those of b, with a remark: a skipped line may be one that widens it."""
        if flow := [title for title in self.titles if title.startswith("b")]:
            remark(
                f"{name}: {', '.join(flow)} are not used with --skip-bad, since a line that is "
                "skipped may have changed them; the declared bounds of b hold."
            )
        return replace(self, unused=self.unused + "b")

    def remark_on_folded(self, name: str, remark: Callable[[str], None], letters: str) -> None:
        """A remark on the columns of these letters: they are of w, and this kind knows b or c."""
        columns = self.declared.columns
        if titles := [x for x in columns if x in self.places and x[0] in letters]:
            remark(
                f"{name}: {', '.join(titles)} are not used: with a disturbance_matrix they bound "
                "w, with d_bounds b without D d, and this kind uses the box around all of it."
            )


def remark_on_unused_bounds(
    titles: Sequence[str], declared: DeclaredBounds | None, name: str,
    remark: Callable[[str], None],
) -> None:  # fmt: skip
    """A remark if there are columns of bounds that are not used."""
    known = () if declared is None else declared.columns
    more = [title for title in titles if re.fullmatch(_TITLE, title) and title not in known]
    if more:
        why = "this kind uses no bounds of rows"
        if declared is not None:
            why = f"the design's plant has {', '.join(known)}"
        remark(f"{name}: {', '.join(more)} of the header are not used: {why}.")


def number_in(
    cells: Sequence[str], places: Mapping[str, int], title: str, where: str
) -> float | None:
    """The number in a column of a line; None where the cell is empty."""
    text = cells[places[title]].strip()
    if not text:
        return None
    try:
        value = number_from_text(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST:
        empty = " or empty" if title[0] in (*SIGNALS, *BOUNDED) else ""
        what = "a finite number" if not math.isfinite(value) else f"at most {LARGEST:g} in size"
        raise InputError(f"{where}: {title} must be {what}{empty}; got {shown(text)}.{_hint(text)}")
    return value


def _hint(text: str) -> str:
    """The likely cause of a cell that is no number."""
    if re.match(r"\d{4}-\d\d-\d\d|\d\d:\d\d", text):
        return " Times are numbers in the time unit of flow.A, not dates or clock times."
    return " Decimals have a point." if re.fullmatch(r"[+-]?\d+,\d+", text) else ""
