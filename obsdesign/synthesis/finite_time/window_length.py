"""The window of finite-time estimation where it is left open: how many samples."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from obsdesign.equations.finite_time import gains as equations
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.finite_time.injection import Open, best_injection, fewest_samples
from obsdesign.synthesis.finite_time.least_noise import quiet_samples

# a default window is doubled until its scaled rows are that far from losing rank
_DETERMINED = 1e-2
_LONGEST = 2048
# windows that are compared for their noise, per factor of two
_PER_OCTAVE = 4
SINGULAR = 1e-11
BY_13 = ("longest_period", "shortest_window")


def chosen_samples(problem: Problem) -> int:
    """k, given or chosen by the objective, else by how well the window determines the state."""
    plant, period = problem.plant, float(problem.plant.output.period or 1.0)
    if "window" in problem.options:
        return equations.window_samples(problem.options["window"], period)
    A, C, objective = plant.flow.A, plant.output.C, problem.options.get("objective")
    if objective is None:
        return _well_determined(A, C, period)
    fewest = math.ceil(plant.n / plant.p)
    shortest = next(
        (
            k
            for k in range(fewest, plant.n + 1)
            if equations.approx_reach(A, C, period, k) > SINGULAR
        ),
        None,
    )
    k: int | None = None
    if objective == "shortest_window":
        k = shortest
    by_13 = objective in BY_13 and np.any(A)
    if by_13 and shortest is not None and problem.options.get("method") in equations.NEED_L:
        k = _samples_for_13(Open(A, C, None, problem.gains.get("L")), period, shortest, objective)
    if objective == "least_noise" and shortest is not None:
        counts = _counts(plant.n, _PER_OCTAVE)
        enough = [n for n in counts if equations.approx_reach(A, C, period, n) >= _DETERMINED]
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


def _counts(n: int, per_octave: int = 1) -> list[int]:
    """n, 2 n, 4 n, ... and as many in between."""
    octaves = max((_LONGEST // n).bit_length() - 1, 0)
    steps = range(octaves * per_octave + 1)
    return sorted({round(n * 2 ** (step / per_octave)) for step in steps})
