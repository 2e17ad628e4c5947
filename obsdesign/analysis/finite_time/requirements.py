"""Requirements of finite-time estimation on a problem; the plant's numbers in its designs."""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from obsdesign.equations.finite_time.gains import MOST_SAMPLES, NEED_L
from obsdesign.equations.gains import plant_data
from obsdesign.problem.options import FiniteTimeOptions
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem

# T / nu counts as whole when it is that close to a whole number: both are decimal numbers
_WHOLE_TOLERANCE = 1e-9
_JUMP_ENTRIES = ("G", "E", "jump_lower", "jump_upper", "dwell_time", "dwell_jitter")


def reason_against(problem: Problem) -> str | None:
    """Reason why a problem has no finite-time observer, or None; one sentence."""
    if reason := problem.reason_unless_measured("periodic"):
        return reason
    output, options = problem.plant.output, problem.options_as(FiniteTimeOptions)
    return (
        reason_against_correction(options)
        or _reason_against_window(options.window, output.sample_period)
        or _reason_against_objective(options, "L" in problem.gains)
    )


def reason_against_correction(options: FiniteTimeOptions) -> str | None:
    """Reason why there is no half-sample delay to take off, or None."""
    if options.half_sample_correction and options.method != "approximate":
        return (
            "observer.half_sample_correction belongs to method = 'approximate'; the method is "
            f"{options.method!r}, which has no bias to correct."
        )
    return None


def _reason_against_window(window: float | None, period: float) -> str | None:
    """Reason why a window does not fit the period, or None."""
    if window is None:
        return None
    if window < period * (1 - _WHOLE_TOLERANCE):
        return (
            f"observer.window must be at least output.period = {period!r}; got {window!r}. "
            "The window holds no sample."
        )
    count = window / period
    if count < math.inf and abs(count - round(count)) > _WHOLE_TOLERANCE * count:
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


def _reason_against_objective(options: FiniteTimeOptions, has_L: bool) -> str | None:
    """Reason why `objective` has no free variable to choose, or None.

    With L and T given longest_period still chooses S.
    """
    method, objective, window = options.method, options.objective, options.window
    if objective == "longest_period" and method not in NEED_L:
        return (
            "observer.objective = 'longest_period' chooses L and the window of methods 'exact' and "
            f"'approximate' by condition (13); the method is {method!r}, which has none."
        )
    if objective is None or window is None:
        return None
    if method not in NEED_L:
        return (
            f"observer.objective = {objective!r} chooses the window of method {method!r}, and "
            f"nothing else; observer.window = {window!r} is given. Leave one out."
        )
    if objective == "shortest_window":
        return (
            "observer.objective = 'shortest_window' chooses the window; observer.window = "
            f"{window!r} is given. Leave one out."
        )
    if objective == "least_noise" and has_L:
        return (
            f"observer.objective = 'least_noise' chooses L and the window of method {method!r}; "
            "observer.gains.L and observer.window are given. Leave one of them out."
        )
    return None


def window_samples(window: float, period: float) -> int:
    """Number of samples k = T / nu of a window that `reason_against` accepts."""
    return round(window / period)


def has_announced_jumps(plant: Plant) -> bool:
    """Do the data announce jumps? Impulses of unknown weight alone are not announced."""
    jump = plant.jump
    return jump is not None and (jump.H is None or not np.array_equal(jump.G, np.eye(plant.n)))


def stored_plant(plant: Plant) -> NewEntries:
    """Return the plant's numbers in a design's gains, without jumps that no data announce."""
    data = plant_data(plant) | {"period": plant.output.sample_period}
    if not has_announced_jumps(plant):
        data = {name: value for name, value in data.items() if name not in _JUMP_ENTRIES}
    return data


def relative_deviations(output: Output) -> Matrix:
    """Relative sizes of the outputs' errors: standard deviations, else bounds, else equal."""
    for sizes in (output.noise_std, output.noise_radius):
        if sizes is not None and (sizes > 0).all():
            return np.asarray(sizes / sizes.max())
    return np.ones(len(output.C))
