"""Finite-time estimation: the window, L where the method has one, and the gains on the window.

Gains of (14) and (9) come from ball enclosures and are rounded once, so that a matrix with a bad
condition costs no digits; least squares by QR; minimax by a linear program per state. What should
be unbiased is made so to rounding before it is stored.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from lmi.balls import precision, scalar
from lmi.norms import float_above, middles
from lmi.patience import remark
from obsdesign.equations import finite_time as equations
from obsdesign.errors import InputError
from obsdesign.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.finite_time_injection import (
    Injection,
    Open,
    best_injection,
    fewest_samples,
)
from obsdesign.synthesis.finite_time_noise import quiet_injection, quiet_samples
from obsdesign.synthesis.minimax import minimax_gain
from obsdesign.window_bounds import bias, disturbance_bound, error_radius
from obsdesign.window_gains import Sampled, approximate_gain, exact_gain, half_period

_BITS = (160, 320)
# a default window is doubled until its scaled rows are that far from losing rank
_DETERMINED = 1e-2
_LONGEST_DEFAULT = 2048
_SINGULAR = 1e-11
# a bias above is corrected once more, with exact numbers
_ROUNDING = 1e-13
_BY_13 = ("longest_period", "shortest_window")


def synthesize(problem: Problem) -> Iterator[Candidate]:
    """One candidate; InputError for what cannot be built at all."""
    problem.require_measured("periodic")
    text = equations.objection(problem.plant, problem.options)
    if text := text or equations.objective_objection(problem.options):
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
        return
    chosen = _injection(problem, k)
    S = {} if chosen.S is None else {"theorem_1_coordinates": {"S": chosen.S}}
    completed = _completed(problem, gains | {"L": chosen.L})
    yield Candidate(method, completed, S, searched="L" not in problem.gains)


def _injection(problem: Problem, k: int) -> Injection:
    """L, given or by the objective, and S where only with it (13) holds, if that is the objective.

    Any L where the samples do not determine the state with any.
    """
    A, C, L = problem.plant.flow.A, problem.plant.output.C, problem.gains.get("L")
    period = float(problem.plant.output.period or 1.0)
    window, objective = k * period, problem.options.get("objective")
    blind = equations.approx_reach(A, C, period, k) < _SINGULAR
    if L is not None and (blind or objective not in _BY_13 or not np.any(L @ C)):
        return Injection(L, window, -math.inf)
    if blind:
        return Injection(C.T, window, -math.inf)
    if not np.any(A):
        size = max(float(np.linalg.norm(C)) ** 2, 1e-300) * window
        return Injection(C.T / size if L is None else L, window, math.inf)
    asked = Open(A, C, window, L)
    plain = asked.rated(L, window) if L is not None else best_injection(asked)
    if objective == "least_noise":
        method = str(problem.options.get("method"))
        quiet = quiet_injection(A, C, plain.L, period, k, method)
        return Injection(quiet, window, -math.inf)
    if objective not in _BY_13 or plain.log_period > math.log(period):
        return plain
    found = best_injection(Open(A, C, window, L, coordinates=True), (plain,))
    return found if found.log_period > math.log(period) else plain


def _completed(problem: Problem, gains: dict[str, Any]) -> dict[str, Any]:
    """With the gains on the window and what they may be off by.

    Against the last state; where that is hopeless, as fast modes have decayed, against the first.
    """
    chosen = gains | {"window_gain": _window_gain(problem, gains)}
    if gains["method"] == "approximate":
        return chosen
    chosen, error, size = _refined(chosen)
    if not size <= equations.UNBIASED and np.linalg.eigvals(gains["A"]).real.min() < 0:
        other = gains | {"reference": equations.START}
        other |= {"window_gain": _window_gain(problem, other)}
        other, of_other, smaller = _refined(other)
        if smaller <= equations.UNBIASED:
            chosen, error = other, of_other
    return chosen | {"radius": _radius(chosen), "state_error": error}


def _disturbed(plant: dict[str, Any]) -> bool:
    moved = np.any(plant["flow_lower"] != plant["flow_upper"])
    return bool(moved or np.any(plant["noise_bound"]))


def _samples(problem: Problem) -> int:
    """k, given or chosen by the objective, else by how well the window determines the state."""
    plant, period = problem.plant, float(problem.plant.output.period or 1.0)
    if "window" in problem.options:
        return equations.window_samples(problem.options["window"], period)
    A, C, objective = plant.flow.A, plant.output.C, problem.options.get("objective")
    shortest = next(
        (k for k in range(1, plant.n + 1) if equations.approx_reach(A, C, period, k) > _SINGULAR),
        None,
    )
    k: int | None = None
    if objective == "shortest_window":
        k = shortest
    by_13 = objective in _BY_13 and np.any(A)
    if by_13 and shortest is not None and problem.options.get("method") in equations.NEED_L:
        k = _samples_for_13(Open(A, C, None, problem.gains.get("L")), period, shortest, objective)
    if objective == "least_noise" and shortest is not None:
        enough = [
            n for n in _counts(plant.n) if equations.approx_reach(A, C, period, n) >= _DETERMINED
        ]
        k = quiet_samples(plant, enough) if enough else None
    return _well_determined(A, C, period) if k is None else k


def _samples_for_13(asked: Open, period: float, least: int, objective: Any) -> int | None:
    """The shortest window for which (13) holds, if need be in coordinates S, or the best one."""
    if objective == "shortest_window":
        k = fewest_samples(asked, period, least)[0]
        return k or fewest_samples(replace(asked, coordinates=True), period, least)[0]
    window = best_injection(asked).window
    return int(min(max(round(window / period), least), equations.MOST_SAMPLES))


def _well_determined(A: Any, C: Any, period: float) -> int:
    """The first of n, 2 n, ... samples that determines the state well, or half as well as any."""
    found = []
    for k in _counts(len(A)):
        found.append((equations.approx_reach(A, C, period, k), k))
        if found[-1][0] >= _DETERMINED:
            return k
    best = max(reach for reach, _ in found)
    return next(k for reach, k in found if reach >= best / 2)


def _counts(n: int) -> list[int]:
    counts = [n]
    while 2 * counts[-1] <= _LONGEST_DEFAULT:
        counts.append(2 * counts[-1])
    return counts


def _window_gain(problem: Problem, gains: dict[str, Any]) -> Any:
    """Gains (n, k p) of the method; zeros, which are refuted, where it has none in binary64."""
    A, C, k, method = gains["A"], gains["C"], gains["samples"], gains["method"]
    nothing = np.zeros((len(A), k * len(C)))
    reference = gains.get("reference", equations.END)
    rows = equations.sample_rows(A, C, gains["period"], k, reference)
    wanted = equations.last_state(A, k * gains["period"], reference)
    flat = rows.reshape(-1, len(A))
    if equations.approx_determinacy(flat, np.ones(len(A))) == 0.0:
        return nothing
    left = equations.least_squares_gain(
        flat, np.tile(equations.relative_deviations(problem.plant.output), k)
    )
    fitted = wanted @ left
    if method == "least_squares":
        return equations.made_unbiased(fitted, flat, left, wanted)
    if method == "minimax":

        def project(gain: Any) -> Any:
            return equations.made_unbiased(gain, flat, left, wanted)

        found, kept = minimax_gain(gains, project(fitted), project)
        if kept:
            told = ", ".join(f"x{r + 1}" for r in kept)
            remark(
                f"minimax: the solvers find nothing better for {told} than least squares, whose "
                "gains are used for it"
            )
        return found
    found = _formula(gains)
    return nothing if found is None or not np.isfinite(found).all() else found


def _formula(gains: dict[str, Any]) -> Any:
    """(14), or (9) with (16), rounded from an enclosure that is tight enough."""
    for bits in _BITS:
        with precision(bits):
            sampled = _sampled(gains)
            if gains["method"] == "exact":
                found = exact_gain(sampled, gains["L"])[1]
            else:
                found = approximate_gain(sampled, gains["L"])
                if found is not None and gains["half_sample"] == "corrected":
                    found = half_period(sampled) @ found
            if found is not None:
                return middles(found)
    return None


def _radius(gains: dict[str, Any]) -> Any:
    """(n,): what noise and disturbance inside their bounds do to the estimate, rounded upwards."""
    with precision(_BITS[0]):
        sizes = error_radius(
            _sampled(gains), gains["window_gain"], gains["noise_bound"], disturbance_bound(gains)
        )
        return np.array([float_above(scalar(x)) if x > 0 else 0.0 for x in sizes])


def _refined(gains: dict[str, Any]) -> tuple[dict[str, Any], Any, float]:
    """Gains made unbiased once more; state_error (n, n); the latter's size, units scaled away.

    With exact numbers: floats alone leave a bias that is amplified twice.
    """
    with precision(_BITS[0]):
        sampled = _sampled(gains)
        error, size = bias(sampled, gains["window_gain"])
        free = gains["method"] not in equations.NEED_L
        if free and _ROUNDING < float_above(size) < 1:
            moved = _less(gains, sampled, error)
            of_moved, smaller = bias(sampled, moved["window_gain"])
            if float_above(smaller) < float_above(size):
                gains, error, size = moved, of_moved, smaller
        found = np.array([[float_above(abs(x)) for x in row] for row in error])
        return gains, np.where(np.isfinite(found), found, 1e300), float_above(size)


def _less(gains: dict[str, Any], sampled: Sampled, error: Any) -> dict[str, Any]:
    """The gains less an error (n, n) of G O."""
    rows = equations.sample_rows(
        gains["A"], gains["C"], gains["period"], gains["samples"], sampled.reference
    ).reshape(-1, len(error))
    try:
        left = equations.least_squares_gain(rows, np.ones(len(rows)))
    except np.linalg.LinAlgError:
        return gains
    return gains | {"window_gain": gains["window_gain"] - middles(error) @ left}


def _sampled(gains: dict[str, Any]) -> Sampled:
    reference = gains.get("reference", equations.END)
    return Sampled.of(gains["A"], gains["C"], gains["period"], gains["samples"], reference)
