"""Point observers whose gain at a jump depends on the dwell time that has just ended.

Only the past may be used, since the next dwell time is not known when the jump is corrected. For a
fixed flow the search for such gains is jointly linear in the matrices and the gains, and loses
nothing (`synthesis.jump_gains`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from obsdesign.equations.estimation_error import idle_gains, plant_data
from obsdesign.equations.luenberger import error_system as equations
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.luenberger.jump_gains import equal_cells, jump_gains

_MOST_CELLS = 16


def check_schedule(problem: Problem) -> None:
    """InputError when gains at jumps are asked to follow a schedule and cannot."""
    if "schedule" not in problem.options:
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
    asked = problem.options["schedule"]
    cells = asked if isinstance(asked, int) else len(asked) + 1
    if cells > _MOST_CELLS:
        raise InputError(
            f"observer.schedule must make at most {_MOST_CELLS} cells, each pair of which is an "
            f"inequality; got {cells}."
        )
    for border in () if isinstance(asked, int) else asked:
        if not low * (1 + 2 * equations.BORDER) < border < high * (1 - 2 * equations.BORDER):
            raise InputError(
                f"observer.schedule must lie inside jump.dwell_time = [{low:g}, {high:g}], more "
                f"than {2 * equations.BORDER:g} of itself from the ends; got {border!r}."
            )


def scheduled_candidate(problem: Problem, label: str, L: Any, F: Any) -> Candidate:
    """Gains M per cell of dwell times, for the flow F of the error plus the rate that is asked.

    `M` is for a jump before which the dwell time is not known, the first one: any will do.
    """
    plant = problem.plant
    assert plant.jump is not None
    low, high = problem.require_dwell_time()
    asked = problem.options["schedule"]
    borders = equal_cells(F, low, high, asked) if isinstance(asked, int) else list(asked)
    cells = equations.schedule_cells(low, high, borders)
    pairs = equations.schedule_pairs(cells, plant.jump.dwell_jitter)
    found = jump_gains(problem, F, cells, pairs)
    M = np.zeros((len(cells), plant.n, plant.p)) if found is None else found.M
    gains = plant_data(plant) | {"L": L, "M": M[0], "M_cells": M}
    gains["dwell_borders"] = np.array(borders, dtype=float)
    certificate: dict[str, Any] = {}
    if found is not None:
        certificate = {"P_cells": [((P + P.T) / 2).tolist() for P in found.P]}
    ids = ("dwell_stability", "decay_rate")
    return Candidate(
        f"{label}, M by {len(cells)} cells of dwell times",
        gains,
        dict.fromkeys(ids, certificate),
        searched=True,
    )
