"""Candidates for interval observers in each form, with open gains and coordinates chosen.

Source: Degue, Efimov, Richard, NOLCOS 2016, Theorems 5 (`cooperative`), 8 (`split`), 7 and 8
combined (`coordinates`) and 7 as corrected (`two_coordinates`). Candidates are proposals:
verification analyses each of them exactly.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array, Entries
from lmi.arithmetic.balls import exact, inverse
from lmi.decide.dwell_search import dwell_bracket
from lmi.solvers import Solvers, merged
from lmi.time_budget import UNLIMITED, Remark, TimeBudget
from obsdesign.analysis.hidden_modes import not_detectable
from obsdesign.analysis.interval.requirements import (
    open_forms,
    reason_against,
    reason_against_plant,
)
from obsdesign.equations.estimation_error import idle_gains
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate, Certificates
from obsdesign.synthesis.dwell import dwell_certificates, stability_options
from obsdesign.synthesis.given_gains import given_gain, refuse_unusable
from obsdesign.synthesis.interval.coordinates import CoordinateSearch
from obsdesign.synthesis.interval.descent import best_gains, solvers_of_gains
from obsdesign.synthesis.interval.forms import gains_of_form
from obsdesign.synthesis.interval.goals import mean_width
from obsdesign.synthesis.interval.periodic import SampledPlant, sampled_bases
from obsdesign.synthesis.interval.sampled_width import (
    propose_samples,
    propose_spacing,
    sampled_tube,
)
from obsdesign.synthesis.interval.similarity import coordinates_of_assumption_4
from obsdesign.synthesis.interval.task import Task
from obsdesign.synthesis.interval.tube import proved_width, solvers_of_tube

# proofs for samples as events that are tried before a candidate is given up as not proved
_MOST_PROOFS = 4
# gains that are tried for samples as events, times n^3
_TRIAL_WORK = 75_000


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield candidates in order of preference; those with a cost, by cost.

    InputError where the given gains cannot be completed.
    """
    if reason := reason_against_plant(problem.plant):
        raise DoesNotApply(reason)
    if reason := reason_against(problem):
        raise InputError(reason)
    problem.require_noise_bound("kind 'interval'")
    _refuse_unexecutable(problem)
    stated = {name: given_gain(problem, name) for name in ("L", "M")}
    given = {name: gain for name, gain in stated.items() if gain is not None}
    own = {name: problem.gains[name] for name in ("S", "S2", "T") if name in problem.gains}
    if "R" in problem.gains:
        own = coordinates_of_assumption_4(problem, given)
    if _no_observer_exists(problem):
        yield from _without_search(problem, given, own)
        return
    for form in open_forms(problem):
        if form == "coordinates" and "S" not in own:
            yield from _in_open_coordinates(problem, given, budget)
        elif problem.plant.output.measured == "periodic":
            yield from _with_samples(problem, form, given, [own], budget)
        else:
            yield _in_known_coordinates(problem, form, given, own, budget)


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
        yield _with_zero_gains(problem, form, given, {**_plain_frame(problem, form), **own})


def _refuse_unexecutable(problem: Problem) -> None:
    """Raise InputError for what an interval observer cannot execute."""
    if problem.plant.output.measured != "periodic":
        refuse_unusable(problem)
        return
    if problem.plant.jump is not None:
        problem.require_dwell_time()
    if _objective(problem) == "shortest_dwell":
        raise InputError(
            "observer.objective = 'shortest_dwell' is not available with measured = 'periodic'; "
            "it must be feasible or narrowest."
        )


def untried(problem: Problem) -> dict[str, str]:
    """Return the forms that `auto` passes over, with the reason."""
    if problem.options_as(IntervalOptions).form != "auto" or {"S2", "R"} & set(problem.gains):
        return {}
    why = (
        "not tried: gains.S and gains.S2 are required, and form coordinates with the same S is "
        "never wider"
    )
    return {"two_coordinates": why}


def _objective(problem: Problem) -> str:
    return problem.options_as(IntervalOptions).objective


def _in_known_coordinates(
    problem: Problem,
    form: str,
    given: Entries,
    own: Entries,
    budget: TimeBudget,
) -> Candidate:
    """Return one candidate with L and M for the given coordinates (or the plant's own)."""
    if {"L", "M"} <= set(given):
        gains = gains_of_form(problem, form, given["L"], given["M"], own)
        return _candidate(problem, gains, budget, searched=False)
    task = Task.from_problem(problem, form == "cooperative", own.get("S"), given)
    (_, L, M), remarks = best_gains(task, _objective(problem), budget)
    L, M = task.gains(L, M)
    gains = gains_of_form(problem, form, given.get("L", L), given.get("M", M), own)
    candidate = _candidate(problem, gains, budget, searched=True, remarks=remarks)
    return _with_solvers(candidate, solvers_of_gains(task))


def _with_samples(
    problem: Problem,
    form: str,
    given: Entries,
    frames: Iterable[Entries],
    budget: TimeBudget,
) -> Iterator[Candidate]:
    """Yield one candidate with samples as events: gain and coordinates that are proved, if any.

    frames: coordinates S (S2, T) to choose from. M, which acts only when a jump meets a sample, is
    zero if open. With `narrowest` the least width is tried first, else the first gain.
    """
    narrow = _objective(problem) == "narrowest"
    most = budget.scaled(_TRIAL_WORK) // problem.plant.n**3
    trials: list[_SampledTrial] = []
    last, frame = None, _plain_frame(problem, form)
    for frame in frames:
        for trial in _sampled_trials(problem, frame, given, budget):
            trials.append(trial)
            if not narrow and math.isfinite(trial.cost):
                last = _sampled_candidate(problem, form, given, trial)
                if _is_proved(last):
                    yield last
                    return
        if len(trials) > most or budget.remaining() < 0:
            break
    trials = sorted(trials, key=lambda trial: trial.cost) if narrow else trials[:1]
    for trial in trials[:_MOST_PROOFS]:
        last = _sampled_candidate(problem, form, given, trial)
        if _is_proved(last):
            break
    # without any trial, a refutation of zero gains holds for the gains that were not tried too
    yield last or _with_zero_gains(problem, form, given, frame)


def _plain_frame(problem: Problem, form: str) -> Entries:
    """Return the plant's own coordinates, for a form that needs some."""
    return {"S": np.eye(problem.plant.n)} if form == "coordinates" else {}


def _with_zero_gains(problem: Problem, form: str, given: Entries, frame: Entries) -> Candidate:
    zero = np.zeros((problem.plant.n, problem.plant.p))
    gains = gains_of_form(problem, form, given.get("L", zero), given.get("M", zero), frame)
    return Candidate(form, gains, searched=True)


@dataclass(frozen=True)
class _SampledTrial:
    """L in the plant's coordinates for coordinates S (S2, T); cost: inf if floats have no tube."""

    cost: float
    L: Array
    frame: Entries


def _sampled_trials(
    problem: Problem, frame: Entries, given: Entries, budget: TimeBudget
) -> Iterator[_SampledTrial]:
    plant = SampledPlant(problem, frame.get("S"), budget)
    skips_jumps = problem.plant.output.jump_measurement == "none" and plant.G is not None
    gains: Iterable[Array] = (L for _, L in plant.gains())
    if "L" in given:
        gains = [plant.inward @ given["L"]]
    for L in gains:
        tube = sampled_tube(plant.system(L), plant.h, plant.dwell, skips_jumps)
        cost = math.inf if tube is None else plant.width(L)
        yield _SampledTrial(cost, given["L"] if "L" in given else plant.outward(L), frame)


def _sampled_candidate(
    problem: Problem, form: str, given: Entries, trial: _SampledTrial
) -> Candidate:
    searched = "L" not in given or ("S" in trial.frame and "S" not in problem.gains)
    gains = gains_of_form(problem, form, trial.L, given.get("M", 0 * trial.L), trial.frame)
    system, approx = WidthSystem.from_gains(gains, exact, inverse), WidthSystem.from_gains(gains)
    certificate = propose_samples(gains, system, approx)
    value = trial.cost if _objective(problem) == "narrowest" else None
    certificates = {"sampled_stability": certificate}
    solvers: Solvers = ("HiGHS",) if "L" not in given or "tube" in certificate else ()
    return Candidate(form, gains, certificates, searched, value, goes_on=True, solvers=solvers)


def _is_proved(candidate: Candidate) -> bool:
    return "tube" in candidate.certificates["sampled_stability"]


def _in_open_coordinates(
    problem: Problem, given: Entries, budget: TimeBudget
) -> Iterator[Candidate]:
    """Yield from candidate bases; only if that is not enough from a search over bases."""
    if problem.plant.output.measured == "periodic":
        frames = ({"S": S} for S in sampled_bases(problem, given))
        yield from _with_samples(problem, "coordinates", given, frames, budget)
        return
    auto = problem.options_as(IntervalOptions).form == "auto"
    search = CoordinateSearch(problem, given, _objective(problem), budget)
    for improve in (False, True) if auto else (True,):
        best = search.best(improve=improve)
        L, M = given.get("L", best.L), given.get("M", best.M)
        gains = gains_of_form(problem, "coordinates", L, M, {"S": best.S})
        candidate = _candidate(
            problem, gains, budget, searched=True, goes_on=improve, remarks=best.remarks
        )
        yield _with_solvers(candidate, best.solvers)


def _with_solvers(candidate: Candidate, first: Solvers) -> Candidate:
    """The candidate with the solvers of its gains before those of its certificates."""
    return replace(candidate, solvers=merged(first, candidate.solvers))


def _candidate(
    problem: Problem,
    gains: IntervalGains,
    budget: TimeBudget,
    *,
    searched: bool,
    goes_on: bool = True,
    remarks: tuple[Remark, ...] = (),
) -> Candidate:
    system, approx = WidthSystem.from_gains(gains, exact, inverse), WidthSystem.from_gains(gains)
    objective = _objective(problem)
    cost = _cost(problem, gains) if objective == "narrowest" else None
    certificates = Certificates()
    if system.N is not None:
        low, high = gains.dwell_ends
        if objective == "shortest_dwell":
            low, certificates = _widest_range(problem, system, (low, high), budget)
            gains, cost = replace(gains, dwell_time=np.array([low, high])), low
        if not certificates.evidence:
            certificates = dwell_certificates(
                system.W, system.N, low, high, **stability_options(problem, budget)
            )
    if budget.remaining() > 0:
        widths = _widths(problem, gains, system, approx)
        certificates = certificates.joined(widths)
        # where a spacing was named, the observer watches it
        if "sampled_width" in widths.evidence and problem.plant.output.period is not None:
            gains = replace(gains, step_limit=widths.evidence["sampled_width"]["step_limit"])
    return Candidate(
        gains.form, gains, certificates.evidence, searched, cost, goes_on, remarks,
        certificates.solvers,
    )  # fmt: skip


def _widths(
    problem: Problem, gains: IntervalGains, system: WidthSystem, approx: WidthSystem
) -> Certificates:
    """Return certificates of the width with a continuous y, and with samples of it."""
    certificates: dict[str, Entries] = {}
    width = proved_width(system, approx, *gains.dwell_ends)
    if width is not None:
        certificates["width"] = width
    if problem.plant.output.measured == "continuous":
        period = problem.plant.output.period
        spacing = propose_spacing(gains, system, *gains.dwell_ends, period)
        if spacing is not None:
            certificates["sampled_width"] = spacing
    return Certificates(certificates, solvers_of_tube(system) if certificates else ())


def _cost(problem: Problem, gains: IntervalGains) -> float:
    """Return the mean width of x, summed over the states, of finished gains."""
    given = {"L": gains.L, "M": gains.M}
    task = Task.from_problem(problem, gains.form == "cooperative", gains.S, given)
    return mean_width(task, 0 * gains.L, 0 * gains.M)


def _widest_range(
    problem: Problem, system: WidthSystem, ends: tuple[float, float], budget: TimeBudget
) -> tuple[float, Certificates]:
    """Return (shortest dwell time, certificates): the proved range if it holds the required one."""
    (N, _), (low, high) = system.at_jumps, ends
    bracket = dwell_bracket(system.W, N, "shortest", high, **stability_options(problem, budget))
    if bracket.proved is None or not bracket.proved <= low or math.isinf(bracket.proved):
        return low, Certificates()
    evidence = {"dwell_stability": bracket.certificate}
    return bracket.proved, Certificates({**evidence}, bracket.solvers)
