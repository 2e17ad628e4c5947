"""Finite-time estimation: candidates for L where the method has one, and the window.

Where the window is open too and its samples do not carry the method's matrix, longer ones follow;
where only units hide an L, it is searched in those of the window.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.solvers import merged
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.finite_time.requirements import reason_against
from obsdesign.equations.finite_time.gains import NEED_L, most_samples
from obsdesign.equations.finite_time.rows import SINGULAR, approx_window_determinacy
from obsdesign.errors import InputError
from obsdesign.problem.options import FiniteTimeOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.finite_time.discrete_time import step_window
from obsdesign.synthesis.finite_time.injection import best_injection
from obsdesign.synthesis.finite_time.least_noise import low_noise_injection
from obsdesign.synthesis.finite_time.period_problem import Injection, PeriodProblem
from obsdesign.synthesis.finite_time.window_gain import completed_gains
from obsdesign.synthesis.finite_time.window_length import CONDITION_13_OBJECTIVES, chosen_window
from obsdesign.synthesis.finite_time.window_task import WindowTask

# windows that are tried in turn, in terms of the first
_LONGER = (1, 4, 16)


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield candidates in order of preference; InputError for a problem that has none."""
    if problem.plant.flow.dt is not None:
        yield from step_window(problem)
        return
    problem.require_measured("periodic")
    if reason := reason_against(problem):
        raise InputError(reason)
    options = problem.options_as(FiniteTimeOptions)
    if options.method == "minimax":
        _require_errors(problem)
    window = chosen_window(problem, budget)
    samples, remarks = window.samples, window.remarks
    if options.method in NEED_L:
        candidates = _with_injection(problem, options, samples, budget)
    else:
        completed = completed_gains(WindowTask.from_problem(problem, samples))
        candidate = Candidate(
            options.method,
            completed.gains,
            searched=options.window is None,
            remarks=completed.remarks,
            solvers=completed.solvers,
        )
        candidates = iter([candidate])
    for candidate in candidates:
        solvers = merged(window.solvers, candidate.solvers)
        yield replace(candidate, remarks=remarks + candidate.remarks, solvers=solvers)
        remarks = ()


def _require_errors(problem: Problem) -> None:
    """InputError unless there is a disturbance, or noise with a bound above zero."""
    noise = problem.require_noise_bound("observer.method = 'minimax'")
    flow = problem.plant.flow
    if not (np.any(np.not_equal(*flow.b_bounds)) or np.any(noise)):
        raise InputError(
            "observer.method = 'minimax' needs a nonzero output.noise_bound or flow.disturbance: "
            "it makes the largest error small, and without either there is none."
        )


def _with_injection(
    problem: Problem, options: FiniteTimeOptions, samples: int, budget: TimeBudget
) -> Iterator[Candidate]:
    """L in the units of the file, then in those of the window; then longer windows, where open."""
    open_gain, open_window = "L" not in problem.gains, options.window is None
    free = open_window and options.objective is None
    for factor in _LONGER if free else (1,):
        k = factor * samples
        if factor > 1 and k > most_samples(problem.plant.n):
            return
        units = WindowTask.from_problem(problem, k).scales
        for natural in (False, True) if open_gain and (units != units[0]).any() else (False,):
            chosen = _injection(problem, options, k, units if natural else None, budget)
            S = {} if chosen.S is None else {"theorem_1_coordinates": {"S": chosen.S}}
            task = WindowTask.from_problem(problem, k, chosen.L)
            searched = open_gain or open_window
            completed = completed_gains(task)
            yield Candidate(
                task.method,
                completed.gains,
                S,
                searched=searched,
                remarks=chosen.remarks + completed.remarks,
                solvers=merged(chosen.solvers, completed.solvers),
            )
        if _is_undetermined(problem, k):
            return  # no units would change that, and `chosen_window` has compared windows


def _is_undetermined(problem: Problem, k: int) -> bool:
    """Do k samples leave a state undetermined, in floats?"""
    A, output = problem.plant.flow.A, problem.plant.output
    return approx_window_determinacy(A, output.C, output.sample_period, k) < SINGULAR


def _injection(
    problem: Problem, options: FiniteTimeOptions, k: int, units: Matrix | None, budget: TimeBudget
) -> Injection:
    """L, given or by the objective; for objectives of (13) also S, if (13) needs it.

    Any L where the samples do not determine the state with any. units, (n,): the norms of (13) are
    those of states in these.
    """
    window = k * problem.plant.output.sample_period
    fixed = PeriodProblem.from_problem(problem, window)
    A, C, L = fixed.A, fixed.C, fixed.L
    by_condition_13 = options.objective in CONDITION_13_OBJECTIVES
    is_undetermined = _is_undetermined(problem, k)
    if L is not None and (is_undetermined or not by_condition_13 or fixed.has_zero_gain):
        return Injection(L, window, -math.inf)
    if is_undetermined:
        return Injection(C.T, window, -math.inf)
    if not np.any(A):
        size = max(float(np.linalg.norm(C)) ** 2, 1e-300) * window
        return Injection(C.T / size if L is None else L, window, math.inf)
    if units is not None:
        in_units = PeriodProblem(A * units / units[:, None], C * units, window)
        scaled = best_injection(in_units, budget)
        return replace(scaled, L=scaled.L * units[:, None], window=window, log_period=-math.inf)
    return _searched_injection(fixed, options, problem.plant.output.sample_period, k, budget)


def _searched_injection(
    problem: PeriodProblem, options: FiniteTimeOptions, period: float, k: int, budget: TimeBudget
) -> Injection:
    """L for the objective, and S where (13) holds in these coordinates alone."""
    A, C, L, window = problem.A, problem.C, problem.L, period * k
    plain = problem.rated(L, window) if L is not None else best_injection(problem, budget)
    if options.objective == "least_noise":
        L, remarks, solvers = low_noise_injection(
            (A, C), plain.L, (period, k), options.method, budget
        )
        remarks, solvers = plain.remarks + remarks, merged(plain.solvers, solvers)
        return Injection(L, window, -math.inf, remarks=remarks, solvers=solvers)
    by_condition_13 = options.objective in CONDITION_13_OBJECTIVES
    if not by_condition_13 or plain.log_period > math.log(period):
        return plain
    transformed = best_injection(replace(problem, coordinates=True), budget, (plain,))
    best = transformed if transformed.log_period > math.log(period) else plain
    return replace(best, remarks=plain.remarks + transformed.remarks)
