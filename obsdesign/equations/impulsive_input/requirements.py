"""Requirements on plants and gains of observers of unknown impulses; words of their gains."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

# what is measured and its noise are squared, and multiplied by gains
LARGEST, SMALLEST = 1e100, 1e-100
# squares of what an impulse makes of y are multiplied with each other
_LEAST_OUTPUT = 1e-70
OPERATORS = ("integral", "samples")
WEIGHTINGS = ("plain", "gls")
RULES = ("peak", "position", "threshold")


def reason_against_plant(plant: Any) -> str | None:
    """Return why no observer of this kind serves a plant, one sentence, or None."""
    if plant.jump is None or plant.jump.H is None:
        return None  # a missing block: the caller asks for it
    return reason_against_jumps(plant) or reason_against_sizes(plant)


def reason_against_jumps(plant: Any) -> str | None:
    """Return what else than impulses happens at the jumps of a plant, or None."""
    if not np.array_equal(plant.jump.G, np.eye(len(plant.flow.A))):
        return (
            "jump.G must be the identity for kind 'impulsive_input': impulses add to the state at "
            "unknown times, and nothing else may happen then. Leave jump.G out."
        )
    if plant.jump.E is not None:
        return (
            "jump.E is refused by kind 'impulsive_input': jump times are unknown, so that no known "
            "input can act at them."
        )
    return None


def reason_against_sizes(plant: Any) -> str | None:
    """Return which number of a plant floats cannot square, or None."""
    output = plant.output
    entries = {
        "flow.A": plant.flow.A, "jump.H": plant.jump.H, "output.C": output.C,
        "output.noise_std": output.noise_std, "output.noise_cv": output.noise_cv,
    }  # fmt: skip
    for name, values in entries.items():
        sizes = np.abs(values[values != 0])
        least = SMALLEST if "noise" in name else 0.0
        wrong = sizes[(sizes > LARGEST) | (sizes < least)]
        if len(wrong):
            allowed = (
                f"0, or between {least:g} and {LARGEST:g}" if least else f"at most {LARGEST:g}"
            )
            return (
                f"{name} must be {allowed} in size for kind 'impulsive_input', which squares it; "
                f"got {wrong[0]:g}. Are the units what they should be?"
            )
        if name in ("output.C", "jump.H") and 0 < sizes.max(initial=0.0) < _LEAST_OUTPUT:
            return (
                f"{name} must be 0, or at least {_LEAST_OUTPUT:g} in size for kind "
                f"'impulsive_input', which squares it; got {sizes.max():g}. Are the units what "
                "they should be?"
            )
    return None


def is_positive(value: Any) -> bool:
    """A positive, finite number."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and value > 0 and math.isfinite(value)


def are_exponents(value: Any) -> bool:
    """A list of one or more distinct, finite numbers."""
    try:
        exponents = np.asarray(value)
    except ValueError:
        return False
    if exponents.ndim != 1 or exponents.dtype.kind not in "fi" or len(exponents) == 0:
        return False
    return bool(np.isfinite(exponents).all()) and len(set(exponents.tolist())) == len(exponents)


def is_whole_multiple(window: float, period: float) -> bool:
    """Whether a window is a multiple of the period, at least one, up to rounding."""
    count = float(window) / float(period)
    return abs(count - round(count)) <= 1e-6 and round(count) >= 1


def reason_against_samples(plant: Any, window: float, weighting: Any) -> str | None:
    """Return why operator `samples` cannot serve a plant with this window, or None."""
    period = plant.output.period
    if plant.output.measured != "periodic" or not is_positive(period):
        return "output.measured must be 'periodic' for operator 'samples'"
    if not is_whole_multiple(window, period):
        return f"gains.window must be a multiple of output.period = {period!r}; got {window!r}"
    if weighting != "gls":
        return "gains.weighting must be 'gls' for operator 'samples'"
    if plant.jump.H.shape[1] != 1:
        return "jump.H must have one column for operator 'samples'"
    return None
