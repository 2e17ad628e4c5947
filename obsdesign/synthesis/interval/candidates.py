"""Interval observers: candidates in each form, gains and coordinates found where they are open.

Source: Degue, Efimov, Richard, NOLCOS 2016, Theorems 5 (`cooperative`), 8 (`split`), 7 and 8
combined (`coordinates`) and 7 as corrected (`two_coordinates`). What is found is only proposed:
verification analyses every candidate exactly.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, inverse
from lmi.decide.dwell_search import shortest_dwell
from lmi.time_budget import deadline, remaining
from obsdesign.analysis.hidden_modes import hidden_for_ever
from obsdesign.equations.estimation_error import idle_gains
from obsdesign.equations.interval import splits as equations
from obsdesign.equations.interval.width import WidthSystem, width_system_of
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.dwell import dwell_certificates, question
from obsdesign.synthesis.given_gains import given_gain, refuse_unusable
from obsdesign.synthesis.interval.coordinates import best_coordinates
from obsdesign.synthesis.interval.descent import SECONDS, best_gains
from obsdesign.synthesis.interval.forms import formed
from obsdesign.synthesis.interval.goals import mean_width
from obsdesign.synthesis.interval.periodic import SampledPlant, sampled_bases
from obsdesign.synthesis.interval.sampled_width import (
    propose_samples,
    propose_spacing,
    sampled_tube,
)
from obsdesign.synthesis.interval.task import task_of
from obsdesign.synthesis.interval.tube import proved_width

# proofs of gains for samples that are tried before the answer is that none was proved
_PROOFS = 4


def synthesize(problem: Problem) -> Iterator[Candidate]:
    """Candidates in the order in which they are to be preferred; those with a cost, by cost.

    InputError for what cannot be built from the gains that are given.
    """
    if text := equations.plant_objection(problem.plant):
        raise DoesNotApply(text)
    if text := equations.objection(problem.plant, problem.gains, problem.options):
        raise InputError(text)
    problem.require_noise_bound("kind 'interval'")
    _refuse(problem)
    given = {name: given_gain(problem, name) for name in ("L", "M")}
    given = {name: gain for name, gain in given.items() if gain is not None}
    own = {name: problem.gains[name] for name in ("S", "S2", "T") if name in problem.gains}
    if _hopeless(problem):
        yield from _unsearched(problem, given, own)
        return
    for form in equations.forms_asked(problem.gains, problem.options):
        if form == "coordinates" and "S" not in own:
            yield from _in_found_coordinates(problem, given)
        elif problem.plant.output.measured == "periodic":
            yield from _with_samples(problem, form, given, [own])
        else:
            yield _in_known_coordinates(problem, form, given, own)


def _hopeless(problem: Problem) -> bool:
    """Gains are open and none can do, since no output sees what does not shrink."""
    plant = problem.plant
    needed = ("L",) if plant.output.measured == "periodic" else ("L", "M")
    if not {*needed} - {*problem.gains, *idle_gains(plant)}:
        return False
    G, ends = None, (math.inf, math.inf)
    if plant.jump is not None:
        G, ends = plant.jump.G, problem.require_dwell_time()
    return hidden_for_ever(plant.flow.A, G, plant.output.C, ends) is not None


def _unsearched(
    problem: Problem, given: Mapping[str, Any], own: Mapping[str, Any]
) -> Iterator[Candidate]:
    """The forms as they are without gains: what verification says of them holds for all gains."""
    for form in equations.forms_asked(problem.gains, problem.options):
        yield _without_gains(problem, form, given, {**_plain_frame(problem, form), **own})


def _refuse(problem: Problem) -> None:
    """InputError for what an interval observer cannot execute."""
    if problem.plant.output.measured != "periodic":
        refuse_unusable(problem)
        return
    if problem.plant.jump is not None:
        problem.require_dwell_time()
    if problem.options.get("objective") == "shortest_dwell":
        raise InputError(
            "observer.objective = 'shortest_dwell' is not available with measured = 'periodic'; "
            "it must be feasible or narrowest."
        )


def untried(problem: Problem) -> dict[str, str]:
    """Forms that `auto` passes over, and why."""
    if problem.options.get("form", "auto") != "auto" or "S2" in problem.gains:
        return {}
    why = (
        "not tried: gains.S and gains.S2 are required, and form coordinates with the same S is "
        "never wider"
    )
    return {"two_coordinates": why}


def _objective(problem: Problem) -> str:
    return str(problem.options.get("objective", "feasible"))


def _in_known_coordinates(
    problem: Problem, form: str, given: Mapping[str, Any], own: Mapping[str, Any]
) -> Candidate:
    """One candidate, L and M found for the coordinates that are given (or the plant's own)."""
    if {"L", "M"} <= set(given):
        return _candidate(problem, form, given["L"], given["M"], own, False)
    task = task_of(problem, form == "cooperative", own.get("S"), given)
    _, L, M = best_gains(task, _objective(problem))
    L, M = task.gains(L, M)
    return _candidate(problem, form, given.get("L", L), given.get("M", M), own, True)


def _with_samples(
    problem: Problem, form: str, given: Mapping[str, Any], frames: Iterable[Mapping[str, Any]]
) -> Iterator[Candidate]:
    """One candidate with samples as events: gain and coordinates that are proved, if any are.

    frames: coordinates S (S2, T) to choose from. M, which acts only when a jump meets a sample, is
    zero if open. With `narrowest` the least width comes first, else what comes first.
    """
    narrow, end = _objective(problem) == "narrowest", deadline(SECONDS)
    tries: list[tuple[float, Any, Mapping[str, Any]]] = []
    last, frame = None, _plain_frame(problem, form)
    for frame in frames:
        for cost, L in _sampled_gains(problem, frame.get("S"), given):
            tries.append((cost, L, frame))
            if not narrow and math.isfinite(cost):
                last = _sampled_candidate(problem, form, given, *tries[-1])
                if _is_proved(last):
                    yield last
                    return
        if time.process_time() > end:
            break
    tries = sorted(tries, key=lambda one: one[0]) if narrow else tries[:1]
    for one in tries[:_PROOFS]:
        last = _sampled_candidate(problem, form, given, *one)
        if _is_proved(last):
            break
    # no gain at all: what verification says of none holds for what was not tried too
    yield last or _without_gains(problem, form, given, frame)


def _plain_frame(problem: Problem, form: str) -> Mapping[str, Any]:
    """The plant's own coordinates, for a form that needs some."""
    return {"S": np.eye(problem.plant.n)} if form == "coordinates" else {}


def _without_gains(
    problem: Problem, form: str, given: Mapping[str, Any], frame: Mapping[str, Any]
) -> Candidate:
    zero = np.zeros((problem.plant.n, problem.plant.p))
    gains = formed(problem, form, given.get("L", zero), given.get("M", zero), frame)
    return Candidate(form, gains, searched=True)


def _sampled_gains(
    problem: Problem, S: Any, given: Mapping[str, Any]
) -> Iterator[tuple[float, Any]]:
    """(cost, L): L in the plant's coordinates; the cost is infinite where floats see no tube."""
    plant = SampledPlant(problem, S)
    lost = problem.plant.output.jump_measurement == "none" and plant.G is not None
    pairs = [plant.inward @ given["L"]] if "L" in given else (L for _, L in plant.gains())
    for L in pairs:
        tube = sampled_tube(plant.system(L), plant.h, plant.dwell, lost)
        cost = math.inf if tube is None else plant.width(L)
        yield cost, given["L"] if "L" in given else plant.outward(L)


def _sampled_candidate(
    problem: Problem, form: str, given: Mapping[str, Any], cost: float, L: Any,
    frame: Mapping[str, Any],
) -> Candidate:  # fmt: skip
    searched = "L" not in given or ("S" in frame and "S" not in problem.gains)
    gains = formed(problem, form, L, given.get("M", 0 * L), frame)
    system, approx = width_system_of(gains, exact, inverse), width_system_of(gains)
    lost = gains["jump_measurement"] == "none"
    found = propose_samples(system, approx, gains["period"], _dwell_range(gains), lost)
    value = cost if _objective(problem) == "narrowest" else None
    return Candidate(form, gains, {"sampled_stability": found}, searched, value, True)


def _is_proved(candidate: Candidate) -> bool:
    return "tube" in candidate.certificates["sampled_stability"]


def _in_found_coordinates(problem: Problem, given: Mapping[str, Any]) -> Iterator[Candidate]:
    """Candidate bases first; the search over bases only if that is not enough."""
    if problem.plant.output.measured == "periodic":
        frames = ({"S": S} for S in sampled_bases(problem, given))
        yield from _with_samples(problem, "coordinates", given, frames)
        return
    auto = problem.options.get("form", "auto") == "auto"
    for search in (False, True) if auto else (True,):
        found = best_coordinates(problem, given, _objective(problem), search)
        if found is None:
            continue
        L, M = given.get("L", found.L), given.get("M", found.M)
        yield _candidate(problem, "coordinates", L, M, {"S": found.S}, True, goes_on=search)


def _candidate(
    problem: Problem, form: str, L: Any, M: Any, own: Mapping[str, Any], searched: bool,
    goes_on: bool = True,
) -> Candidate:  # fmt: skip
    gains = formed(problem, form, L, M, own)
    system, approx = width_system_of(gains, exact, inverse), width_system_of(gains)
    objective = _objective(problem)
    cost = _cost(problem, form, gains) if objective == "narrowest" else None
    certificates: dict[str, Any] = {}
    if system.N is not None:
        low, high = gains["dwell_time"]
        if objective == "shortest_dwell":
            low, certificates = _widest_range(problem, system, low, high)
            gains["dwell_time"], cost = [low, high], low
        certificates = certificates or dwell_certificates(
            system.W, system.N, low, high, **question(problem)
        )
    if remaining() > 0:
        certificates |= _widths(problem, gains, system, approx)
        # where a spacing was named, the observer watches it
        if "sampled_width" in certificates and problem.plant.output.period is not None:
            gains["step_limit"] = certificates["sampled_width"]["step_limit"]
    return Candidate(form, gains, certificates, searched, cost, goes_on)


def _widths(
    problem: Problem, gains: Mapping[str, Any], system: WidthSystem, approx: WidthSystem
) -> dict[str, Any]:
    """How wide the bounds get with a continuous y, and with samples of it, as far as found."""
    found: dict[str, Any] = {}
    width = proved_width(system, approx, *_dwell_range(gains))
    if width is not None:
        found["width"] = width
    if problem.plant.output.measured == "continuous":
        period = problem.plant.output.period
        spacing = propose_spacing(gains, system, *_dwell_range(gains), period)
        if spacing is not None:
            found["sampled_width"] = spacing
    return found


def _dwell_range(gains: Mapping[str, Any]) -> tuple[float, float]:
    low, high = gains.get("dwell_time", (math.inf, math.inf))
    return low, high


def _cost(problem: Problem, form: str, gains: Mapping[str, Any]) -> float:
    """Mean width of x, summed over the states, of finished gains."""
    given = {"L": gains["L"], "M": gains["M"]}
    task = task_of(problem, form == "cooperative", gains.get("S"), given)
    return mean_width(task, 0 * gains["L"], 0 * gains["M"])


def _widest_range(
    problem: Problem, system: WidthSystem, low: float, high: float
) -> tuple[float, dict[str, Any]]:
    """(shortest dwell time, certificates): the range found if it holds the one asked for."""
    N, _ = system.at_jumps
    bracket = shortest_dwell(system.W, N, high, **question(problem))
    if bracket.proved is None or not bracket.proved <= low or math.isinf(bracket.proved):
        return low, {}
    return bracket.proved, {"dwell_stability": dict(bracket.certificate)}
