"""CSV text of estimates, events and tables; numbers so that they are read back exactly."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Sequence

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from obsdesign.column_names import STATUS, TIME
from obsdesign.runtime.base import Estimate
from obsdesign.runtime.columns import Batch


def estimate_header(names: Iterable[str]) -> str:
    """First line of an estimate file."""
    return ",".join([TIME, *names, STATUS])


def estimate_line(estimate: Estimate) -> str:
    """One line of an estimate file; numbers so that they are read back exactly."""
    numbers = [estimate.t]
    if estimate.x is not None:
        numbers += estimate.x.tolist()
    if estimate.lower is not None and estimate.upper is not None:
        for ends in zip(estimate.lower.tolist(), estimate.upper.tolist(), strict=True):
            numbers += ends
    if estimate.d is not None:
        numbers += estimate.d.tolist()
    for pairs in (estimate.d_bounds, estimate.directions, estimate.lagged):
        if pairs is not None:
            numbers += pairs.T.reshape(-1).tolist()
    return f"{_cells(repr(numbers)[1:-1])},{estimate.status}"


def batch_text(batch: Batch) -> str:
    """Lines of an estimate file: those of `estimate_line`."""
    blocks = [batch.t[:, None]]
    if batch.x is not None:
        blocks.append(batch.x)
    if batch.lower is not None and batch.upper is not None:
        blocks.append(_side_by_side(np.stack([batch.lower, batch.upper], axis=1)))
    if batch.d is not None:
        blocks.append(batch.d)
    stacked = (batch.d_bounds, batch.directions, batch.lagged)
    blocks += [_side_by_side(pairs) for pairs in stacked if pairs is not None]
    rows = _cells(repr(np.hstack(blocks).tolist())[2:-2]).split("],[")
    lines = zip(rows, batch.status, strict=True)
    return "".join([f"{row},{status}\n" for row, status in lines])


def _side_by_side(pairs: Matrix) -> Matrix:
    """Lower and upper bounds, (rows, 2, k), each pair beside each other: (rows, 2k)."""
    return pairs.transpose(0, 2, 1).reshape(len(pairs), -1)


def event_line(cells: Sequence[float | str]) -> str:
    """One line of an event file: NaN as an empty cell."""
    return ",".join(map(_cell, cells))


def table_text(columns: dict[str, Array]) -> str:
    """CSV text of equally long columns; NaN becomes an empty cell, integers stay integers."""
    out = io.StringIO()
    out.write(",".join(columns) + "\n")
    cells = [[_cell(value) for value in values.tolist()] for values in columns.values()]
    out.writelines(",".join(row) + "\n" for row in zip(*cells, strict=True))
    return out.getvalue()


def _cells(numbers: str) -> str:
    """Cells of numbers as Python lists them: NaN as an empty cell."""
    cells = numbers.replace(", ", ",")
    return cells.replace("nan", "") if "nan" in cells else cells


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(value)
    return str(value)
