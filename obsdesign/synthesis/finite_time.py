"""Finite-time estimation: the window, L where the method has one, and the gains on the window.

Gains of (14) and (9) come from ball enclosures and are rounded once, so that a matrix with a bad
condition costs no digits; least squares by QR; minimax by a linear program per state. What should
be unbiased is made so to rounding before it is stored.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lmi.balls import entries, exact, identity, precision, scalar
from lmi.norms import float_above, middles
from obsdesign.equations import finite_time as equations
from obsdesign.errors import InputError
from obsdesign.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.finite_time_injection import (
    best_injection,
    chosen_injection,
    fewest_samples,
)
from obsdesign.synthesis.minimax import minimax_gain
from obsdesign.window_bounds import disturbance_bound, error_radius
from obsdesign.window_gains import Sampled, approximate_gain, exact_gain, half_period

_BITS = (160, 320)
# a default window is doubled until its scaled rows are that far from losing rank
_DETERMINED = 1e-2
_LONGEST_DEFAULT = 2048
_SINGULAR = 1e-11


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
    if method == "approximate":
        corrected = problem.options.get("half_sample_correction")
        gains["half_sample"] = "corrected" if corrected else "printed"
    if method == "least_squares":
        gains["deviations"] = equations.relative_deviations(problem.plant.output)
    if method not in equations.NEED_L:
        yield Candidate(method, _completed(problem, gains))
    elif "L" in problem.gains:
        yield Candidate(method, _completed(problem, gains | {"L": problem.gains["L"]}))
    else:
        completed = _completed(problem, gains | {"L": _injection(problem, k)})
        yield Candidate(method, completed, searched=True)


def _injection(problem: Problem, k: int) -> Any:
    """L by the objective; any L where the samples do not determine the state with any."""
    A, C = problem.plant.flow.A, problem.plant.output.C
    if _reach(A, C, float(problem.plant.output.period or 1.0), k) < _SINGULAR:
        return C.T
    return chosen_injection(problem, k)


def _completed(problem: Problem, gains: dict[str, Any]) -> dict[str, Any]:
    """With the gains on the window and what they may be off by."""
    gains = gains | {"window_gain": _window_gain(problem, gains)}
    return gains if gains["method"] == "approximate" else gains | _errors(gains)


def _disturbed(plant: dict[str, Any]) -> bool:
    moved = np.any(plant["flow_lower"] != plant["flow_upper"])
    return bool(moved or np.any(plant["noise_bound"]))


def _samples(problem: Problem) -> int:
    """k, given or chosen by the objective, else by how well the window determines the state."""
    plant, period = problem.plant, float(problem.plant.output.period or 1.0)
    if "window" in problem.options:
        return equations.window_samples(problem.options["window"], period)
    A, C, objective = plant.flow.A, plant.output.C, problem.options.get("objective")
    shortest = next((k for k in range(1, plant.n + 1) if _reach(A, C, period, k) > _SINGULAR), None)
    k: int | None = None
    if objective == "shortest_window":
        k = shortest
    by_13 = objective in ("shortest_window", "longest_period") and np.any(A)
    if by_13 and shortest is not None and problem.options.get("method") in equations.NEED_L:
        k = _samples_for_13(A, C, problem.gains.get("L"), period, shortest, str(objective))
    return _well_determined(A, C, period) if k is None else k


def _samples_for_13(
    A: Any, C: Any, L: Any, period: float, least: int, objective: str
) -> int | None:
    """The shortest window for which (13) holds, or the one that allows the longest period."""
    if objective == "shortest_window":
        return fewest_samples(A, C, L, period, least)[0]
    window = best_injection(A, C, None, L).window
    return int(min(max(round(window / period), least), equations.MOST_SAMPLES))


def _well_determined(A: Any, C: Any, period: float) -> int:
    """The first of n, 2 n, 4 n, ... samples that determines the state well, else the best."""
    counts = [len(A)]
    while 2 * counts[-1] <= _LONGEST_DEFAULT:
        counts.append(2 * counts[-1])
    found = []
    for k in counts:
        found.append((_reach(A, C, period, k), k))
        if found[-1][0] >= _DETERMINED:
            return k
    return max(found, key=lambda entry: entry[0])[1]


def _reach(A: Any, C: Any, period: float, k: int) -> float:
    rows = equations.sample_rows(A, C, period, k).reshape(-1, len(A))
    return equations.approx_determinacy(rows, equations.state_scales(A, C, k * period))


def _window_gain(problem: Problem, gains: dict[str, Any]) -> Any:
    """Gains (n, k p) of the method; zeros, which are refuted, where it has none in binary64."""
    A, C, k, method = gains["A"], gains["C"], gains["samples"], gains["method"]
    nothing = np.zeros((len(A), k * len(C)))
    rows = equations.sample_rows(A, C, gains["period"], k)
    flat = rows.reshape(-1, len(A))
    if equations.approx_determinacy(flat, np.ones(len(A))) == 0.0:
        return nothing
    fitted = equations.least_squares_gain(
        flat, np.tile(equations.relative_deviations(problem.plant.output), k)
    )
    if method == "least_squares":
        return equations.made_unbiased(fitted, flat, fitted)
    if method == "minimax":
        found = minimax_gain(gains, rows)
        return nothing if found is None else equations.made_unbiased(found, flat, fitted)
    found = _formula(gains)
    return nothing if found is None or not np.isfinite(found).all() else found


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


def _errors(gains: dict[str, Any]) -> dict[str, Any]:
    """radius (n,), state_error (n, n): what the stored gains may be off by, rounded upwards."""
    with precision(_BITS[0]):
        sampled = Sampled.of(gains["A"], gains["C"], gains["period"], gains["samples"])
        gain = gains["window_gain"]
        sizes = error_radius(sampled, gain, gains["noise_bound"], disturbance_bound(gains))
        error = exact(gain) @ sampled.rows() - entries(identity(len(gains["A"])))
        state_error = np.array([[float_above(abs(x)) for x in row] for row in error])
        return {
            "radius": np.array([float_above(scalar(x)) if x > 0 else 0.0 for x in sizes]),
            "state_error": np.where(np.isfinite(state_error), state_error, 1e300),
        }
