"""Point observers with jumps: gains L and M where they are left open.

L: poles (`poles`) or a steady-state Kalman gain (`weights`), for A + decay_rate I. M: the largest
margin of the inequality of `equations.luenberger`, affine in (P, P M), over the whole range of
dwell times by cutting planes. Since the choice of L limits what M can do, slower and faster ones
are tried in turn.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.spectrum import spectral_radius
from lmi.decide.stability import decide
from lmi.solvers import Solvers, merged
from lmi.time_budget import UNLIMITED, Remark, TimeBudget
from obsdesign.equations.estimation_error import flow_error_matrix, jump_error_matrix
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate, Certificates
from obsdesign.synthesis.dwell import dwell_certificates, stability_options
from obsdesign.synthesis.given_gains import given_gain, refuse_second_choice, refuse_unusable
from obsdesign.synthesis.luenberger.jump_gains import jump_gains
from obsdesign.synthesis.luenberger.schedule import check_schedule, scheduled_candidate
from obsdesign.synthesis.placement import placed_gain, riccati_gain


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield candidates in order of preference; InputError for what cannot be built at all."""
    refuse_unusable(problem)
    check_schedule(problem)
    plant, options = problem.plant, problem.options_as(LuenbergerOptions)
    rate = options.decay_rate
    # with several outputs more than one L has the poles of the file
    is_L_open = given_gain(problem, "L") is None and (options.poles is None or plant.p > 1)
    for label, L in _flow_gains(problem, rate):
        F = flow_error_matrix(plant.flow.A, L, plant.output.C)
        shifted = F + rate * np.eye(plant.n)
        if options.schedule is not None:
            yield scheduled_candidate(problem, label, L, shifted, budget)
            continue
        M, remarks = given_gain(problem, "M"), tuple[Remark, ...]()
        solvers: Solvers = ()
        is_open = is_L_open or M is None
        if M is None:
            # the largest margin over all dwell times
            dwell = [problem.require_dwell_time()]
            solution, remarks = jump_gains(problem, shifted, dwell, [(0, 0)], budget)
            M = np.zeros((plant.n, plant.p))
            if solution is not None:
                M, solvers = solution.M[0], solution.solvers
        gains = LuenbergerGains.from_plant(plant, L=L, M=M)
        certificates = _certificates(problem, F, M, rate, budget)
        solvers = merged(solvers, certificates.solvers)
        yield Candidate(
            label, gains, certificates.evidence, is_open, remarks=remarks, solvers=solvers
        )


def _flow_gains(problem: Problem, rate: float) -> Iterator[tuple[str, Matrix]]:
    """Yield L: given, placed, or by Riccati equations of growing speed; at last 0."""
    A, C = problem.plant.flow.A, problem.plant.output.C
    given, options = given_gain(problem, "L"), problem.options_as(LuenbergerOptions)
    refuse_second_choice(options, None if given is None else "is given or must be zero")
    if given is not None:
        yield "L as given" if "L" in problem.gains else "L = 0", given
        return
    if options.poles is not None:
        yield "placed L", placed_gain(A, C, options.poles)
        return
    speed = spectral_radius(A)
    for factor in (0.0, 1.0, 4.0):
        try:
            L = riccati_gain(A, C, options.weights, rate + factor * speed)
        except np.linalg.LinAlgError:  # no finite solution in floats: not this one
            continue
        yield "Riccati L" + (f", {factor:g} x faster" if factor else ""), L
    yield "L = 0", np.zeros((problem.plant.n, problem.plant.p))


def _certificates(
    problem: Problem, F: Matrix, M: Matrix, rate: float, budget: TimeBudget
) -> Certificates:
    """Certificates of stability; with a decay rate, the P of F + rate I serves both claims."""
    plant = problem.plant
    if plant.jump is None:
        return Certificates()
    ends = problem.require_dwell_time()
    H = jump_error_matrix(plant.jump.G, M, plant.output.C, plant.output.jump_measurement)
    options = stability_options(problem, budget)
    if rate == 0:
        return dwell_certificates(F, H, *ends, **options)
    verdict = decide(F + rate * np.eye(plant.n), H, *ends, **options)
    shared = Certificates({"dwell_stability": verdict.evidence})
    if not {"P", "windows"} & set(verdict.evidence):
        shared = dwell_certificates(F, H, *ends, **options)
    return shared.joined(Certificates({"decay_rate": verdict.evidence}, verdict.solvers))
