"""Finite-time estimation: candidates for L where the method has one, and the window.

Where the window is open too and its samples do not carry the method's matrix, longer ones follow;
where only units hide an L, it is searched in those of the window.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.equations.finite_time.options import (
    MOST_SAMPLES,
    NEED_L,
    reason_against_objective,
    reason_against_problem,
)
from obsdesign.equations.finite_time.rows import approx_window_determinacy
from obsdesign.equations.gains import Array
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.finite_time.injection import best_injection
from obsdesign.synthesis.finite_time.least_noise import low_noise_injection
from obsdesign.synthesis.finite_time.period_problem import Injection, PeriodProblem
from obsdesign.synthesis.finite_time.window_gain import completed_gains
from obsdesign.synthesis.finite_time.window_length import (
    CONDITION_13_OBJECTIVES,
    SINGULAR,
    chosen_samples,
)
from obsdesign.synthesis.finite_time.window_task import WindowTask

# windows that are tried in turn, in terms of the first
_LONGER = (1, 4, 16)


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield candidates in order of preference; InputError for a problem that has none."""
    problem.require_measured("periodic")
    reason = reason_against_problem(problem.plant, problem.options)
    reason = reason or reason_against_objective(problem.options, "L" in problem.gains)
    if reason is not None:
        raise InputError(reason)
    method = problem.options.get("method", "least_squares")
    if method == "minimax":
        problem.require_noise_bound("observer.method = 'minimax'")
        if not _is_disturbed(problem):
            raise InputError(
                "observer.method = 'minimax' needs a nonzero output.noise_bound or "
                "flow.disturbance: it makes the largest error small, and without either there is "
                "none."
            )
    samples, remarks = chosen_samples(problem, budget)
    if method in NEED_L:
        candidates = _with_injection(problem, samples, budget)
    else:
        gains, more = completed_gains(WindowTask.from_problem(problem, samples))
        is_searched = "window" not in problem.options
        candidates = iter([Candidate(method, gains, searched=is_searched, remarks=more)])
    for candidate in candidates:
        yield replace(candidate, remarks=remarks + candidate.remarks)
        remarks = ()


def _with_injection(problem: Problem, samples: int, budget: TimeBudget) -> Iterator[Candidate]:
    """L in the units of the file, then in those of the window; then longer windows, where open."""
    open_gain, open_window = "L" not in problem.gains, "window" not in problem.options
    free = open_window and "objective" not in problem.options
    for factor in _LONGER if free else (1,):
        k = factor * samples
        if k > MOST_SAMPLES:
            return
        units = WindowTask.from_problem(problem, k).scales
        for natural in (False, True) if open_gain and (units != units[0]).any() else (False,):
            chosen = _injection(problem, k, budget, units if natural else None)
            S = {} if chosen.S is None else {"theorem_1_coordinates": {"S": chosen.S}}
            task = WindowTask.from_problem(problem, k, chosen.L)
            searched = open_gain or open_window
            gains, remarks = completed_gains(task)
            remarks = chosen.remarks + remarks
            yield Candidate(task.method, gains, S, searched=searched, remarks=remarks)
        if _is_undetermined(problem, k):
            return  # no units would change that, and `chosen_samples` has compared windows


def _is_undetermined(problem: Problem, k: int) -> bool:
    """Do k samples leave a state undetermined, in floats?"""
    plant, period = problem.plant, float(problem.plant.output.period or 1.0)
    return approx_window_determinacy(plant.flow.A, plant.output.C, period, k) < SINGULAR


def _injection(
    problem: Problem, k: int, budget: TimeBudget, units: Array | None = None
) -> Injection:
    """L, given or by the objective; for objectives of (13) also S, if (13) needs it.

    Any L where the samples do not determine the state with any. units, (n,): the norms of (13) are
    those of states in these.
    """
    A, C, L = problem.plant.flow.A, problem.plant.output.C, problem.gains.get("L")
    window = k * float(problem.plant.output.period or 1.0)
    by_condition_13 = problem.options.get("objective") in CONDITION_13_OBJECTIVES
    is_undetermined = _is_undetermined(problem, k)
    if L is not None and (is_undetermined or not by_condition_13 or not np.any(L @ C)):
        return Injection(L, window, -math.inf)
    if is_undetermined:
        return Injection(C.T, window, -math.inf)
    if not np.any(A):
        size = max(float(np.linalg.norm(C)) ** 2, 1e-300) * window
        return Injection(C.T / size if L is None else L, window, math.inf)
    if units is not None:
        in_units = PeriodProblem(A * units / units[:, None], C * units, window)
        scaled = best_injection(in_units, budget)
        return Injection(scaled.L * units[:, None], window, -math.inf, remarks=scaled.remarks)
    return _searched_injection(problem, k, window, budget)


def _searched_injection(problem: Problem, k: int, window: float, budget: TimeBudget) -> Injection:
    """L for the objective, and S where (13) holds in these coordinates alone."""
    A, C, L = problem.plant.flow.A, problem.plant.output.C, problem.gains.get("L")
    period, objective = float(problem.plant.output.period or 1.0), problem.options.get("objective")
    fixed = PeriodProblem(A, C, window, L)
    plain = fixed.rated(L, window) if L is not None else best_injection(fixed, budget)
    if objective == "least_noise":
        method = str(problem.options.get("method"))
        L, remarks = low_noise_injection((A, C), plain.L, (period, k), method, budget)
        return Injection(L, window, -math.inf, remarks=plain.remarks + remarks)
    if objective not in CONDITION_13_OBJECTIVES or plain.log_period > math.log(period):
        return plain
    free = PeriodProblem(A, C, window, L, coordinates=True)
    transformed = best_injection(free, budget, (plain,))
    remarks = plain.remarks + transformed.remarks
    best = transformed if transformed.log_period > math.log(period) else plain
    return replace(best, remarks=remarks)


def _is_disturbed(problem: Problem) -> bool:
    """Is there a disturbance, or noise with a bound above zero?"""
    flow = problem.plant.flow
    return bool(np.any(flow.lower != flow.upper) or np.any(problem.plant.output.noise_radius))


def untried(problem: Problem) -> dict[str, str]:
    """Forms that are passed over, and why: none of this kind."""
    return {}
