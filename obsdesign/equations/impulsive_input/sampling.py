"""Periods at which integrals of samples still show an impulse."""

from __future__ import annotations

import math
from decimal import ROUND_FLOOR, Context

import numpy as np

from lmi.arithmetic.arrays import Array

# |mu| h of the modes of A - K C, and |lambda| h, up to which integrals of samples show an impulse:
# measured over random plants, where impulses were missed from 0.56 on in windows longer than
# LONG_TIME_CONSTANTS of the slowest mode, from 1.28 on in others
_MAX_MODE_PERIOD, _MAX_MODE_PERIOD_LONG = 0.7, 0.4
LONG_TIME_CONSTANTS, MAX_EXPONENT_PERIOD = 7.0, 12.0


def fastest_limit(long: bool) -> float:
    """Bound on |mu| h, mu the fastest mode of A - K C and h the period, for operator `integral`.

    long: the window is longer than LONG_TIME_CONSTANTS of its slowest mode.
    """
    return _MAX_MODE_PERIOD_LONG if long else _MAX_MODE_PERIOD


def longest_period(D: Array, exponents: Array | None, window: float) -> float:
    """The longest period at which integrals of samples show an impulse; floats.

    Beyond it an impulse is not recognised at its age, and missed: what the residual does between
    two samples differs too much from a line.
    """
    modes = np.linalg.eigvals(D)
    long = float(-modes.real.max()) * window > LONG_TIME_CONSTANTS
    fastest = float(np.abs(modes).max(initial=0.0))
    longest = fastest_limit(long) / fastest if fastest > 0 else math.inf
    steepest = 0.0 if exponents is None else float(np.abs(exponents).max())
    return min(longest, MAX_EXPONENT_PERIOD / steepest) if steepest > 0 else longest


def rounded_down(value: float) -> float:
    """Three digits of a positive number, never more than it."""
    return float(Context(prec=3, rounding=ROUND_FLOOR).create_decimal(repr(float(value))))
