"""Finite-time estimation in discrete time: least squares of the samples of a window."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.analysis.balancing import BalancedPlant
from obsdesign.analysis.finite_time.steps import MOST_STEPS, ROUNDING, reason_against_steps
from obsdesign.equations.finite_time.steps import (
    StepWindowGains,
    cancelled_terms,
    error_maps,
    observation_rows,
    window_entries,
)
from obsdesign.equations.time_grid import steps_of
from obsdesign.errors import DoesNotApply
from obsdesign.problem.options import FiniteTimeOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate

# windows that are compared, in parts of the number of states
_TRIED = (1, 2, 3, 4, 6, 8, 12)
# of the largest deviation of an output: one without noise has that much
_LEAST_NOISE = 1e-6


def step_window(problem: Problem) -> Iterator[Candidate]:
    """Yield the observer of a problem; DoesNotApply where there is none.

    Without a window the one whose largest error is least, in the product of all states, of those
    that fit between two jumps.
    """
    if reason := reason_against_steps(problem):
        raise DoesNotApply(reason)
    plant, stated = problem.plant, problem.options_as(FiniteTimeOptions).window
    period, n = plant.output.sample_period, plant.n
    steps = steps_of(period, plant.flow.dt or period) or 1
    if stated is not None:
        counts = [round(stated / period)]
    else:
        longest = _longest_window(problem, steps)
        counts = [k * n for k in _TRIED if k * n * steps <= longest] or [n]
    gains = [_gains(problem, steps, count) for count in counts]
    best = min(gains, key=_size)
    yield Candidate("least_squares", best, searched=stated is None)


def _longest_window(problem: Problem, steps: int) -> float:
    """Steps of the longest window that is tried: one that fits between two jumps."""
    plant = problem.plant
    if plant.jump is None or plant.jump.dwell_time is None or plant.flow.dt is None:
        return MOST_STEPS
    shortest = steps_of(plant.jump.dwell_time[0], plant.flow.dt) or 1
    return float(min(MOST_STEPS, max(shortest, plant.n * steps)))


def _gains(problem: Problem, steps: int, samples: int) -> StepWindowGains:
    plant = problem.plant
    A, C, output = plant.flow.A, plant.output.C, plant.output
    noise = output.noise_std if output.noise_radius is None else output.noise_radius
    noise = noise if noise.any() else np.ones(len(C))
    weights = np.tile(1 / np.maximum(noise, _LEAST_NOISE * noise.max()), samples)
    rows = observation_rows(A, C, steps, samples)
    end = np.linalg.matrix_power(A, steps * (samples - 1))
    sizes = BalancedPlant.from_matrices(A, C).sizes
    with np.errstate(all="ignore"):
        W = end * sizes @ np.linalg.pinv(weights[:, None] * rows * sizes) * weights
    W = W if np.isfinite(W).all() else np.zeros((plant.n, len(weights)))
    return StepWindowGains(**window_entries(plant), samples=samples, window_gain=W)


def _size(gains: StepWindowGains) -> float:
    """Sum of logarithms of the largest errors, in floats; infinite for a window that is blind."""
    parts = gains.A, gains.C, gains.of_samples, gains.period_steps
    maps = error_maps(*parts)
    if not (np.abs(maps[0]) <= ROUNDING * cancelled_terms(*parts)).all():
        return np.inf
    half = (gains.flow_upper - gains.flow_lower) / 2
    noise = np.ones(gains.p) if gains.noise_bound is None else gains.noise_bound
    radius: Matrix = sum(np.abs(q) @ half for q in maps[1:]) + sum(
        np.abs(own) @ noise for own in gains.of_samples
    )
    return float(np.log(np.maximum(radius, 1e-300)).sum())
