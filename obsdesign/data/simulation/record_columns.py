"""Columns of a simulated record: by signal, or by the names of events and sensors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Array, Matrix
from obsdesign.column_names import JUMP, RECEIVED, TIME, TRUTH
from obsdesign.problem.plant import Plant
from obsdesign.runtime.columns import named_columns


def record_columns(
    plant: Plant,
    times: Matrix,
    blocks: Mapping[str, Matrix],
    happened: NDArray[np.bool_] | None,
    received: Matrix | None = None,
) -> dict[str, Array]:
    """Columns of all signals, then the truth; y, w, u, x, d are in blocks, (rows, ...) each.

    happened (rows, events): what the record says of events, None where it has no word of them;
    received (rows,): when rows arrive, None where none is late.
    """
    columns: dict[str, Array] = {TIME: times}
    if plant.has_tables:
        columns |= _sensors(plant, blocks["y"])
    else:
        columns |= named_columns("y", blocks["y"])
    columns |= named_columns("u", blocks["u"])
    if plant.has_tables:
        columns |= {} if happened is None else _events(plant, blocks["w"], happened)
    else:
        columns |= named_columns("w", blocks["w"])
        if happened is not None and plant.events:
            columns[JUMP] = happened[:, 0].astype(np.int64)
    columns |= {} if received is None else {RECEIVED: received}
    for letter in TRUTH:
        columns |= named_columns(letter, blocks[letter])
    return columns


def _sensors(plant: Plant, y: Matrix) -> dict[str, Array]:
    titles = [title for sensor in plant.sensors for title in sensor.columns]
    return dict(zip(titles, y.T, strict=True))


def _events(plant: Plant, w: Matrix, happened: NDArray[np.bool_]) -> dict[str, Array]:
    """Known inputs of events, or ones where there are none, at the rows of each."""
    columns: dict[str, Array] = {}
    first = 0
    for event, rows in zip(plant.events, happened.T, strict=True):
        count = event.inputs
        own = w[:, first : first + count] if count else np.ones((len(w), 1))
        values = np.where(rows[:, None], own, np.nan)
        columns |= dict(zip(event.columns, values.T, strict=True))
        first += count
    return columns
