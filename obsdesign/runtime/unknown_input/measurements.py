"""Measurements of an unknown-input observer: usable ones, and a smoothed record."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.unknown_input.smoothing import smoothed
from obsdesign.runtime.base import Sample, optional_measurement
from obsdesign.runtime.status import MISSING_SAMPLE

# of measurements: differences and products of larger ones overflow
_LARGEST = 1e150


def usable(y: ArrayLike | None, size: int) -> tuple[Matrix | None, str]:
    """(the measurement or None, why it is not used)."""
    measurement = optional_measurement(y, size)
    if measurement is None:
        return None, MISSING_SAMPLE
    if not np.abs(measurement).max() < _LARGEST:
        return None, f"measurement beyond {_LARGEST:g}"
    return measurement, ""


def smoothed_record(samples: Sequence[Sample], deviation: Matrix) -> list[Sample]:
    """The samples with each output smoothed to its noise; missing ones stay missing."""
    rows = [usable(sample.y, len(deviation))[0] for sample in samples]
    measured = [k for k, y in enumerate(rows) if y is not None]
    if not measured:
        return list(samples)
    t = np.array([float(samples[k].t) for k in measured])
    if not np.all(np.diff(t) > 0):
        raise ValueError("time must increase in a record that is smoothed.")
    values = smoothed(t, np.array([rows[k] for k in measured]), deviation)
    result = list(samples)
    for k, y in zip(measured, values, strict=True):
        result[k] = samples[k]._replace(y=y)
    return result
