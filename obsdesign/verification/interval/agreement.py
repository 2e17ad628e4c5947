"""Do gains of an interval observer and its problem agree? The first claim of every design."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from lmi.arithmetic.balls import exact, inverse
from obsdesign.analysis.interval.requirements import large_gain, open_forms, reason_against
from obsdesign.document import Claim
from obsdesign.entries import is_number
from obsdesign.equations.estimation_error import idle_gains
from obsdesign.equations.gains import plant_data
from obsdesign.equations.interval.gains import CORRECTIONS, IntervalGains, shaped_data
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.consistency import consistent_gains
from obsdesign.verification.dwell import reason_against_problem


def agreed_gains(
    problem: Problem, stored: Entries, effects: Entries
) -> tuple[Claim, IntervalGains | None]:
    """The claim `consistent` and the gains; None where they cannot be read.

    effects: entries of parameters, whose effects the bounds of the problem include.
    """
    expected = {**expected_gains(problem, stored), **effects}
    shape = (len(effects.get("effects", ())), problem.plant.n, problem.plant.p)
    # of any values: they are sound
    expected |= {name: shape for name in CORRECTIONS if effects and name in stored}
    agreement, gains = consistent_gains(
        _reason_against(problem), stored, expected, IntervalGains.from_document
    )
    if gains is None:
        return agreement, None
    agreement = _invertible(gains, _within_limit(problem, gains, agreement))
    return (_marked(gains, agreement) if agreement.verdict == "proved" else agreement), gains


def _within_limit(problem: Problem, gains: IntervalGains, agreement: Claim) -> Claim:
    """The claim of consistency, refuted if a gain exceeds the limit of the problem."""
    large = large_gain(gains.L, gains.M, problem.options_as(IntervalOptions).gain_limit)
    if large is None:
        return agreement
    return _refuted(agreement, large.entry("gains"), large.reason("gains"))


def _invertible(gains: IntervalGains, agreement: Claim) -> Claim:
    """The claim of consistency, refuted if coordinates are singular."""
    if agreement.verdict != "proved":
        return agreement
    for name, S in (("gains.S", gains.S), ("gains.S2", gains.S2)):
        if S is not None and inverse(exact(S)) is None:
            return _refuted(agreement, name, f"{name} is singular")
    return agreement


def _refuted(agreement: Claim, entry: str, reason: str) -> Claim:
    evidence = {"witness": {"entry": entry, "reason": reason}}
    return replace(agreement, verdict="refuted", evidence=evidence)


def _marked(gains: IntervalGains, agreement: Claim) -> Claim:
    """The claim that gains and problem agree, with a mark where they do not use the sensor."""
    if gains.L.any() or gains.M.any():
        return agreement
    return replace(agreement, evidence={**agreement.evidence, "zero_gains": True})


def _reason_against(problem: Problem) -> str | None:
    """Reason against an interval observer for the problem, or None."""
    reason = reason_against(problem)
    is_periodic = problem.plant.output.measured == "periodic"
    reason = reason or (None if is_periodic else reason_against_problem(problem))
    return reason or problem.reason_without_noise_bound()


def expected_gains(problem: Problem, stored: Entries) -> NewEntries:
    """Entries of the stored gains, each with the value that the problem fixes, or its shape.

    The form that they name decides which entries there are.
    """
    plant, form = problem.plant, stored.get("form")
    n, p = plant.n, plant.p
    forms = set(open_forms(problem))
    expected: NewEntries = {"form": forms} | plant_data(plant)
    if plant.output.measured == "periodic":
        expected |= {"period": plant.output.period}
    elif _has_step_limit(problem, stored):  # `sampled_width` is about this limit, and no other
        expected |= {"step_limit": stored.get("step_limit")}
    if "dwell_time" in expected and _is_wider(problem, stored.get("dwell_time")):
        expected |= {"dwell_time": stored.get("dwell_time")}
    expected |= {"L": (n, p), "M": (n, p), "D0": (n, n), "D1": (n, n)}
    if form == "two_coordinates":
        expected |= {"S": (n, n), "S2": (n, n), "T": (n, n)}
    elif plant.jump is not None:
        expected |= {"Gp": (n, n), "Gn": (n, n)}
    if form == "coordinates":
        expected |= {"S": (n, n)}
    expected |= {name: value for name, value in shaped_data(plant).items() if name in stored}
    zeros = {name: np.zeros((n, p)) for name in idle_gains(plant)}
    given = dict(problem.gains)
    if (R := given.pop("R", None)) is not None:  # R is stored as D0; S and S2 are built for it
        given |= {"D0": R, "D1": 0 * R}
    return expected | given | zeros


def _has_step_limit(problem: Problem, stored: Entries) -> bool:
    """Does the problem name the spacing of a continuous y that is used between jumps?"""
    output = problem.plant.output
    named = output.measured == "continuous" and output.period is not None
    has_limit = is_number(stored.get("step_limit"))
    return named and has_limit and bool(np.any(stored.get("L", 0.0)))


def _is_wider(problem: Problem, dwell_time: Value) -> bool:
    """Does the range of a search for the shortest dwell time hold the one of the problem?"""
    if problem.options_as(IntervalOptions).objective != "shortest_dwell" or np.shape(
        dwell_time
    ) != (2,):
        return False
    low, high = problem.require_dwell_time()
    return bool(0.0 <= dwell_time[0] <= low and dwell_time[1] == high)
