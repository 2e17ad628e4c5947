"""The meaning of a time stamp, and the error of a step between two of them.

A stamp t stands for an instant within half an ulp of the stored binary64 number: the error that
remains after a decimal number was rounded to the nearest binary64. Which decimal it was is not
known, and the stored number itself is one of the admissible instants.

* The step between two stamps is within one ulp of the larger one from their difference (half an
  ulp of each), and within another half ulp of itself, which the subtraction rounds. Bounds of the
  state enclose every such length (`length_error`), so that they hold for the decimal stamps of a
  file and for the binary64 numbers alike. One ulp is 2e-13 at t = 1e3, 2.4e-7 at 1.7e9 (seconds
  since 1970) and 256 at 1.7e18 (nanoseconds).
* Periods and dwell times are compared with a relative tolerance of 1e-9 and that same ulp
  (`time_tolerance`): a difference beyond both is certain, one within both cannot be resolved.
* Two rows with different stamps are two instants, however close: no positive step is taken for
  zero. A row at the time of the initial state has the same stamp, and the step is exactly zero.
"""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Matrix

# Decimal periods and dwell times that agree to this part of their length are equal.
RELATIVE_TIME_TOLERANCE = 1e-9


def length_error(h: float, size: float) -> float:
    """Bound of the error of a step h > 0 between stamps of magnitude at most `size`."""
    return math.ulp(size) + math.ulp(h)


def time_tolerance(length: float, t: float) -> float:
    """Largest deviation from `length`, which ends at stamp t, that still counts as equal to it."""
    return RELATIVE_TIME_TOLERANCE * length + math.ulp(max(abs(t), abs(t - length)))


def time_tolerances(lengths: Matrix, times: Matrix) -> Matrix:
    """`time_tolerance` of each of the lengths (k,), which end at stamps (k,)."""
    sizes = np.maximum(np.abs(times), np.abs(times - lengths))  # the spacing of -1 is negative
    return np.asarray(RELATIVE_TIME_TOLERANCE * lengths + np.spacing(sizes))
