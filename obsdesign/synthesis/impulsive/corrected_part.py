"""The part of the state that an impulsive observer has to correct, and windows on it alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, inverse, to_float
from obsdesign.equations.estimation_error import seen_before_jump
from obsdesign.equations.impulsive import gains as equations
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.dwell import stability_certificate
from obsdesign.synthesis.impulsive.invariant_subspace import Parts, corrected_part
from obsdesign.synthesis.impulsive.window import image_of, weight, windowed


def part_candidates(
    problem: Problem, gains: Mapping[str, Any], only_if_smaller: bool
) -> Iterator[Candidate]:
    """Windows on the part that has to be corrected: a full one, then one after impulses."""
    plant = problem.plant
    assert plant.jump is not None
    low, high = problem.require_dwell_time()
    C = seen_before_jump(plant.jump.G, plant.output.C, plant.output.jump_measurement)
    rate = float(problem.options.get("decay_rate", 0.0))
    factor = equations.factor_left_alone(rate, high)
    parts = corrected_part(plant.flow.A, plant.jump.G, C, low, high, factor)
    if only_if_smaller and parts.size in (0, plant.n):
        return  # nothing to correct, or nothing to leave alone
    if parts.size == 0:
        parts = Parts(np.eye(plant.n), 0, plant.n)
    if "alpha" not in problem.options:
        # in a cascade no part may be as slow as all of it
        gains = dict(gains) | {"alpha": weight(problem, equations.CASCADE_MARGIN)}
    certificates, blocks = _blocks(
        plant.flow.A, plant.jump.G, C, parts, (low, high), factor, gains["alpha"]
    )
    place = np.array([parts.first, parts.size], dtype=np.float64)
    whole = dict(gains) | {"basis": parts.basis, "core_place": place} | blocks
    # other invariant subspaces, and other blocks left alone, may do
    yield replace(windowed(problem, whole, "subspace", certificates), searched=True)
    U, S = image_of(blocks["core_G"])
    if U.shape[1] < parts.size:
        inner = whole | {"image": U, "coimage": S}
        found = windowed(problem, inner, "subspace, compressed", certificates)
        yield replace(found, searched=True)


def _blocks(
    A: Any, G: Any, C: Any, parts: Parts, ends: tuple[float, float], factor: float, alpha: float
) -> tuple[dict[str, Any], dict[str, Any]]:
    """(certificates that hidden and rest decay, the core's matrices)."""
    T = exact(parts.basis)
    back = inverse(T)
    if back is None:
        raise np.linalg.LinAlgError("the basis of the parts is singular")
    flow, jump = (to_float(back @ exact(X) @ T) for X in (A, G))
    first, end = parts.first, parts.first + parts.size
    certificates = {}
    for name, inside in (("hidden", slice(0, first)), ("rest", slice(end, len(A)))):
        F, H = flow[inside, inside], jump[inside, inside]
        if len(F):
            certificates[f"{name}_decays"] = _alone(F, H, ends, factor, alpha)
    middle = slice(first, end)
    seen = to_float(exact(C) @ T)[:, middle]
    core = {"core_A": flow[middle, middle], "core_G": jump[middle, middle], "core_C": seen}
    return certificates, core


def _alone(
    F: Any, H: Any, ends: tuple[float, float], factor: float, alpha: float
) -> dict[str, Any]:
    """P for the decay of a block: as fast as the core's if it can be, else at the factor."""
    for tried in sorted({min(factor, 0.9 / alpha), factor}):
        found = stability_certificate(F, H / tried, *ends, memory=0)
        if "P" in found:
            break
    return found | {"factor": tried}
