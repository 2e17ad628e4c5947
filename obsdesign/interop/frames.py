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
    """t, x1, ..., x1_lo, x1_hi, ..., d1, ..., status: arrays of one entry per estimate.

    estimates: what `run_batch` returns, or what `step` and `run` give one by one.
    """
    batch = estimates if isinstance(estimates, Batch) else collect(estimates)
    columns: dict[str, Array] = {TIME: batch.t}
    if batch.x is not None:
        columns |= named_columns("x", batch.x)
    if batch.lower is not None and batch.upper is not None:
        names = numbered("x", batch.lower.shape[1])
        for name, low, high in zip(names, batch.lower.T, batch.upper.T, strict=True):
            columns |= dict(zip(pairs([name]), (low, high), strict=True))
    if batch.d is not None:
        columns |= named_columns("d", batch.d)
    return columns | {STATUS: np.array(batch.status, dtype=object)}


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
