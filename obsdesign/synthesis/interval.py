"""Interval observers: from given gains to candidates in each form.

Source: Degue, Efimov, Richard, NOLCOS 2016, Theorems 5 (`cooperative`), 8 (`split`), 7 and 8
combined (`coordinates`) and 7 as corrected (`two_coordinates`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from lmi.balls import exact, inverse
from obsdesign.equations import interval as equations
from obsdesign.equations.interval_width import width_system_of
from obsdesign.errors import InputError
from obsdesign.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.dwell import dwell_certificates
from obsdesign.synthesis.given_gains import given_gain, refuse_unusable
from obsdesign.synthesis.interval_coordinates import bases
from obsdesign.synthesis.interval_forms import formed
from obsdesign.synthesis.interval_tube import propose_limit, proved_width


def synthesize(problem: Problem) -> Iterator[Candidate]:
    """Candidates in the order in which they are to be preferred.

    InputError when a gain is missing, or the form cannot be built from gains that are given.
    """
    plant, given = problem.plant, problem.gains
    if text := equations.objection(plant, given, problem.options):
        raise InputError(text)
    refuse_unusable(problem)
    L, M = _gain(problem, "L"), _gain(problem, "M")
    own = {name: given[name] for name in ("S", "S2", "T") if name in given}
    for form in equations.forms_asked(given, problem.options):
        if form != "coordinates" or own:
            yield _candidate(problem, form, L, M, own)
            continue
        for S in bases(plant, L, M):
            yield _candidate(problem, form, L, M, {"S": S})


def _gain(problem: Problem, name: str) -> Any:
    gain = given_gain(problem, name)
    if gain is None:
        n, p = problem.plant.n, problem.plant.p
        raise InputError(
            f"observer.gains.{name} ({n}x{p}) is required by kind 'interval' in this version; "
            "it is missing. Give zeros to use no correction."
        )
    return gain


def _candidate(problem: Problem, form: str, L: Any, M: Any, own: dict[str, Any]) -> Candidate:
    gains = formed(problem, form, L, M, own)
    system, approx = width_system_of(gains, exact, inverse), width_system_of(gains)
    if system.N is None:
        width = propose_limit(approx)
        return Candidate(form, gains, {} if width is None else {"width": width})
    low, high = gains["dwell_time"]
    certificates = dwell_certificates(system.W, system.N, low, high)
    width = proved_width(system, approx, low, high)
    if width is not None:
        certificates["width"] = width
    return Candidate(form, gains, certificates)
