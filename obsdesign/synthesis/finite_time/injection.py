"""Search for L of finite-time estimation, and with it the window and coordinates S.

L makes the period of condition (13) long: IPOPT from several starts (`period_program`), then
quasi-Newton steps, and Nelder and Mead on the true norms, which close the last per cent. Small L
allow long periods, and are bounded below (`SMALLEST_GAIN`). S only changes the norms of Theorem 1,
which then bounds |S x|. Searches end after some processor time with the best so far. Floats only,
without proof.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.time_budget import deadline, ended, remark_end
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
# processor time of one search, and the part of it that IPOPT may have
SECONDS, _PROGRAM_PART = 0.6, 0.5
# |L| of the first guess relative to |A| / |C|
_FIRST_GAIN = 1e-3


def best_injection(
    problem: PeriodProblem,
    first: Sequence[Injection] = (),
    *,
    starts: int = _STARTS,
    seconds: float = SECONDS,
    target: float = math.inf,
) -> Injection:
    """The longest period of (13) over the free variables; at least those of `first`.

    target: log of a period beyond which the search ends.
    """
    end = deadline(seconds)
    known = [problem.rated(guess.L, problem.window or guess.window, guess.S) for guess in first]
    guesses = [*known, *_guesses(problem)]
    if starts and (problem.L is None or problem.coordinates):
        guesses += _program_solutions(problem, starts, deadline(_PROGRAM_PART * seconds))
    best = max(guesses, key=_log_period)
    return max(polished(problem, best, end, seconds, target), best, key=_log_period)


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


def _program_solutions(problem: PeriodProblem, starts: int, end: float) -> list[Injection]:
    """Solutions of IPOPT from the better ones of random starts, until the time is over."""
    seconds = end - time.process_time()
    if seconds <= 0:
        return []
    program = PeriodProgram(problem, max(seconds / 2, 0.05))

    def rating(start: Start) -> float:
        n, p = len(problem.A), len(problem.C)
        L = start.size * start.direction.reshape(p, n).T if problem.L is None else problem.L
        S = None if start.triangle is None else triangular(start.triangle, n)
        return problem.rated(L, start.window, S).log_period

    ranked = sorted(program.starts(_SCREENED * starts), key=rating, reverse=True)
    solutions = []
    for start in ranked[:starts]:
        point = program.solve(start)
        if point.is_finite:
            solutions.append(problem.rated(point.L, point.window, point.S))
        if time.process_time() > end:
            break
    return solutions


# --- the fewest samples ---------------------------------------------------------------------------

_BISECTION_SECONDS, _SCAN_SECONDS = 0.15, 10.0
# bisections from other starts, with that many of the samples of the one before
_ROUNDS, _FEWER = 4, 0.9


def fewest_samples(
    problem: PeriodProblem, period: float, least: int
) -> tuple[int | None, Injection]:
    """Fewest samples, at least `least`, with (13) in floats, and its L, T, S; None: none.

    For a given L all numbers are tried upwards; else by bisection below the best window.
    """
    A, L = problem.A, problem.L
    log_period = math.log(period)
    if not np.any(A):
        return least, Injection(problem.C.T if L is None else L, least * period, math.inf)
    if L is not None and not problem.coordinates:
        return _scanned(problem, L, period, least)
    best = best_injection(problem)
    if best.log_period <= log_period:
        return None, best
    high = max(least, math.floor(best.window / period))
    chosen = _for_window(problem, high * period, best, log_period)
    for _ in range(_ROUNDS):
        high, chosen = _bisected(problem, period, (least - 1, high), chosen)
        if high <= least:
            break
        # further starts, as bisection begins at the last solution only
        fewer = max(least, math.floor(_FEWER * high))
        shorter = replace(problem, window=fewer * period)
        retried = best_injection(shorter, (chosen,), seconds=2 * SECONDS, target=log_period)
        if retried.log_period <= log_period:
            break
        high, chosen = fewer, retried
    if chosen.log_period <= log_period:
        chosen = best_injection(replace(problem, window=high * period), (best,))
    return high, chosen


def _bisected(
    problem: PeriodProblem, period: float, ends: tuple[int, int], best: Injection
) -> tuple[int, Injection]:
    """The fewest samples between the ends, of which (13) holds with `best` at the second."""
    low, high = ends
    while high - low > 1:
        middle = (low + high) // 2
        solution = _for_window(problem, middle * period, best, math.log(period))
        if solution.log_period > math.log(period):
            high, best = middle, solution
        else:
            low = middle
    return high, best


def _for_window(problem: PeriodProblem, window: float, near: Injection, target: float) -> Injection:
    """The best injection near another one, for a fixed window."""
    fixed = replace(problem, window=window)
    return best_injection(fixed, (near,), starts=0, seconds=_BISECTION_SECONDS, target=target)


def _scanned(
    problem: PeriodProblem, L: Matrix, period: float, least: int
) -> tuple[int | None, Injection]:
    # beyond some ten time constants M_T is rounding
    most = math.ceil(60.0 / (np.linalg.norm(problem.A, 2) * period))
    end = deadline(_SCAN_SECONDS)
    for k in range(least, max(min(MOST_SAMPLES, most), least) + 1):
        value = approx_log_longest_period(
            problem.A, problem.C, L, k * period, tighter=problem.tighter
        )
        if value > math.log(period):
            return k, Injection(L, k * period, value)
        if time.process_time() > end:
            remark_end("the shortest window", ended(end, _SCAN_SECONDS))
            break
    return None, Injection(L, least * period, -math.inf)
