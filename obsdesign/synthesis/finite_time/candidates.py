"""Finite-time estimation: candidates for L where the method has one, on the window (`window_gain`).

Where the window is open too and its samples do not carry the method's matrix, longer ones follow;
where only units hide an L, it is looked for in those of the window.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from obsdesign.equations.finite_time import gains as equations
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.finite_time.injection import Injection, Open, best_injection
from obsdesign.synthesis.finite_time.least_noise import quiet_injection
from obsdesign.synthesis.finite_time.window_gain import completed
from obsdesign.synthesis.finite_time.window_length import BY_13, SINGULAR, chosen_samples

# windows that are tried in turn, in terms of the first
_LONGER = (1, 4, 16)


def synthesize(problem: Problem) -> Iterator[Candidate]:
    """One candidate; InputError for what cannot be built at all."""
    problem.require_measured("periodic")
    text = equations.objection(problem.plant, problem.options)
    if text := text or equations.objective_objection(problem.options, "L" in problem.gains):
        raise InputError(text)
    method = problem.options.get("method", "least_squares")
    plant = equations.stored_plant(problem.plant)
    if method == "minimax":
        problem.require_noise_bound("observer.method = 'minimax'")
        if not _disturbed(plant):
            raise InputError(
                "observer.method = 'minimax' needs a nonzero output.noise_bound or "
                "flow.disturbance: it makes the largest error small, and without either there is "
                "none."
            )
    k = chosen_samples(problem)
    gains = plant | {"method": method, "samples": k}
    if method == "approximate":
        corrected = problem.options.get("half_sample_correction")
        gains["half_sample"] = "corrected" if corrected else "printed"
    if method == "least_squares":
        gains["deviations"] = equations.relative_deviations(problem.plant.output)
    if method in equations.NEED_L:
        yield from _with_injection(problem, gains)
    else:
        yield Candidate(method, completed(problem, gains), searched="window" not in problem.options)


def _with_injection(problem: Problem, gains: dict[str, Any]) -> Iterator[Candidate]:
    """L in the units of the file, then in those of the window; then longer windows, where open."""
    open_gain, open_window = "L" not in problem.gains, "window" not in problem.options
    free = open_window and "objective" not in problem.options
    for factor in _LONGER if free else (1,):
        k = factor * int(gains["samples"])
        if k > equations.MOST_SAMPLES:
            return
        units = _units(problem, k)
        for natural in (False, True) if open_gain and (units != units[0]).any() else (False,):
            chosen = _injection(problem, k, units if natural else None)
            S = {} if chosen.S is None else {"theorem_1_coordinates": {"S": chosen.S}}
            found = completed(problem, gains | {"samples": k, "L": chosen.L})
            searched = open_gain or open_window
            yield Candidate(str(gains["method"]), found, S, searched=searched)
        if _blind(problem, k):
            return  # no units would change that, and `chosen_samples` has compared windows


def _blind(problem: Problem, k: int) -> bool:
    plant, period = problem.plant, float(problem.plant.output.period or 1.0)
    return equations.approx_reach(plant.flow.A, plant.output.C, period, k) < SINGULAR


def _units(problem: Problem, k: int) -> Any:
    plant = problem.plant
    return equations.state_scales(
        plant.flow.A, plant.output.C, k * float(plant.output.period or 1.0)
    )


def _injection(problem: Problem, k: int, units: Any = None) -> Injection:
    """L, given or by the objective, and S where only with it (13) holds, if that is the objective.

    Any L where the samples do not determine the state with any. units, (n,): the norms of (13) are
    those of states in these.
    """
    A, C, L = problem.plant.flow.A, problem.plant.output.C, problem.gains.get("L")
    period = float(problem.plant.output.period or 1.0)
    window, objective = k * period, problem.options.get("objective")
    blind = _blind(problem, k)
    if L is not None and (blind or objective not in BY_13 or not np.any(L @ C)):
        return Injection(L, window, -math.inf)
    if blind:
        return Injection(C.T, window, -math.inf)
    if not np.any(A):
        size = max(float(np.linalg.norm(C)) ** 2, 1e-300) * window
        return Injection(C.T / size if L is None else L, window, math.inf)
    if units is not None:
        found = best_injection(Open(A * units / units[:, None], C * units, window))
        return Injection(found.L * units[:, None], window, -math.inf)
    asked = Open(A, C, window, L)
    plain = asked.rated(L, window) if L is not None else best_injection(asked)
    if objective == "least_noise":
        method = str(problem.options.get("method"))
        quiet = quiet_injection(A, C, plain.L, period, k, method)
        return Injection(quiet, window, -math.inf)
    if objective not in BY_13 or plain.log_period > math.log(period):
        return plain
    found = best_injection(Open(A, C, window, L, coordinates=True), (plain,))
    return found if found.log_period > math.log(period) else plain


def _disturbed(plant: dict[str, Any]) -> bool:
    moved = np.any(plant["flow_lower"] != plant["flow_upper"])
    return bool(moved or np.any(plant["noise_bound"]))
