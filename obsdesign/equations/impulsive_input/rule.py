"""Rules of evaluation of Mattsson and Medvedev; exponents and margins that cannot work."""

from __future__ import annotations

from typing import Any

import numpy as np

from obsdesign.equations.gains import Array
from obsdesign.equations.impulsive_input.curve import ImpulseCurve
from obsdesign.equations.impulsive_input.features import (
    FeatureWindow,
    feature_scales,
    filtered_system,
    has_peak,
)

# kernels of growing exponents weigh the beginning of a window alone: beyond this lambda tau an
# impulse in the rest of it leaves less in a feature than rounding makes of what was there before
_MAX_WINDOW_GROWTH = 6.0
_MAX_GROWTH_EXPONENT = 300.0  # e to it still fits binary64 with room


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


def reason_against_exponents(exponents: Array, n: int, p: int, window: float) -> str | None:
    """Return why these exponents cannot be executed in binary64, one sentence, or None."""
    growth = np.asarray(exponents, float) * window
    largest = float(growth.max(initial=0.0))
    if largest > _MAX_GROWTH_EXPONENT:
        return (
            f"observer.exponents times the window must be at most {_MAX_GROWTH_EXPONENT:g}; "
            f"got {largest:.6g}."
        )
    enough = int((growth <= _MAX_WINDOW_GROWTH).sum())
    if enough * p < n <= len(growth) * p:
        return (
            f"observer.exponents must hold {-(-n // p)} that are at most "
            f"{_MAX_WINDOW_GROWTH:g} / window = {_MAX_WINDOW_GROWTH / window:.6g}; got {enough}. "
            "Kernels that grow faster see the beginning of a window alone."
        )
    return None


def evaluation_rule(window: FeatureWindow) -> tuple[str, float]:
    """(`peak` where every impulse makes one in |R|, else `position`; oldest age searched).

    Floats: a choice to make, no proof. ValueError where the features cannot be followed.
    """
    exponents, tau = window.exponents, window.tau
    F = filtered_system(window.D, window.C, exponents, feature_scales(exponents, tau))
    oldest = ImpulseCurve.from_system(F, window.H, tau).oldest
    return "peak" if has_peak(F, window.H, tau, window.margin) else "position", oldest


def reason_against_margin(oldest: float, window: float, margin: float) -> str | None:
    """Return why ages from `margin` on cannot be searched, or None."""
    if margin < oldest:
        return None
    return (
        f"observer.margin must be below {oldest:.2g}, where less than a thousandth of an impulse "
        f"is left in the features; got {margin!r}. Is observer.window = {window!r} too long for "
        "the plant, or the exponents too fast?"
    )
