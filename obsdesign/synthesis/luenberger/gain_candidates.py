"""Candidates with a known L, or L and M: an M that is open, and certificates of stability."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.decide.stability import decide
from lmi.solvers import Solvers, merged
from lmi.time_budget import Remark, TimeBudget
from obsdesign.equations.estimation_error import flow_error_matrix, jump_error_matrix
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate, Certificates
from obsdesign.synthesis.convex_gain import ConvexGain, unmet_constraints
from obsdesign.synthesis.dwell import dwell_certificates, stability_options
from obsdesign.synthesis.given_gains import given_gain
from obsdesign.synthesis.luenberger.driven_plant import GainPair
from obsdesign.synthesis.luenberger.jump_gains import single_jump_gain
from obsdesign.synthesis.luenberger.schedule import scheduled_candidate
from obsdesign.synthesis.tails import with_tails


def with_jump_gain(
    problem: Problem, label: str, L: Matrix, wanted: ConvexGain, budget: TimeBudget
) -> Candidate:
    """The candidate of a flow gain L (n, p): M as given, or of the largest margin."""
    plant, options = problem.plant, problem.options_as(LuenbergerOptions)
    rate = options.decay_rate
    F = flow_error_matrix(plant.flow.A, L, plant.output.C)
    shifted = F + rate * np.eye(plant.n)
    if options.schedule is not None:
        return scheduled_candidate(problem, label, L, shifted, budget, wanted=wanted)
    M = given_gain(problem, "M")
    is_open, M_solvers, remarks = M is None, cast(Solvers, ()), tuple[Remark, ...]()
    if M is None:
        # the largest margin over all dwell times
        solution, remarks = single_jump_gain(problem, shifted, budget, wanted)
        if solution is None and wanted.user is not None:
            return unmet_constraints(label, "M was")
        M = np.zeros((plant.n, plant.p))
        if solution is not None:
            M, M_solvers = solution.M[0], solution.solvers
    candidate = with_gains(problem, label, GainPair(L, M), budget)
    solvers = merged(M_solvers, candidate.solvers)
    return replace(candidate, searched=is_open, remarks=remarks, solvers=solvers)


def with_gains(problem: Problem, label: str, pair: GainPair, budget: TimeBudget) -> Candidate:
    """The candidate of a pair of gains, with certificates of stability."""
    plant, rate = problem.plant, problem.options_as(LuenbergerOptions).decay_rate
    gains = LuenbergerGains.from_plant(plant, L=pair.L, M=pair.M)
    F = flow_error_matrix(plant.flow.A, pair.L, plant.output.C)
    certificates = _certificates(problem, F, pair.M, rate, budget)
    return Candidate(label, gains, certificates.evidence, solvers=certificates.solvers)


def _certificates(
    problem: Problem, F: Matrix, M: Matrix, rate: float, budget: TimeBudget
) -> Certificates:
    """Certificates of stability; with a decay rate, the P of F + rate I serves both claims."""
    plant = problem.plant
    shifted = F + rate * np.eye(plant.n)
    late = {"decay_rate": shifted} if rate > 0 else {}
    if plant.jump is None:
        return with_tails(Certificates(), {"hurwitz": F, **late}, None)
    ends = problem.require_dwell_time()
    H = jump_error_matrix(plant.jump.G, M, plant.output.C, plant.output.jump_measurement)
    options = stability_options(problem, budget)
    flows = {"dwell_stability": F, **late}
    if rate == 0:
        return with_tails(dwell_certificates(F, H, *ends, **options), flows, H)
    verdict = decide(shifted, H, *ends, **options)
    shared = Certificates({"dwell_stability": verdict.evidence})
    if not {"P", "windows"} & set(verdict.evidence):
        shared = dwell_certificates(F, H, *ends, **options)
    decay = Certificates({"decay_rate": verdict.evidence}, verdict.solvers)
    return with_tails(shared.joined(decay), flows, H)
