"""Times and numbers of a record that floats can follow."""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.impulsive_input.gains import LARGEST
from obsdesign.errors import InputError

# parts of a window that the last digit of a time stamp must resolve
_LEAST_PARTS = 16


def check_resolution(times: Matrix, window: float) -> None:
    """InputError for a time stamp whose last digit is no small part of the window."""
    coarse = np.spacing(np.abs(times)) > window / _LEAST_PARTS
    if coarse.any():
        t = float(times[np.argmax(coarse)])
        raise InputError(
            f"t must resolve the window of {window:g}; got t = {t:.10g}, whose last digit stands "
            f"for {math.ulp(t):.2g}. Count time from a later zero."
        )


def check_size(name: str, values: Matrix, times: Matrix) -> None:
    """InputError for a number, in rows (k, m) at times (k,), that floats cannot square."""
    large = np.abs(values) > LARGEST  # NaN, a missing sample, is not
    if large.any():
        k, i = np.argwhere(large)[0]
        cause = " Is it a mark for a missing value? Leave that empty." if name == "y" else ""
        raise InputError(
            f"{name}{i + 1} must be at most {LARGEST:g} in size, since it is squared; got "
            f"{values[k, i]:g} at t = {times[k]:.10g}.{cause}"
        )
