"""CSV text of estimates, events and tables; numbers so that they are read back exactly."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Sequence

import numpy as np

from lmi.arithmetic.arrays import Array
from obsdesign.column_names import STATUS, TIME
from obsdesign.runtime.base import Estimate


def estimate_header(names: Iterable[str]) -> str:
    """First line of an estimate file."""
    return ",".join([TIME, *names, STATUS])


def estimate_line(estimate: Estimate) -> str:
    """One line of an estimate file; numbers so that they are read back exactly."""
    numbers = [estimate.t]
    if estimate.x is not None:
        numbers += estimate.x.tolist()
    if estimate.lower is not None and estimate.upper is not None:
        numbers += np.column_stack([estimate.lower, estimate.upper]).reshape(-1).tolist()
    if estimate.d is not None:
        numbers += estimate.d.tolist()
    for pairs in (estimate.d_bounds, estimate.directions, estimate.lagged):
        if pairs is not None:
            numbers += pairs.T.reshape(-1).tolist()
    return ",".join([*map(_cell, numbers), estimate.status])


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


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(value)
    return str(value)
