"""Candidates for interval observers in each form, with open gains and coordinates chosen.

Source: Degue, Efimov, Richard, NOLCOS 2016, Theorems 5 (`cooperative`), 8 (`split`), 7 and 8
combined (`coordinates`) and 7 as corrected (`two_coordinates`). Candidates are proposals:
verification analyses each of them exactly.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from dataclasses import replace
from itertools import chain

import numpy as np

from lmi.arithmetic.arrays import Entries
from lmi.time_budget import UNLIMITED, Remark, TimeBudget
from obsdesign.analysis.hidden_modes import not_detectable
from obsdesign.analysis.interval.requirements import (
    open_forms,
    reason_against,
    reason_against_plant,
)
from obsdesign.equations.estimation_error import idle_gains
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.convex_gain import UserConstraints, inactive_constraints, unmet_constraints
from obsdesign.synthesis.given_gains import given_gain, refuse_unusable, refuse_vain_constraints
from obsdesign.synthesis.interval.certified import (
    certified,
    plain_frame,
    with_solvers,
    with_zero_gains,
)
from obsdesign.synthesis.interval.common_coordinates import CommonCoordinates
from obsdesign.synthesis.interval.coordinates import CoordinateSearch
from obsdesign.synthesis.interval.descent import best_gains, solvers_of_gains
from obsdesign.synthesis.interval.forms import gains_of_form
from obsdesign.synthesis.interval.placed import FEWEST_STATES, PlacedGains, placed_gains
from obsdesign.synthesis.interval.sampled_bases import sampled_bases
from obsdesign.synthesis.interval.sampled_candidates import sampled_candidates
from obsdesign.synthesis.interval.several_clocks import clocked_candidate
from obsdesign.synthesis.interval.similarity import coordinates_of_assumption_4
from obsdesign.synthesis.interval.state_box import boxed_problem
from obsdesign.synthesis.interval.task import GainSearch, Task


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield candidates in order of preference; those with a cost, by cost.

    InputError where the given gains cannot be completed.
    """
    return synthesize_constrained(problem, None, budget)


def synthesize_constrained(
    problem: Problem, constraints: UserConstraints | None, budget: TimeBudget
) -> Iterator[Candidate]:
    """Yield candidates whose open gains also meet a user's constraints.

    constraints: `GainVariables` -> CVXPY constraints, for L and for M in turn.
    """
    boxed = boxed_problem(problem)
    sourced, common = boxed.sourced(budget, constraints), None
    if sourced is not None:
        common = CommonCoordinates(boxed.with_parameters, sourced)
    candidates = _candidates(boxed.nominal.problem, constraints, budget, common)
    return boxed.completed(candidates, sourced)


def _candidates(
    problem: Problem,
    constraints: UserConstraints | None,
    budget: TimeBudget,
    common: CommonCoordinates | None,
) -> Iterator[Candidate]:
    if problem.plant.needs_clock_gains:
        yield clocked_candidate(problem, constraints, budget)
        return
    if reason := reason_against_plant(problem.plant):
        raise DoesNotApply(reason)
    if reason := reason_against(problem):
        raise InputError(reason)
    problem.require_noise_bound()
    _refuse_unexecutable(problem)
    refuse_vain_constraints(problem, constraints)
    stated = {name: given_gain(problem, name) for name in ("L", "M")}
    given = {name: gain for name, gain in stated.items() if gain is not None}
    own = {name: problem.gains[name] for name in ("S", "S2", "T") if name in problem.gains}
    if "R" in problem.gains:
        own = coordinates_of_assumption_4(problem, given)
    if _no_observer_exists(problem):
        yield from _without_search(problem, given, own)
        return
    search, placed = GainSearch(problem, given, budget, constraints), PlacedGains()
    if "S" not in own and "coordinates" in open_forms(problem):
        placed = yield from _at_once(search)
    for form in open_forms(problem):
        if form == "coordinates" and "S" not in own:
            if common is not None and constraints is None:
                yield from common.candidates(search)
            yield from _in_open_coordinates(search, placed.remarks)
        elif problem.plant.output.measured == "periodic":
            yield from sampled_candidates(search, form, [own])
        else:
            yield _in_known_coordinates(search, form, own)


def _no_observer_exists(problem: Problem) -> bool:
    """Are gains open while a mode that does not decay is unobservable?"""
    plant = problem.plant
    needed = ("L",) if plant.output.measured == "periodic" else ("L", "M")
    if not {*needed} - {*problem.gains, *idle_gains(plant)}:
        return False
    G, ends = None, (math.inf, math.inf)
    if plant.jump is not None:
        G, ends = plant.jump.G, problem.require_dwell_time()
    return not_detectable(plant.flow.A, G, plant.output.C, ends) is not None


def _without_search(problem: Problem, given: Entries, own: Entries) -> Iterator[Candidate]:
    """Yield the forms with zero gains: what refutes them holds for all gains."""
    for form in open_forms(problem):
        yield with_zero_gains(problem, form, given, {**plain_frame(problem, form), **own})


def _refuse_unexecutable(problem: Problem) -> None:
    """Raise InputError for what an interval observer cannot execute."""
    if problem.plant.output.measured != "periodic":
        refuse_unusable(problem)
        return
    if problem.plant.jump is not None:
        problem.require_dwell_time()
    if problem.options_as(IntervalOptions).objective == "shortest_dwell":
        raise InputError(
            "observer.objective = 'shortest_dwell' is not available with measured = 'periodic'; "
            "it must be feasible or narrowest."
        )


def untried(problem: Problem) -> dict[str, str]:
    """Return the forms that `auto` passes over, with the reason."""
    is_stated = problem.options_as(IntervalOptions).form != "auto"
    if is_stated or {"S2", "R"} & set(problem.gains) or problem.plant.needs_clock_gains:
        return {}
    why = (
        "not tried: gains.S and gains.S2 are required, and form coordinates with the same S is "
        "never wider"
    )
    return {"two_coordinates": why}


def _in_known_coordinates(search: GainSearch, form: str, own: Entries) -> Candidate:
    """Return one candidate with L and M for the given coordinates (or the plant's own)."""
    problem, given, budget = search.problem, search.given, search.budget
    if {"L", "M"} <= set(given):
        gains = gains_of_form(problem, form, given["L"], given["M"], own)
        return certified(problem, gains, budget, searched=False)
    task = search.task(form == "cooperative", own.get("S"))
    (value, L, M), remarks = best_gains(task, search.objective, budget)
    if task.is_constrained and search.user is None:
        remarks += _inactive_constraints(search, task, f"form {form}: ")
    if search.user is not None and math.isinf(value):
        return unmet_constraints(f"form {form}", "gains were")
    L, M = task.gains(L, M)
    gains = gains_of_form(problem, form, given.get("L", L), given.get("M", M), own)
    candidate = certified(problem, gains, budget, searched=True, remarks=remarks)
    return with_solvers(candidate, solvers_of_gains(task))


def _inactive_constraints(search: GainSearch, task: Task, where: str) -> tuple[Remark, ...]:
    """Remarks on the constraints that the gains chosen without them meet."""
    (_, L, M), _ = best_gains(replace(task, constraints={}), search.objective, search.budget)
    entries = task.constrained(L, M)
    return tuple(
        remark
        for entry, gain, error in entries
        for remark in inactive_constraints(entry, gain, error, where)
    )


def _at_once(search: GainSearch) -> Generator[Candidate, None, PlacedGains]:
    """Yield what is certified quickly where the searches over forms take long; return all of it."""
    problem = search.problem
    if problem.plant.n < FEWEST_STATES or problem.plant.output.measured == "periodic":
        return PlacedGains()
    placed = placed_gains(search)
    if (choice := placed.choice) is not None:
        gains = gains_of_form(problem, "coordinates", choice.L, choice.M, {"S": choice.S})
        yield with_solvers(certified(problem, gains, search.budget, searched=True), choice.solvers)
    return placed


def _in_open_coordinates(search: GainSearch, remarks: tuple[Remark, ...]) -> Iterator[Candidate]:
    """Yield from candidate bases; only if that is not enough from a search over bases."""
    problem, given = search.problem, search.given
    # forms `cooperative` and `split` are of the plant's own coordinates
    auto = problem.options_as(IntervalOptions).form == "auto"
    if problem.plant.output.measured == "periodic":
        bases = chain(sampled_bases(search), () if auto else (np.diag(search.units.sizes),))
        frames = ({"S": S} for S in bases)
        yield from sampled_candidates(search, "coordinates", frames)
        return
    for improve in (False, True) if auto else (True,):
        best = CoordinateSearch(search).best(improve=improve, with_own=not auto)
        if search.user is not None and math.isinf(best.value):
            yield replace(unmet_constraints("form coordinates", "gains were"), goes_on=improve)
            continue
        L, M = given.get("L", best.L), given.get("M", best.M)
        gains = gains_of_form(problem, "coordinates", L, M, {"S": best.S})
        candidate = certified(
            problem, gains, search.budget, searched=True, goes_on=improve,
            remarks=best.remarks + remarks,
        )  # fmt: skip
        yield with_solvers(candidate, best.solvers)
