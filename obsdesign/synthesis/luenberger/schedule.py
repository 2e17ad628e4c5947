"""Point observers whose gain at a jump depends on the dwell time that has just ended.

Only the past may be used, since the next dwell time is not known when the jump is corrected. For a
fixed flow the search for such gains is jointly linear in the matrices and the gains, and loses
nothing (`jump_gains.py`).
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from lmi.time_budget import TimeBudget
from obsdesign.equations.estimation_error import idle_gains
from obsdesign.equations.luenberger import error_system as equations
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.errors import InputError
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate, Certificates
from obsdesign.synthesis.convex_gain import ConvexGain, unmet_constraints
from obsdesign.synthesis.luenberger.jump_gains import equal_cells, jump_gains
from obsdesign.synthesis.tails import with_tails

_MOST_CELLS = 16


def check_schedule(problem: Problem) -> None:
    """Raise InputError for a schedule of gains at jumps that is impossible."""
    schedule = problem.options_as(LuenbergerOptions).schedule
    if schedule is None:
        return
    if "M" in problem.gains:
        raise InputError("observer.schedule chooses M, but M is given; drop one.")
    if "M" in (idle := idle_gains(problem.plant)):
        raise InputError(f"observer.schedule needs a measurement at jumps: {idle['M']}.")
    low, high = problem.require_dwell_time()
    if low == high:
        raise InputError(
            "observer.schedule needs a range of dwell times; jump.dwell_time holds one, "
            f"{low!r}. Drop schedule."
        )
    cells = equations.cell_count(schedule)
    if cells > _MOST_CELLS:
        raise InputError(
            f"observer.schedule must make at most {_MOST_CELLS} cells, each pair of which is an "
            f"inequality; got {cells}."
        )
    for border in () if isinstance(schedule, int) else schedule:
        if not low * (1 + 2 * equations.BORDER) < border < high * (1 - 2 * equations.BORDER):
            raise InputError(
                f"observer.schedule must lie inside jump.dwell_time = [{low:g}, {high:g}], more "
                f"than {2 * equations.BORDER:g} of itself from the ends; got {border!r}."
            )


def scheduled_candidate(
    problem: Problem, label: str, L: Matrix, F: Matrix, budget: TimeBudget, *, wanted: ConvexGain
) -> Candidate:
    """Gains M per cell of dwell times, for the flow F of the error plus the decay rate.

    wanted: constraints on every M.

    `M` is for a jump before which the dwell time is not known, the first one: any will do.
    """
    plant = problem.plant
    schedule = problem.options_as(LuenbergerOptions).schedule
    assert plant.jump is not None
    assert schedule is not None
    low, high = problem.require_dwell_time()
    borders = equal_cells(F, low, high, schedule) if isinstance(schedule, int) else list(schedule)
    cells = equations.schedule_cells(low, high, borders)
    pairs = equations.schedule_pairs(cells, plant.jump.dwell_jitter)
    solution, remarks = jump_gains(problem, F, cells, pairs, budget, wanted=wanted)
    if solution is None and wanted.user is not None:
        return unmet_constraints(label, "M was")
    M = np.zeros((len(cells), plant.n, plant.p)) if solution is None else solution.M
    gains = LuenbergerGains.from_plant(plant, L=L, M=M[0], M_cells=M, dwell_borders=borders)
    certificate: NewEntries = {}
    if solution is not None:
        certificate = {"P_cells": [((P + P.T) / 2).tolist() for P in solution.P]}
    # what falls along the flow plus the decay rate falls along the flow too
    plain = Certificates({"dwell_stability": certificate})
    shared = with_tails(plain, {"dwell_stability": F}, plant.jump.G).evidence["dwell_stability"]
    return Candidate(
        f"{label}, M by {len(cells)} cells of dwell times",
        gains,
        {"dwell_stability": shared, "decay_rate": shared},
        searched=True,
        remarks=remarks,
        solvers=() if solution is None else solution.solvers,
    )
