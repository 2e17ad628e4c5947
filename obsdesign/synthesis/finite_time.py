"""Finite-time estimation: the window, L where the method has one, and the gains on the window.

Gains of (14) and (9) come from ball enclosures and are rounded once, so that a matrix with a bad
condition costs no digits; least squares by QR; minimax by a linear program per state. What should
be unbiased is made so to rounding before it is stored.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lmi.balls import entries, identity, precision, scalar
from lmi.norms import float_above, middles
from obsdesign.equations import finite_time as equations
from obsdesign.errors import InputError
from obsdesign.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.finite_time_injection import chosen_injection
from obsdesign.synthesis.minimax import minimax_gain
from obsdesign.window_bounds import disturbance_bound, error_radius
from obsdesign.window_gains import Sampled, approximate_gain, exact_gain, half_period

_BITS = (160, 640)
# a default window is doubled until its scaled rows are that far from losing rank
_DETERMINED = 1e-2
_LONGEST_DEFAULT = 2048


def synthesize(problem: Problem) -> Iterator[Candidate]:
    """One candidate; InputError for what cannot be built at all."""
    problem.require_measured("periodic")
    if text := equations.objection(problem.plant, problem.options):
        raise InputError(text)
    method = problem.options.get("method", "least_squares")
    plant = equations.stored_plant(problem.plant)
    if method == "minimax" and not _disturbed(plant):
        raise InputError(
            "observer.method = 'minimax' needs output.noise_bound or flow.disturbance: it makes "
            "the largest error small, and without either there is none."
        )
    k = _samples(problem)
    gains = plant | {"method": method, "samples": k}
    searched = False
    if method in equations.NEED_L:
        searched = "L" not in problem.gains
        gains["L"] = chosen_injection(problem, k) if searched else problem.gains["L"]
    if method == "approximate":
        corrected = problem.options.get("half_sample_correction")
        gains["half_sample"] = "corrected" if corrected else "printed"
    if method == "least_squares":
        gains["deviations"] = _deviations(problem)
    gains["window_gain"] = _window_gain(problem, gains)
    if method != "approximate":
        gains |= _errors(gains)
    yield Candidate(method, gains, searched=searched)


def _disturbed(plant: dict[str, Any]) -> bool:
    moved = np.any(plant["flow_lower"] != plant["flow_upper"])
    return bool(moved or np.any(plant["noise_bound"]))


def _samples(problem: Problem) -> int:
    """k, given or chosen: the first of n, 2 n, 4 n, ... that determines the state well."""
    plant, period = problem.plant, float(problem.plant.output.period or 1.0)
    if "window" in problem.options:
        return equations.window_samples(problem.options["window"], period)
    best, reach = plant.n, 0.0
    k = max(plant.n, 2)
    while k <= _LONGEST_DEFAULT:
        rows = equations.sample_rows(plant.flow.A, plant.output.C, period, k)
        scales = equations.state_scales(plant.flow.A, plant.output.C, k * period)
        found = equations.approx_determinacy(rows.reshape(-1, plant.n), scales)
        if found > reach:
            best, reach = k, found
        if found >= _DETERMINED:
            break
        k *= 2
    return best


def _window_gain(problem: Problem, gains: dict[str, Any]) -> Any:
    """Gains (n, k p) of the method; zeros where its matrices are singular, which is refuted."""
    A, C, k, method = gains["A"], gains["C"], gains["samples"], gains["method"]
    nothing = np.zeros((len(A), k * len(C)))
    rows = equations.sample_rows(A, C, gains["period"], k)
    flat = rows.reshape(-1, len(A))
    if equations.approx_determinacy(flat, np.ones(len(A))) == 0.0:
        return nothing
    fitted = equations.least_squares_gain(flat, np.tile(_deviations(problem), k))
    if method == "least_squares":
        return equations.made_unbiased(fitted, flat, fitted)
    if method == "minimax":
        found = minimax_gain(gains, rows)
        return nothing if found is None else equations.made_unbiased(found, flat, fitted)
    found = _formula(gains)
    return nothing if found is None else found


def _formula(gains: dict[str, Any]) -> Any:
    """(14), or (9) with (16), rounded from an enclosure that is tight enough."""
    for bits in _BITS:
        with precision(bits):
            sampled = Sampled.of(gains["A"], gains["C"], gains["period"], gains["samples"])
            if gains["method"] == "exact":
                found = exact_gain(sampled, gains["L"])[1]
            else:
                found = approximate_gain(sampled, gains["L"])
                if found is not None and gains["half_sample"] == "corrected":
                    found = half_period(sampled) @ found
            if found is not None:
                return middles(found)
    return None


def _deviations(problem: Problem) -> Any:
    """Relative sizes of the outputs' errors: standard deviations, else bounds, else equal."""
    output = problem.plant.output
    for sizes in (output.noise_std, output.noise_bound):
        if (sizes > 0).all():
            return sizes / sizes.max()
    return np.ones(problem.plant.p)


def _errors(gains: dict[str, Any]) -> dict[str, Any]:
    """radius (n,), state_error (n, n): what the stored gains may be off by, rounded upwards."""
    with precision(_BITS[0]):
        sampled = Sampled.of(gains["A"], gains["C"], gains["period"], gains["samples"])
        gain = gains["window_gain"]
        sizes = error_radius(sampled, gain, gains["noise_bound"], disturbance_bound(gains))
        from lmi.balls import exact

        error = exact(gain) @ sampled.rows() - entries(identity(len(gains["A"])))
        state_error = np.array([[float_above(abs(x)) for x in row] for row in error])
        return {
            "radius": np.array([float_above(scalar(x)) if x > 0 else 0.0 for x in sizes]),
            "state_error": np.where(np.isfinite(state_error), state_error, 1e300),
        }
