"""Interval observers of plants with modes: gains for each mode, one certificate, one tube.

Gains of a mode are those of its flow alone. Where it grows by itself and y does not see it, they
are those of the flow slowed down: other modes have to make up for it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import exact
from lmi.time_budget import UNLIMITED, Remark, TimeBudget
from obsdesign.equations.clocks import events_of
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.modes import SwitchedGains
from obsdesign.problem.modes import spans_of
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.interval.descent import best_gains
from obsdesign.synthesis.interval.forms import gains_of_form
from obsdesign.synthesis.interval.mode_tubes import mode_certificates
from obsdesign.synthesis.interval.task import GainSearch
from obsdesign.synthesis.modes import require_served


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield one candidate; InputError where the given gains cannot be used."""
    require_served(problem)
    gains, remarks = [], list[Remark]()
    for k in range(len(problem.plant.modes)):
        own, more = _gains_of_mode(problem, k, budget)
        gains.append(own)
        remarks += more
    plant = problem.plant
    spacing = plant.timing.spacing or None
    switched = SwitchedGains(spans_of(plant.modes), tuple(gains), events_of(plant), spacing)
    certificates = mode_certificates(problem, switched, budget)
    searched = any("L" not in own.gains for own in problem.in_modes)
    yield Candidate(
        "one gain for each mode", switched, certificates.evidence, searched,
        remarks=tuple(remarks), solvers=certificates.solvers,
    )  # fmt: skip


def _gains_of_mode(
    problem: Problem, place: int, budget: TimeBudget
) -> tuple[IntervalGains, tuple[Remark, ...]]:
    """L of a mode, given or searched, in the first form that it fits."""
    own, plant = problem.in_modes[place], problem.plant.in_mode(place, entered=True)
    L, remarks = own.gains.get("L"), tuple[Remark, ...]()
    form = problem.options_as(IntervalOptions).form
    if L is None:
        L, remarks = _searched(own, form, budget)
    F = flow_error_matrix(exact(own.plant.flow.A), exact(L), exact(own.plant.output.C))
    is_positive = all(x >= 0 for x in F[~np.eye(len(F), dtype=bool)])
    if plant.jump is not None:
        is_positive = is_positive and bool((plant.jump.G >= 0).all())
    if form == "auto":
        form = "cooperative" if is_positive else "split"
    entered = own if plant.jump is None else _with_plant(own, problem, place)
    zero = np.zeros((plant.n, plant.p))
    return gains_of_form(entered, form, np.asarray(L), zero, {}), remarks


def _with_plant(own: Problem, problem: Problem, place: int) -> Problem:
    """The problem of a mode with the map on entry as its jump."""
    G = problem.plant.in_mode(place, entered=True).jump
    assert G is not None
    body = own.to_dict()
    if "sensor" in body:
        body["event"] = [{"name": "entry", "G": G.G.tolist()}]
    else:
        body["jump"] = {"G": G.G.tolist()}
    return Problem.from_dict(body)


def _searched(
    own: Problem, form: str, budget: TimeBudget
) -> tuple[Matrix, tuple[Remark, ...]]:  # fmt: skip
    """The gain of least width of a mode, of its flow slowed down where it has none."""
    growth = max(float(np.linalg.eigvals(own.plant.flow.A).real.max()), 0.0)
    size = float(np.abs(own.plant.flow.A).max()) or 1.0
    remarks: tuple[Remark, ...] = ()
    for slowed in (0.0, growth + 0.05 * size, 2 * growth + 0.5 * size):
        problem = own if slowed == 0 else _slowed(own, slowed)
        search, results = GainSearch(problem, {}, budget), []
        for positive in (True, False):
            if form in ("auto", "cooperative" if positive else "split"):
                task = search.task(positive, None)
                (value, L, M), more = best_gains(task, "narrowest", budget)
                remarks += more
                results.append((value, task.gains(L, M)[0]))
        value, L = min(results, key=lambda result: result[0])
        if math.isfinite(value):
            return L, remarks
    return np.zeros((own.plant.n, own.plant.p)), remarks


def _slowed(own: Problem, rate: float) -> Problem:
    body = own.to_dict()
    body["flow"]["A"] = (own.plant.flow.A - rate * np.eye(own.plant.n)).tolist()
    return Problem.from_dict(body)
