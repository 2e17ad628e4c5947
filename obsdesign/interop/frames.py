"""Estimates as columns: a dict of arrays, or a pandas table; named as in an estimate file."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from lmi.arithmetic.arrays import Array
from obsdesign.column_names import STATUS, TIME, numbered, pairs
from obsdesign.errors import InputError
from obsdesign.runtime.base import Estimate
from obsdesign.runtime.columns import Batch, collect, named_columns


def to_columns(estimates: Batch | Iterable[Estimate]) -> dict[str, Array]:
    """t, x1, ..., x1_lo, x1_hi, ..., d1, ..., status: arrays, an entry per estimate.

    estimates: what `run_batch` returns, or what `step` and `run` give one by one.
    """
    batch = estimates if isinstance(estimates, Batch) else collect(estimates)
    columns: dict[str, Array] = {TIME: batch.t}
    if batch.x is not None:
        columns |= named_columns("x", batch.x)
    if batch.lower is not None and batch.upper is not None:
        columns |= _pairs("x", "", np.stack([batch.lower, batch.upper], axis=1))
    if batch.d is not None:
        columns |= named_columns("d", batch.d)
    for letter, suffix, own in (
        ("d", "", batch.d_bounds), ("l", "", batch.directions), ("x", "_lag", batch.lagged),
    ):  # fmt: skip
        columns |= {} if own is None else _pairs(letter, suffix, own)
    return columns | {STATUS: np.array(batch.status, dtype=object)}


def _pairs(letter: str, suffix: str, bounds: Array) -> dict[str, Array]:
    """Columns of bounds (rows, 2, k): x1_lo, x1_hi, ..., or x1_lag_lo, ... with a suffix."""
    names = [name + suffix for name in numbered(letter, bounds.shape[2])]
    ends = bounds.transpose(2, 1, 0).reshape(2 * len(names), -1)
    return dict(zip(pairs(names), ends, strict=True))


def to_frame(estimates: Batch | Iterable[Estimate]) -> Any:
    """A `pandas.DataFrame` of `to_columns`; InputError when pandas is not installed."""
    try:
        import pandas as pd
    except ImportError:
        raise InputError(
            "a table requires pandas; it is missing: pip install 'obsdesign[interop]'. "
            "to_columns gives the same as numpy arrays."
        ) from None
    return pd.DataFrame(to_columns(estimates))
