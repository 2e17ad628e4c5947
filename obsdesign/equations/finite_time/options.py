"""Options of a finite-time observer, and the numbers of the plant that a design stores."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from obsdesign.equations.gains import Array, plant_data

METHODS = ("least_squares", "exact", "approximate", "minimax")
NEED_L = ("exact", "approximate")
FREE = ("least_squares", "minimax")
# T / nu counts as whole when it is that close to a whole number: both are decimal numbers
WHOLE_TOLERANCE = 1e-9
# more samples than this make a design file too large to handle
MOST_SAMPLES = 20_000
_JUMP_ENTRIES = ("G", "E", "jump_lower", "jump_upper", "dwell_time", "dwell_jitter")


def reason_against_problem(plant: Any, options: Any) -> str | None:
    """Reason why a problem has no finite-time observer, or None; one sentence."""
    if plant.output.measured != "periodic":
        return (
            "output.measured must be periodic for kind 'finite_time'; "
            f"got {plant.output.measured!r}."
        )
    method = options.get("method", "least_squares")
    if options.get("half_sample_correction") and method != "approximate":
        return (
            "observer.half_sample_correction belongs to method = 'approximate'; the method is "
            f"{method!r}, which has no bias to correct."
        )
    if "window" in options:
        return reason_against_window(options["window"], plant.output.period)
    return None


def reason_against_objective(options: Any, L: bool = False) -> str | None:
    """Reason why `objective` has no free variable to choose, or None. L: is it given?"""
    method, objective = options.get("method", "least_squares"), options.get("objective")
    if objective is None:
        return None
    if method in NEED_L:
        return _reason_against_objective_with_injection(method, objective, options.get("window"), L)
    if objective == "longest_period":
        return (
            "observer.objective = 'longest_period' chooses L and the window of methods 'exact' and "
            f"'approximate' by condition (13); the method is {method!r}, which has none."
        )
    if "window" in options:
        return (
            f"observer.objective = {objective!r} chooses the window of method {method!r}, and "
            f"nothing else; observer.window = {options['window']!r} is given. Leave one out."
        )
    return None


def _reason_against_objective_with_injection(
    method: str, objective: str, window: float | None, L: bool
) -> str | None:
    """Reason for methods with L; longest_period chooses S where L and T are given."""
    if window is None:
        return None
    if objective == "shortest_window":
        return (
            "observer.objective = 'shortest_window' chooses the window; observer.window = "
            f"{window!r} is given. Leave one out."
        )
    if objective == "least_noise" and L:
        return (
            f"observer.objective = 'least_noise' chooses L and the window of method {method!r}; "
            "observer.gains.L and observer.window are given. Leave one of them out."
        )
    return None


def reason_against_window(window: float, period: float) -> str | None:
    """Reason why a window does not fit the period, or None."""
    if window < period * (1 - WHOLE_TOLERANCE):
        return (
            f"observer.window must be at least output.period = {period!r}; got {window!r}. "
            "The window holds no sample."
        )
    count = window / period
    if count < math.inf and abs(count - round(count)) > WHOLE_TOLERANCE * count:
        near = [k * period for k in (math.floor(count), math.ceil(count))]
        return (
            f"observer.window must be a multiple of output.period = {period!r}; got {window!r}, "
            f"which is {count:.6g} periods. The nearest multiples are {near[0]:.9g} and "
            f"{near[1]:.9g}."
        )
    if count > MOST_SAMPLES:
        return (
            f"observer.window must hold at most {MOST_SAMPLES} samples; got {count:.6g}, "
            f"{window!r} with period {period!r}."
        )
    return None


def window_samples(window: float, period: float) -> int:
    """Number of samples k = T / nu of a window that `reason_against_window` accepts."""
    return round(window / period)


def has_announced_jumps(plant: Any) -> bool:
    """Do the data announce jumps? Impulses of unknown weight alone are not announced."""
    jump = plant.jump
    return jump is not None and (jump.H is None or not np.array_equal(jump.G, np.eye(plant.n)))


def stored_plant(plant: Any) -> dict[str, Any]:
    """Return the plant's numbers in a design's gains, without jumps that no data announce."""
    data = plant_data(plant) | {"period": plant.output.period}
    if not has_announced_jumps(plant):
        data = {name: value for name, value in data.items() if name not in _JUMP_ENTRIES}
    return data


def relative_deviations(output: Any) -> Array:
    """Relative sizes of the outputs' errors: standard deviations, else bounds, else equal."""
    for sizes in (output.noise_std, output.noise_radius):
        if sizes is not None and (sizes > 0).all():
            return np.asarray(sizes / sizes.max())
    return np.ones(len(output.C))
