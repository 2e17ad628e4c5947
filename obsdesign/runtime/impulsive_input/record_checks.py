"""Times and numbers of a record that floats can follow."""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.impulsive_input.gains import LARGEST, IntegralGains, SamplesGains
from obsdesign.errors import InputError

# parts of a window, and of a period between whose samples onsets are looked for (operator
# `samples`), that the last digit of a time stamp must resolve
_LEAST_WINDOW_PARTS, _LEAST_PERIOD_PARTS = 16, 100


def check_resolution(times: Matrix, gains: IntegralGains | SamplesGains) -> None:
    """InputError for a time stamp whose last digit is no small part of the window or period."""
    name, span, parts = "window", gains.window, _LEAST_WINDOW_PARTS
    if isinstance(gains, SamplesGains):
        name, span, parts = "period", gains.sample_period, _LEAST_PERIOD_PARTS
    coarse = np.spacing(np.abs(times)) > span / parts
    if coarse.any():
        t = float(times[np.argmax(coarse)])
        raise InputError(
            f"t must resolve the {name} of {span:g} into {parts} parts; got t = {t:.10g}, whose "
            f"last digit stands for {math.ulp(t):.2g}. Count time from a later zero."
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
