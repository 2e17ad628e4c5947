"""Estimates as columns: a dict of arrays, or a pandas table; named as in an estimate file."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from lmi.arithmetic.arrays import Array
from obsdesign.errors import InputError
from obsdesign.runtime.base import Estimate
from obsdesign.runtime.columns import Batch, collect


def to_columns(estimates: Batch | Iterable[Estimate]) -> dict[str, Array]:
    """t, x1, ..., x1_lo, x1_hi, ..., d1, ..., status: arrays of one entry per estimate.

    estimates: what `run_batch` returns, or what `step` and `run` give one by one.
    """
    batch = estimates if isinstance(estimates, Batch) else collect(estimates)
    columns: dict[str, Array] = {"t": batch.t}
    if batch.x is not None:
        columns |= {f"x{i + 1}": values for i, values in enumerate(batch.x.T)}
    if batch.lower is not None and batch.upper is not None:
        for i, (low, high) in enumerate(zip(batch.lower.T, batch.upper.T, strict=True)):
            columns |= {f"x{i + 1}_lo": low, f"x{i + 1}_hi": high}
    if batch.d is not None:
        columns |= {f"d{i + 1}": values for i, values in enumerate(batch.d.T)}
    return columns | {"status": np.array(batch.status, dtype=object)}


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
