"""What may be asked of a finite-time observer, and what a design keeps of its plant."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.estimation_error import plant_data

Array = NDArray[Any]

METHODS = ("least_squares", "exact", "approximate", "minimax")
NEED_L = ("exact", "approximate")
FREE = ("least_squares", "minimax")
# T / nu counts as whole when it is that close to a whole number: both are decimal numbers
WHOLE_TOLERANCE = 1e-9
# more samples than this make a design file too large to handle
MOST_SAMPLES = 20_000
_OF_JUMPS = ("G", "E", "jump_lower", "jump_upper", "dwell_time", "dwell_jitter")


def objection(plant: Any, options: Any) -> str | None:
    """What forbids a finite-time observer for a problem, or None; one sentence."""
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
        return window_objection(options["window"], plant.output.period)
    return None


def objective_objection(options: Any, L: bool = False) -> str | None:
    """Why `objective` has nothing to choose for a design, or None. L: is it given?"""
    method, objective = options.get("method", "least_squares"), options.get("objective")
    if objective is None:
        return None
    if method in NEED_L:
        return _nothing_open(method, objective, options.get("window"), L)
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


def _nothing_open(method: str, objective: str, window: float | None, L: bool) -> str | None:
    """The same for methods with L; longest_period chooses coordinates S where L and T are given."""
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


def window_objection(window: float, period: float) -> str | None:
    """Why this window does not fit the period, or None."""
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
    """k = T / nu for a window that `window_objection` has nothing against."""
    return round(window / period)


def announced_jumps(plant: Any) -> bool:
    """Does the data tell when the plant jumps? Impulses of unknown weight alone are not told."""
    jump = plant.jump
    return jump is not None and (jump.H is None or not np.array_equal(jump.G, np.eye(plant.n)))


def stored_plant(plant: Any) -> dict[str, Any]:
    """The plant's numbers in a design's gains: without jumps that no data announce."""
    data = plant_data(plant) | {"period": plant.output.period}
    if not announced_jumps(plant):
        data = {name: value for name, value in data.items() if name not in _OF_JUMPS}
    return data


def relative_deviations(output: Any) -> Array:
    """Relative sizes of the outputs' errors: standard deviations, else bounds, else equal."""
    for sizes in (output.noise_std, output.noise_radius):
        if sizes is not None and (sizes > 0).all():
            return np.asarray(sizes / sizes.max())
    return np.ones(len(output.C))
