"""The window of finite-time estimation where it is left open: how many samples."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from lmi.time_budget import Remark, TimeBudget
from obsdesign.equations.finite_time.options import MOST_SAMPLES, NEED_L, window_samples
from obsdesign.equations.finite_time.rows import approx_window_determinacy
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.finite_time.injection import best_injection, fewest_samples
from obsdesign.synthesis.finite_time.least_noise import low_noise_samples
from obsdesign.synthesis.finite_time.period_problem import PeriodProblem

# a default window is doubled until its scaled rows are that far from losing rank
_DETERMINED = 1e-2
_LONGEST = 2048
# windows that are compared for their noise, per factor of two
_PER_OCTAVE = 4
SINGULAR = 1e-11
CONDITION_13_OBJECTIVES = ("longest_period", "shortest_window")


def chosen_samples(problem: Problem, budget: TimeBudget) -> tuple[int, tuple[Remark, ...]]:
    """Number of samples, given, or chosen by the objective or the determinacy of the window."""
    plant, period = problem.plant, float(problem.plant.output.period or 1.0)
    if "window" in problem.options:
        return window_samples(problem.options["window"], period), ()
    A, C, objective = plant.flow.A, plant.output.C, problem.options.get("objective")
    if objective is None:
        return _well_determined(A, C, period), ()
    fewest = math.ceil(plant.n / plant.p)
    shortest = next(
        (
            k
            for k in range(fewest, plant.n + 1)
            if approx_window_determinacy(A, C, period, k) > SINGULAR
        ),
        None,
    )
    k: int | None = None
    remarks: tuple[Remark, ...] = ()
    if objective == "shortest_window":
        k = shortest
    by_condition_13 = objective in CONDITION_13_OBJECTIVES and np.any(A)
    if by_condition_13 and shortest is not None and problem.options.get("method") in NEED_L:
        free = PeriodProblem(A, C, None, problem.gains.get("L"))
        k, remarks = _samples_for_13(free, period, shortest, objective, budget)
    if objective == "least_noise" and shortest is not None:
        counts = _counts(plant.n, _PER_OCTAVE)
        enough = [n for n in counts if approx_window_determinacy(A, C, period, n) >= _DETERMINED]
        k = low_noise_samples(plant, enough) if enough else None
    return _well_determined(A, C, period) if k is None else k, remarks


def _samples_for_13(
    problem: PeriodProblem, period: float, least: int, objective: Any, budget: TimeBudget
) -> tuple[int | None, tuple[Remark, ...]]:
    """Samples of the shortest window with (13), if need be in coordinates S, or of the best."""
    if objective == "shortest_window":
        k, shortest = fewest_samples(problem, period, least, budget)
        if k:
            return k, shortest.remarks
        transformed = replace(problem, coordinates=True)
        k, other = fewest_samples(transformed, period, least, budget)
        return k, shortest.remarks + other.remarks
    best = best_injection(problem, budget)
    return int(min(max(round(best.window / period), least), MOST_SAMPLES)), best.remarks


def _well_determined(A: Any, C: Any, period: float) -> int:
    """The first of n, 2 n, ... samples with a determinacy of _DETERMINED, or of half the best."""
    determinacies = []
    for k in _counts(len(A)):
        determinacies.append((approx_window_determinacy(A, C, period, k), k))
        if determinacies[-1][0] >= _DETERMINED:
            return k
    best = max(determinacy for determinacy, _ in determinacies)
    return next(k for determinacy, k in determinacies if determinacy >= best / 2)


def _counts(n: int, per_octave: int = 1) -> list[int]:
    """n, 2 n, 4 n, ... and as many in between."""
    octaves = max((_LONGEST // n).bit_length() - 1, 0)
    steps = range(octaves * per_octave + 1)
    return sorted({round(n * 2 ** (step / per_octave)) for step in steps})
