"""Point observers with jumps: gains L and M where they are left open.

L: poles (`poles`) or a steady-state Kalman gain (`weights`), for A + decay_rate I. M: the largest
margin of the inequality of `equations.luenberger`, affine in (P, P M), over the whole range of
dwell times by cutting planes. Since the choice of L limits what M can do, slower and faster ones
are tried in turn.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lmi.decide.stability import decide
from lmi.time_budget import UNLIMITED, Remark, TimeBudget
from obsdesign.equations.estimation_error import flow_error_matrix, jump_error_matrix
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.dwell import dwell_certificates, stability_options
from obsdesign.synthesis.given_gains import given_gain, refuse_unusable
from obsdesign.synthesis.luenberger.jump_gains import jump_gains
from obsdesign.synthesis.luenberger.schedule import check_schedule, scheduled_candidate
from obsdesign.synthesis.placement import placed_gain, riccati_gain


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield candidates in order of preference; InputError for what cannot be built at all."""
    refuse_unusable(problem)
    check_schedule(problem)
    plant = problem.plant
    rate = float(problem.options.get("decay_rate", 0.0))
    chosen = given_gain(problem, "L") is None and "poles" not in problem.options
    for label, L in _flow_gains(problem, rate):
        F = flow_error_matrix(plant.flow.A, L, plant.output.C)
        if "schedule" in problem.options:
            shifted = F + rate * np.eye(plant.n)
            yield scheduled_candidate(problem, label, L, shifted, budget)
            continue
        M, remarks = given_gain(problem, "M"), tuple[Remark, ...]()
        if M is None:
            M, remarks = _jump_gain(problem, F + rate * np.eye(plant.n), budget)
        gains = LuenbergerGains.from_plant(plant, L=L, M=M)
        # with several outputs more than one L has the poles of the file
        placed = given_gain(problem, "L") is None and plant.p > 1
        open_gain = chosen or placed or given_gain(problem, "M") is None
        yield Candidate(
            label,
            gains,
            _certificates(problem, F, M, rate, budget),
            searched=open_gain,
            remarks=remarks,
        )


def _flow_gains(problem: Problem, rate: float) -> Iterator[tuple[str, Any]]:
    """Yield L: given, placed, or by Riccati equations of growing speed; at last 0."""
    A, C = problem.plant.flow.A, problem.plant.output.C
    given = given_gain(problem, "L")
    for name in ("poles", "weights"):
        if given is not None and name in problem.options:
            text = "chooses L, but L is given or must be zero; drop one."
            raise InputError(f"observer.{name} {text}")
    if "poles" in problem.options and "weights" in problem.options:
        raise InputError("observer.poles and observer.weights both choose L; drop one.")
    if given is not None:
        yield "L as given" if "L" in problem.gains else "L = 0", given
        return
    if "poles" in problem.options:
        yield "placed L", placed_gain(A, C, problem.options["poles"])
        return
    weights = problem.options.get("weights")
    speed = float(np.abs(np.linalg.eigvals(A)).max())
    for factor in (0.0, 1.0, 4.0):
        try:
            L = riccati_gain(A, C, weights, rate + factor * speed)
        except np.linalg.LinAlgError:  # no finite solution in floats: not this one
            continue
        yield "Riccati L" + (f", {factor:g} x faster" if factor else ""), L
    yield "L = 0", np.zeros((problem.plant.n, problem.plant.p))


def _jump_gain(problem: Problem, F: Any, budget: TimeBudget) -> tuple[Any, tuple[Remark, ...]]:
    """M with the largest margin over all dwell times for a flow F; zeros if there is none."""
    solution, remarks = jump_gains(problem, F, [problem.require_dwell_time()], [(0, 0)], budget)
    zeros = np.zeros((problem.plant.n, problem.plant.p))
    return zeros if solution is None else solution.M[0], remarks


def _certificates(
    problem: Problem, F: Any, M: Any, rate: float, budget: TimeBudget
) -> dict[str, Any]:
    """Certificates of stability; with a decay rate, the P of F + rate I serves both claims."""
    plant = problem.plant
    if plant.jump is None:
        return {}
    ends = problem.require_dwell_time()
    H = jump_error_matrix(plant.jump.G, M, plant.output.C, plant.output.jump_measurement)
    options = stability_options(problem, budget)
    if rate == 0:
        return dwell_certificates(F, H, *ends, **options)
    evidence = decide(F + rate * np.eye(plant.n), H, *ends, **options).evidence
    if not {"P", "windows"} & set(evidence):
        return dwell_certificates(F, H, *ends, **options) | {"decay_rate": evidence}
    return {"dwell_stability": evidence, "decay_rate": evidence}


def untried(problem: Problem) -> dict[str, str]:
    """Forms that are passed over, and why: none of this kind."""
    return {}
