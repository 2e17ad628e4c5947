"""The window of finite-time estimation where it is left open: how many samples."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lmi.solvers import Solvers
from lmi.time_budget import Remark, TimeBudget
from obsdesign.analysis.finite_time.requirements import window_samples
from obsdesign.equations.finite_time.gains import MOST_SAMPLES, NEED_L, require_window
from obsdesign.equations.finite_time.rows import (
    approx_observability_index,
    approx_window_determinacy,
)
from obsdesign.problem.options import FiniteTimeOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.finite_time.injection import best_injection, fewest_samples
from obsdesign.synthesis.finite_time.least_noise import low_noise_samples
from obsdesign.synthesis.finite_time.period_problem import PeriodProblem

# a default window is doubled until its scaled rows are that far from losing rank
_DETERMINED = 1e-2
_LONGEST = 2048
# windows that are compared for their noise, per factor of two
_PER_OCTAVE = 4
CONDITION_13_OBJECTIVES = ("longest_period", "shortest_window")


@dataclass(frozen=True)
class WindowChoice:
    """Number of samples, the remarks of the search for it, and the solvers that led to it."""

    samples: int
    remarks: tuple[Remark, ...] = ()
    solvers: Solvers = ()


def chosen_window(problem: Problem, budget: TimeBudget) -> WindowChoice:
    """Number of samples, given, or chosen by the objective or the determinacy of the window.

    OversizeError where there are too many for so many states, the least that may do included.
    """
    plant = problem.plant
    require_window(plant.n, -(-plant.n // plant.p))  # before any is searched for
    choice = _chosen(problem, budget)
    require_window(plant.n, choice.samples)
    return choice


def _chosen(problem: Problem, budget: TimeBudget) -> WindowChoice:
    options, period = problem.options_as(FiniteTimeOptions), problem.plant.output.sample_period
    if options.window is not None:
        return WindowChoice(window_samples(options.window, period))
    search = _Search(None)
    if options.objective is not None:
        search = _samples_for_objective(problem, options, budget)
    k = search.samples
    samples = _well_determined(problem.plant, period) if k is None else k
    return WindowChoice(samples, search.remarks, search.solvers)


@dataclass(frozen=True)
class _Search:
    """As `WindowChoice`; samples None where a well determined window is meant."""

    samples: int | None
    remarks: tuple[Remark, ...] = ()
    solvers: Solvers = ()


def _samples_for_objective(
    problem: Problem, options: FiniteTimeOptions, budget: TimeBudget
) -> _Search:
    """Number of samples for an objective; None: those of a well determined window."""
    plant, period = problem.plant, problem.plant.output.sample_period
    A, C = plant.flow.A, plant.output.C
    shortest = approx_observability_index(A, C, period)
    if shortest is None:
        return _Search(None)
    if options.objective == "least_noise":
        counts = _counts(plant.n, _PER_OCTAVE)
        enough = [n for n in counts if approx_window_determinacy(A, C, period, n) >= _DETERMINED]
        return _Search(low_noise_samples(plant, enough) if enough else None)
    is_shortest = options.objective == "shortest_window"
    if options.method in NEED_L and np.any(A):
        free = PeriodProblem.from_problem(problem)
        return _samples_for_13(free, period, shortest, is_shortest, budget)
    return _Search(shortest if is_shortest else None)


def _samples_for_13(
    problem: PeriodProblem, period: float, least: int, is_shortest: bool, budget: TimeBudget
) -> _Search:
    """Samples of the shortest window with (13), if need be in coordinates S, or of the best."""
    if is_shortest:
        k, plain = fewest_samples(problem, period, least, budget)
        if k:
            return _Search(k, plain.remarks, plain.solvers)
        transformed = replace(problem, coordinates=True)
        k, other = fewest_samples(transformed, period, least, budget)
        return _Search(k, plain.remarks + other.remarks, other.solvers)
    best = best_injection(problem, budget)
    k = int(min(max(round(best.window / period), least), MOST_SAMPLES))
    return _Search(k, best.remarks, best.solvers)


def _well_determined(plant: Plant, period: float) -> int:
    """The first of n, 2 n, ... samples with a determinacy of _DETERMINED, or of half the best."""
    determinacies = []
    for k in _counts(plant.n):
        determinacy = approx_window_determinacy(plant.flow.A, plant.output.C, period, k)
        determinacies.append((determinacy, k))
        if determinacy >= _DETERMINED:
            return k
    best = max(determinacies)[0]
    return next(k for determinacy, k in determinacies if determinacy >= best / 2)


def _counts(n: int, per_octave: int = 1) -> list[int]:
    """n, 2 n, 4 n, ... and as many in between."""
    octaves = max((_LONGEST // n).bit_length() - 1, 0)
    steps = range(octaves * per_octave + 1)
    return sorted({round(n * 2 ** (step / per_octave)) for step in steps})
