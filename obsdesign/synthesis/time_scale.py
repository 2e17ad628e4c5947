"""Paces (1 / time scale) of jumps, samples and disturbances, beside that of the flow.

A flow without cycles, such as a chain of integrators, has no pace of its own. What is chosen for it
must not depend on the unit of time of the file.
"""

from __future__ import annotations

import math

import numpy as np

from obsdesign.problem.problem import Problem


def pace_without_cycles(problem: Problem, rate: float) -> float:
    """Pace of events, else the stated decay rate, else pace of inputs; 1 where there is none."""
    return event_pace(problem) or rate or input_pace(problem) or 1.0


def pace_of_stays(every: tuple[float, float]) -> float:
    """Pace at which a mode ends: of its longest stay, if finite, else of its shortest."""
    return 1.0 / next(stay for stay in every[::-1] if math.isfinite(stay))


def event_pace(problem: Problem) -> float:
    """Of jumps at the longest dwell time, if finite, else the shortest; else of samples; or 0."""
    plant = problem.plant
    times = problem.require_dwell_time()[::-1] if plant.jump is not None else ()
    spans = (*times, plant.output.sample_spacing)
    span = next((span for span in spans if 0 < span < math.inf), math.inf)
    return 1.0 / span


def input_pace(problem: Problem) -> float:
    """Pace at which disturbances alone take y out of its noise, for a flow without cycles; or 0."""
    plant, noise = problem.plant, problem.plant.outputs.noise_radius
    if noise is None:
        return 0.0
    reached, paces = np.subtract(*plant.flow.b_bounds[::-1]), [0.0]
    with np.errstate(all="ignore"):
        for k in range(1, plant.n + 1):
            ratio = np.abs(plant.output.C) @ reached / noise
            paces.append(float(ratio[np.isfinite(ratio)].max(initial=0.0)) ** (1 / k))
            reached = np.abs(plant.flow.A) @ reached
    return max(paces)
