"""When the observer of Mattsson and Medvedev looks for an impulse; exponents that cannot work."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.impulsive_input.curve import ImpulseCurve
from obsdesign.equations.impulsive_input.features import feature_scales, filtered_system, has_peak

Array = NDArray[Any]

# kernels of growing exponents see the beginning of a window alone: beyond this lambda tau an
# impulse in the rest of it leaves less in a feature than rounding makes of what was there before
_SEES_ALL = 6.0
_LARGEST_GROWTH = 300.0  # e to it still fits binary64 with room


def integral_entries(options: Any, gains: Any) -> list[str]:
    """Names of the entries of a problem that only operator `integral` uses."""
    names = ("exponents", "ratio", "threshold", "check_exponents")
    return [name for name in names if name in options] + (["gains.K"] if "K" in gains else [])


def operator_is_open(problem: Any) -> bool:
    """Whether the problem leaves the operator open and both are possible.

    `problem` has the attributes of `obsdesign.problem.problem.Problem`.
    """
    periodic = problem.plant.output.measured == "periodic"
    own = integral_entries(problem.options, problem.gains)
    return periodic and "operator" not in problem.options and not own


def growth_objection(exponents: Array, n: int, p: int, window: float) -> str | None:
    """Why these exponents cannot be executed in binary64, or None; one sentence."""
    growth = np.asarray(exponents, float) * window
    largest = float(growth.max(initial=0.0))
    if largest > _LARGEST_GROWTH:
        return (
            f"observer.exponents times the window must be at most {_LARGEST_GROWTH:g}; "
            f"got {largest:.6g}."
        )
    enough = int((growth <= _SEES_ALL).sum())
    if enough * p < n <= len(growth) * p:
        return (
            f"observer.exponents must hold {-(-n // p)} that are at most {_SEES_ALL:g} / window = "
            f"{_SEES_ALL / window:.6g}; got {enough}. Kernels that grow faster see the beginning "
            "of a window alone."
        )
    return None


def rule_of(
    D: Array, C: Array, H: Array, exponents: Array, window: float, margin: float
) -> tuple[str, float]:
    """(peak where every impulse makes one in |R| else position, oldest age that is searched).

    Floats: a choice to make, no proof. ValueError where the features cannot be followed.
    """
    F = filtered_system(D, C, exponents, feature_scales(exponents, window))
    oldest = ImpulseCurve.of(F, H, window).oldest
    return "peak" if has_peak(F, H, window, margin) else "position", oldest


def margin_objection(oldest: float, window: float, margin: float) -> str | None:
    """Why ages from `margin` on cannot be searched, or None."""
    if margin < oldest:
        return None
    return (
        f"observer.margin must be below {oldest:.2g}, where less than a thousandth of an impulse "
        f"is left in the features; got {margin!r}. Is observer.window = {window!r} too long for "
        "the plant, or the exponents too fast?"
    )
