"""Are the gains of an `impulsive_input` design complete and of the right shapes?"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.impulsive_input.features import (
    LARGEST,
    OPERATORS,
    RULES,
    WEIGHTINGS,
    are_exponents,
    is_positive,
)
from obsdesign.errors import InputError
from obsdesign.runtime.base import require_shapes

# parts of a window that the last digit of a time stamp must be able to tell
_LEAST_PARTS = 16


def check_gains(gains: Mapping[str, Any]) -> None:
    """ValueError unless the entries of a design fit each other."""
    n, p = np.shape(gains.get("A", ()))[:1], np.shape(gains.get("C", ()))[:1]
    shapes = {"A": n + n, "C": p + n, "flow_lower": n, "flow_upper": n, "noise_std": p,
              "noise_cv": p, "dwell_time": (2,)}  # fmt: skip
    if gains.get("operator") == "integral":
        shapes |= {"K": n + p}
    if "initial_std" in gains:
        shapes |= {"initial_std": n}
    require_shapes(gains, shapes)
    if not (np.asarray(gains.get("initial_std", 0.0)) >= 0).all():
        raise ValueError("gains.initial_std must be >= 0.")
    for name in ("B", "H"):
        if (name in gains or name == "H") and (
            np.ndim(gains.get(name, ())) != 2 or len(gains[name]) != n[0]
        ):
            raise ValueError(f"gains.{name} must have {n[0]} rows.")
    words = {"operator": OPERATORS, "weighting": WEIGHTINGS}
    for name, allowed in words.items():
        if gains.get(name) not in allowed:
            raise ValueError(f"gains.{name} must be one of {', '.join(allowed)}.")
    if gains["operator"] == "integral" and gains.get("rule") not in RULES:
        raise ValueError(f"gains.rule must be one of {', '.join(RULES)}.")
    for name in ("window", "margin"):
        if not is_positive(gains.get(name)):
            raise ValueError(f"gains.{name} must be a positive number.")
    if gains["operator"] == "integral":
        if not are_exponents(gains.get("exponents")):
            raise ValueError("gains.exponents must be distinct, finite numbers, one or more.")
        return
    if not is_positive(gains.get("period")):
        raise ValueError("gains.period must be a positive number for operator 'samples'.")
    count = float(gains["window"]) / float(gains["period"])
    if abs(count - round(count)) > 1e-6 or round(count) < 1:
        raise ValueError("gains.window must be a multiple of gains.period.")


def check_resolution(times: NDArray[np.float64], window: float) -> None:
    """InputError for a time stamp whose last digit is no small part of the window."""
    coarse = np.spacing(np.abs(times)) > window / _LEAST_PARTS
    if coarse.any():
        t = float(times[np.argmax(coarse)])
        raise InputError(
            f"t must resolve the window of {window:g}; got t = {t:.10g}, whose last digit stands "
            f"for {math.ulp(t):.2g}. Count time from a later zero."
        )


def check_size(name: str, values: NDArray[np.float64], times: NDArray[np.float64]) -> None:
    """InputError for a number, in rows (k, m) at times (k,), that floats cannot square."""
    large = np.abs(values) > LARGEST  # NaN, a missing sample, is not
    if large.any():
        k, i = np.argwhere(large)[0]
        cause = " Is it a mark for a missing value? Leave that empty." if name == "y" else ""
        raise InputError(
            f"{name}{i + 1} must be at most {LARGEST:g} in size, since it is squared; got "
            f"{values[k, i]:g} at t = {times[k]:.10g}.{cause}"
        )
