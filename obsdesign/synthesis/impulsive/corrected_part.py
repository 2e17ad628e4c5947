"""Windows on the part of the state that an impulsive observer has to correct."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import exact, inverse, to_float
from lmi.time_budget import TimeBudget
from lmi.verdict import Verdict
from obsdesign.equations.estimation_error import seen_before_jump
from obsdesign.equations.impulsive.formulas import CASCADE_MARGIN, uncorrected_factor
from obsdesign.problem.options import ImpulsiveOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate, Certificates
from obsdesign.synthesis.dwell import stability_certificate
from obsdesign.synthesis.impulsive.invariant_subspace import Parts, corrected_part
from obsdesign.synthesis.impulsive.window import factors_of, weight, window_gains, windowed

# options that mean nothing to the quadratic strategy, which has no window
WINDOWED = ("window", "alpha", "noise_target")


def part_candidates(
    problem: Problem, only_if_smaller: bool, budget: TimeBudget
) -> Iterator[Candidate]:
    """Yield windows on the part that has to be corrected: a full one, then one after impulses."""
    plant = problem.plant
    assert plant.jump is not None
    low, high = problem.require_dwell_time()
    C = seen_before_jump(plant.jump.G, plant.output.C, plant.output.jump_measurement)
    factor = uncorrected_factor(problem.options_as(ImpulsiveOptions).decay_rate, high)
    matrices = plant.flow.A, plant.jump.G, C
    parts = corrected_part(matrices, (low, high), factor)
    if only_if_smaller and parts.size == plant.n:
        return  # all of it is to be corrected
    is_whole = parts.size == 0
    if is_whole:
        parts = Parts(np.eye(plant.n), 0, plant.n)
    # in a cascade no block may be as slow as all of it
    alpha = weight(problem, CASCADE_MARGIN)
    if only_if_smaller and is_whole:
        # nothing is to be corrected: the quadratic strategy says so, where it may be used
        ends, goals = (low, high), (factor, alpha)
        decay = _decay_certificate(plant.flow.A, plant.jump.G, ends, goals, budget)
        if "P" not in decay.evidence or not _is_without_quadratic(problem):
            return
    yield from _windows_on(problem, parts, matrices, (factor, alpha), budget)


def _windows_on(
    problem: Problem,
    parts: Parts,
    plant: tuple[Matrix, Matrix, Matrix],
    goals: tuple[float, float],
    budget: TimeBudget,
) -> Iterator[Candidate]:
    """Yield the windows on the part to correct of a plant (A, G, C); goals: as for `_blocks`."""
    ends = problem.require_dwell_time()
    decays, (core_A, core_G, core_C) = _blocks(plant, parts, ends, goals, budget)
    place = np.array([parts.first, parts.size], dtype=np.float64)
    gains = window_gains(
        problem,
        "subspace",
        basis=parts.basis,
        core_place=place,
        core_A=core_A,
        core_G=core_G,
        core_C=core_C,
    )
    gains = replace(gains, alpha=goals[1])
    # other invariant subspaces, and other uncorrected blocks, may do
    candidate = windowed(problem, gains, "subspace", budget, decays.evidence)
    yield replace(candidate, searched=True, solvers=decays.solvers)
    U, S = factors_of(core_G)
    if U.shape[1] < parts.size:
        inner = replace(gains, image=U, coimage=S)
        candidate = windowed(problem, inner, "subspace, compressed", budget, decays.evidence)
        yield replace(candidate, searched=True, solvers=decays.solvers)


def _is_without_quadratic(problem: Problem) -> bool:
    """Does the problem state what the quadratic strategy has no use for?"""
    options = problem.options_as(ImpulsiveOptions)
    return any(options.is_stated(name) for name in WINDOWED)


def _blocks(
    plant: tuple[Matrix, Matrix, Matrix],
    parts: Parts,
    ends: tuple[float, float],
    goals: tuple[float, float],
    budget: TimeBudget,
) -> tuple[Certificates, tuple[Matrix, Matrix, Matrix]]:
    """(certificates that hidden and rest decay, the core) of plants (A, G, C).

    goals: factor from impulse to impulse that is needed, and the core's alpha.
    """
    A, G, C = plant
    T = exact(parts.basis)
    back = inverse(T)
    if back is None:
        raise np.linalg.LinAlgError("the basis of the parts is singular")
    flow, jump = (to_float(back @ exact(X) @ T) for X in (A, G))
    first, end = parts.first, parts.first + parts.size
    certificates = Certificates()
    for name, inside in (("hidden", slice(0, first)), ("rest", slice(end, len(A)))):
        F, H = flow[inside, inside], jump[inside, inside]
        if len(F):
            verdict = _decay_certificate(F, H, ends, goals, budget)
            decay = Certificates({f"{name}_decays": verdict.evidence}, verdict.solvers)
            certificates = certificates.joined(decay)
    middle = slice(first, end)
    output = to_float(exact(C) @ T)[:, middle]
    return certificates, (flow[middle, middle], jump[middle, middle], output)


def _decay_certificate(
    F: Matrix,
    H: Matrix,
    ends: tuple[float, float],
    goals: tuple[float, float],
    budget: TimeBudget,
) -> Verdict:
    """P for the decay of a block: as fast as the core's if it can be, else at the factor."""
    factor, alpha = goals
    for goal in sorted({min(factor, 0.9 / alpha), factor}):
        verdict = stability_certificate(F, H / goal, *ends, memory=0, budget=budget)
        if "P" in verdict.evidence:
            break
    return replace(verdict, evidence={**verdict.evidence, "factor": goal})
