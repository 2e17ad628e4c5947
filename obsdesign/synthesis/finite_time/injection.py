"""Search for L of finite-time estimation, and with it the window and coordinates S.

L makes the period of condition (13) long: IPOPT from several starts (`period_program`), then
quasi-Newton steps, and Nelder and Mead on the true norms. Without these two the longest period is
0.1 to 9 per cent shorter in 20 of 25 cases (the example, the double integrator, random plants; L,
T and S open or not), once by 82 per cent; with one of the two alone by up to 82 or 9.

Small L allow long periods, and are bounded below (`SMALLEST_GAIN`). S only changes the norms of
Theorem 1, which then bounds |S x|. Searches end after some iterations and evaluations with the best
so far. Floats only, without proof.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.solvers import merged
from lmi.time_budget import Remark, TimeBudget, remark_end
from obsdesign.equations.finite_time.condition_13 import approx_log_longest_period
from obsdesign.equations.finite_time.gains import MOST_SAMPLES
from obsdesign.synthesis.finite_time.period_descent import polished
from obsdesign.synthesis.finite_time.period_problem import (
    Injection,
    PeriodProblem,
    normal_coordinates,
    triangular,
)
from obsdesign.synthesis.finite_time.period_program import PeriodProgram, Start

# starts of IPOPT, each the better one of so many
_STARTS, _SCREENED = 6, 4
# |L| of the first guess relative to |A| / |C|
_FIRST_GAIN = 1e-3


@dataclass(frozen=True)
class Effort:
    """Largest effort of one search, which a stretched budget multiplies.

    iterations: of IPOPT, over all of its starts; 0: it is not used. evaluations: of the period in
    the descent that follows.
    """

    iterations: int = 400
    evaluations: int = 2000

    def times(self, factor: int) -> Effort:
        """So many times as much."""
        return Effort(factor * self.iterations, factor * self.evaluations)


EFFORT = Effort()  # some 0.6 seconds


def best_injection(
    problem: PeriodProblem,
    budget: TimeBudget,
    first: Sequence[Injection] = (),
    *,
    effort: Effort = EFFORT,
    target: float = math.inf,
) -> Injection:
    """The longest period of (13) over the free variables; at least those of `first`.

    target: log of a period beyond which the search ends. The remarks are those of this search, the
    solvers also those that led to `first`.
    """
    known = [problem.rated(guess.L, problem.window or guess.window, guess.S) for guess in first]
    solvers = merged(*(guess.solvers for guess in first))
    guesses = [*known, *_guesses(problem)]
    if effort.iterations and (problem.L is None or problem.coordinates):
        solutions = _program_solutions(problem, budget.scaled(effort.iterations), budget)
        solvers = merged(solvers, ("IPOPT",) if solutions else ())
        guesses += solutions
    best = replace(max(guesses, key=_log_period), solvers=solvers)
    better = polished(problem, best, budget, effort.evaluations, target)
    return replace(max(better, best, key=_log_period), remarks=better.remarks)


def _log_period(injection: Injection) -> float:
    return injection.log_period


def _guesses(problem: PeriodProblem) -> list[Injection]:
    A, C = problem.A, problem.C
    size = float(np.linalg.norm(A, 2)) or 1.0
    windows = [problem.window] if problem.window else [x / size for x in (0.1, 0.3, 1.0, 3.0)]
    small = _FIRST_GAIN * size / float(np.linalg.norm(C, 2)) ** 2
    gains = [problem.L]
    if problem.L is None:
        gains = [small * C.T, -small * C.T, small * np.ones_like(C.T)]
    guesses = [problem.rated(L, T) for L in gains for T in windows if L is not None]
    normal = normal_coordinates(A) if problem.coordinates else None
    if normal is not None:
        S = triangular(normal, len(A))
        guesses += [problem.rated(guess.L, guess.window, S) for guess in guesses]
    return guesses


def _program_solutions(
    problem: PeriodProblem, iterations: int, budget: TimeBudget
) -> list[Injection]:
    """Solutions of IPOPT from the better ones of random starts, until the iterations are spent."""
    seconds = budget.remaining()
    if seconds <= 0:
        return []
    program = PeriodProgram(problem, max(seconds, 0.05))

    def rating(start: Start) -> float:
        n, p = len(problem.A), len(problem.C)
        L = start.size * start.direction.reshape(p, n).T if problem.L is None else problem.L
        S = None if start.triangle is None else triangular(start.triangle, n)
        return problem.rated(L, start.window, S).log_period

    ranked = sorted(program.starts(_SCREENED * _STARTS), key=rating, reverse=True)
    solutions = []
    for start in ranked[:_STARTS]:
        point = program.solve(start)
        if point.is_finite:
            solutions.append(problem.rated(point.L, point.window, point.S))
        iterations -= point.iterations
        if iterations <= 0 or budget.remaining() < 0:
            break
    return solutions


# --- the fewest samples ---------------------------------------------------------------------------

_BISECTION_EFFORT = Effort(iterations=0, evaluations=700)
# bisections from other starts, with that many of the samples of the one before
_ROUNDS, _FEWER = 4, 0.9


def fewest_samples(
    problem: PeriodProblem, period: float, least: int, budget: TimeBudget
) -> tuple[int | None, Injection]:
    """Fewest samples, at least `least`, with (13) in floats, and its L, T, S; None: none.

    For a given L all numbers are tried upwards; else by bisection below the best window. The
    remarks are those of all searches.
    """
    A, L = problem.A, problem.L
    log_period = math.log(period)
    if not np.any(A):
        return least, Injection(problem.C.T if L is None else L, least * period, math.inf)
    if L is not None and not problem.coordinates:
        return _scanned(problem, L, period, least, budget)
    best = best_injection(problem, budget)
    remarks = best.remarks
    if best.log_period <= log_period:
        return None, best
    high = max(least, math.floor(best.window / period))
    chosen = _for_window(problem, high * period, best, log_period, budget)
    remarks += chosen.remarks
    for _ in range(_ROUNDS):
        high, chosen, more = _bisected(problem, period, (least - 1, high), chosen, budget)
        remarks += more
        if high <= least:
            break
        # further starts, as bisection begins at the last solution only
        fewer = max(least, math.floor(_FEWER * high))
        shorter = replace(problem, window=fewer * period)
        retried = best_injection(
            shorter, budget, (chosen,), effort=EFFORT.times(2), target=log_period
        )
        remarks += retried.remarks
        if retried.log_period <= log_period:
            break
        high, chosen = fewer, retried
    if chosen.log_period <= log_period:
        chosen = best_injection(replace(problem, window=high * period), budget, (best,))
        remarks += chosen.remarks
    return high, replace(chosen, remarks=remarks)


def _bisected(
    problem: PeriodProblem,
    period: float,
    ends: tuple[int, int],
    best: Injection,
    budget: TimeBudget,
) -> tuple[int, Injection, tuple[Remark, ...]]:
    """The fewest samples between the ends, of which (13) holds with `best` at the second."""
    low, high = ends
    remarks: tuple[Remark, ...] = ()
    while high - low > 1:
        middle = (low + high) // 2
        solution = _for_window(problem, middle * period, best, math.log(period), budget)
        remarks += solution.remarks
        if solution.log_period > math.log(period):
            high, best = middle, solution
        else:
            low = middle
    return high, best, remarks


def _for_window(
    problem: PeriodProblem, window: float, near: Injection, target: float, budget: TimeBudget
) -> Injection:
    """The best injection near another one, for a fixed window."""
    fixed = replace(problem, window=window)
    return best_injection(fixed, budget, (near,), effort=_BISECTION_EFFORT, target=target)


def _scanned(
    problem: PeriodProblem, L: Matrix, period: float, least: int, budget: TimeBudget
) -> tuple[int | None, Injection]:
    # beyond some ten time constants M_T is rounding
    most = math.ceil(60.0 / (np.linalg.norm(problem.A, 2) * period))
    remarks: tuple[Remark, ...] = ()
    for k in range(least, max(min(MOST_SAMPLES, most), least) + 1):
        value = approx_log_longest_period(
            problem.A, problem.C, L, k * period, tighter=problem.tighter
        )
        if value > math.log(period):
            return k, Injection(L, k * period, value)
        if remarks := remark_end("the shortest window", budget.ended()):
            break
    return None, Injection(L, least * period, -math.inf, remarks=remarks)
