"""Point observers with jumps: gains L and M where they are left open.

L: poles (`poles`) or a steady-state Kalman gain (`weights`), for A + decay_rate I. M: the largest
margin of the inequality of `equations.luenberger`, affine in (P, P M), over the whole range of
dwell times by cutting planes. Since the choice of L limits what M can do, slower and faster ones
are tried in turn. Under convex constraints L is near to each of them (`flow_gain.py`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.solvers import Solvers, merged
from lmi.time_budget import UNLIMITED, Remark, TimeBudget
from obsdesign.analysis.nominal import nominal_problem, reason_against_options
from obsdesign.analysis.riccati import FASTER, faster_rates
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.errors import InputError
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.convex_gain import (
    ConvexGain,
    UserConstraints,
    convex_gains,
    inactive_constraints,
    unmet_constraints,
)
from obsdesign.synthesis.given_gains import (
    given_gain,
    refuse_second_choice,
    refuse_unusable,
    refuse_vain_constraints,
)
from obsdesign.synthesis.luenberger.constrained_flow_gain import nearest_gain
from obsdesign.synthesis.luenberger.discrete_time import step_candidates
from obsdesign.synthesis.luenberger.error_bound import known_box
from obsdesign.synthesis.luenberger.gain_candidates import with_jump_gain
from obsdesign.synthesis.luenberger.parameters import uncertain_candidates
from obsdesign.synthesis.luenberger.schedule import check_schedule
from obsdesign.synthesis.luenberger.searched_gains import (
    gain_search,
    is_L_limited,
    searched_candidates,
)
from obsdesign.synthesis.placement import no_kalman_gain, placed_gain, riccati_gain
from obsdesign.synthesis.time_scale import pace_without_cycles

# part of the time that searches of gains for bounds take: the other is for proofs of these
_SEARCHING = 0.5


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield candidates in order of preference; InputError for what cannot be built at all."""
    return synthesize_constrained(problem, None, budget)


def synthesize_constrained(
    problem: Problem, constraints: UserConstraints | None, budget: TimeBudget
) -> Iterator[Candidate]:
    """Yield candidates whose open gains also meet a user's constraints.

    constraints: `GainVariables` -> CVXPY constraints, for L and for M in turn. InputError for what
    cannot be built at all.
    """
    if problem.plant.flow.dt is not None:
        if constraints is not None:
            raise InputError("constraints on open gains are not available with flow.dt.")
        yield from step_candidates(problem, budget)
        return
    if problem.plant.parameters:
        if reason := reason_against_options(problem):
            raise InputError(reason)
        own, box = nominal_problem(problem), known_box(problem)
        candidates = synthesize_constrained(own, constraints, budget)
        search = None if box is None else gain_search(problem, own, box, constraints)
        if search is not None:
            in_time = budget.part(_SEARCHING)
            candidates = searched_candidates(own, search, candidates, in_time)
        is_limited = is_L_limited(problem, own)
        yield from uncertain_candidates(problem, candidates, box, budget, is_L_limited=is_limited)
        return
    refuse_unusable(problem)
    check_schedule(problem)
    options = problem.options_as(LuenbergerOptions)
    wanted = convex_gains(options, constraints)
    refuse_vain_constraints(problem, constraints)
    is_L_open = given_gain(problem, "L") is None
    # without constraints L comes from a formula, without a solver
    is_searched = is_L_open and not wanted["L"].is_free()
    L_solvers: Solvers = wanted["L"].solvers if is_searched else ()
    for label, L, remarks in _flow_gains(problem, options.decay_rate, wanted["L"]):
        candidate = unmet_constraints(label, "L was")
        if L is not None:
            candidate = with_jump_gain(problem, label, L, wanted["M"], budget)
        yield replace(
            candidate,
            searched=candidate.searched or is_L_open,
            remarks=(*remarks, *candidate.remarks),
            solvers=merged(L_solvers, candidate.solvers),
        )


def _flow_gains(
    problem: Problem, rate: float, wanted: ConvexGain
) -> Iterator[tuple[str, Matrix | None, tuple[Remark, ...]]]:
    """Yield L: given, placed, or by Riccati equations of growing speed; at last 0.

    None where no L is known that meets a user's constraints.
    """
    A, C = problem.plant.flow.A, problem.plant.output.C
    given, options = given_gain(problem, "L"), problem.options_as(LuenbergerOptions)
    refuse_second_choice(options, None if given is None else "is given or must be zero")
    if given is not None:
        yield "L as given" if "L" in problem.gains else "L = 0", given, ()
        return
    if not wanted.is_free():
        _refuse_fixed_choice(options, wanted)
        yield from _wanted_flow_gains(problem, rate, wanted)
        return
    if options.poles is not None:
        yield "placed L", placed_gain(A, C, options.poles), ()
        return
    pace = pace_without_cycles(problem, rate)
    for label, L in riccati_gains(A, C, options.weights, rate, pace):
        yield label, L, ()
    if not options.weights:
        yield "L = 0", np.zeros((problem.plant.n, problem.plant.p)), ()


def riccati_gains(
    A: Matrix, C: Matrix, weights: Mapping[str, tuple[float, ...]] | None, rate: float, pace: float
) -> Iterator[tuple[str, Matrix]]:
    """Yield gains L (n, p) of growing speed, with their labels; InputError: none of weights.

    pace: of an A without cycles.
    """
    is_known = False
    for factor, faster in zip(FASTER, faster_rates(A, rate), strict=True):
        try:
            L = riccati_gain(A, C, weights, faster, pace=pace)
        except np.linalg.LinAlgError:  # no finite solution in floats: not this one
            continue
        is_known = True
        yield "Riccati L" + (f", {factor:g} x faster" if factor else ""), L
    if weights and not is_known:
        raise no_kalman_gain("L")


def _refuse_fixed_choice(options: LuenbergerOptions, wanted: ConvexGain) -> None:
    """InputError where poles or weights fix L, on which there are constraints too."""
    for name in ("poles", "weights"):
        if options.is_stated(name):
            raise InputError(
                f"observer.{name} fixes L, and {wanted.text()} chooses it too; drop one."
            )


def _wanted_flow_gains(
    problem: Problem, rate: float, wanted: ConvexGain
) -> Iterator[tuple[str, Matrix | None, tuple[Remark, ...]]]:
    """Yield L that meet the constraints, near to Riccati gains and to zero; or zero, and why."""
    plant = problem.plant
    zero = np.zeros((plant.n, plant.p))
    is_flow_alone = plant.jump is None or math.isinf(problem.require_dwell_time()[1])
    fastest = max(rate, wanted.stated.decay or 0.0)
    A, C, pace = plant.flow.A, plant.output.C, pace_without_cycles(problem, rate)
    targets = [*riccati_gains(A, C, None, fastest, pace), ("L = 0", zero)]
    inactive = tuple[Remark, ...]()
    for _, free in itertools.islice(riccati_gains(A, C, None, rate, pace), 1):
        inactive = inactive_constraints(wanted, free, flow_error_matrix(A, free, C))
    is_found = False
    # a flow that decays by itself leaves least to M; between jumps it need not
    for least in [rate, *([] if is_flow_alone else [None])]:
        for label, target in targets[-1:] if is_found else targets:
            L = nearest_gain(plant, wanted, target, least, pace)
            if L is None:  # the conditions are the same for every target
                break
            yield f"L nearest to {label} under {wanted.text()}", L, () if is_found else inactive
            is_found = True
    if is_found:
        return
    if wanted.user is not None:
        yield "L under constraints", None, ()
        return
    text = f"no L was found for {wanted.text()}; the condition used is sufficient, not necessary"
    yield "L = 0", zero, (Remark(text),)
