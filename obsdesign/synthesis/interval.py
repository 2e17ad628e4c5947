"""Interval observers: from given gains L, M to candidates in each form.

Source: Degue, Efimov, Richard, NOLCOS 2016, Theorems 5 (`cooperative`) and 8 (`split`). The
splits default to the minimal ones, which no other split can beat.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from obsdesign.equations import interval as equations
from obsdesign.equations.estimation_error import flow_error_matrix, jump_error_matrix, plant_data
from obsdesign.errors import InputError
from obsdesign.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.dwell import dwell_certificates, question
from obsdesign.synthesis.given_gains import given_gain, refuse_unusable


def synthesize(problem: Problem) -> Iterator[Candidate]:
    """Candidates in the order in which they are to be preferred.

    InputError when a gain is missing, or the form cannot be built from gains that are given.
    """
    plant, given = problem.plant, problem.gains
    if text := equations.objection(plant, given, problem.options):
        raise InputError(text)
    refuse_unusable(problem)
    form = problem.options.get("form", "auto")
    L, M = _gain(problem, "L"), _gain(problem, "M")
    data = plant_data(plant) | {"L": L, "M": M}
    own = [name for name in ("D0", "D1", "Gp", "Gn") if name in given]
    if own and form == "cooperative":
        raise InputError(
            f"observer.gains.{own[0]} belongs to form 'split'; got it with form 'cooperative'."
        )
    F = flow_error_matrix(plant.flow.A, L, plant.output.C)
    H = _jump_error(problem, M)
    if form in ("cooperative", "auto") and not own:
        yield _candidate(problem, "cooperative", data, F, F, 0 * F, H)
    if form in ("split", "auto"):
        D0, D1 = _own_split(given, "D0", "D1", F, equations.metzler_split)
        yield _candidate(problem, "split", data, F, D0, D1, H, given)


def _gain(problem: Problem, name: str) -> Any:
    gain = given_gain(problem, name)
    if gain is None:
        n, p = problem.plant.n, problem.plant.p
        raise InputError(
            f"observer.gains.{name} ({n}x{p}) is required by kind 'interval' in this version; "
            "it is missing. Give zeros to use no correction."
        )
    return gain


def _jump_error(problem: Problem, M: Any) -> Any:
    plant = problem.plant
    if plant.jump is None:
        return None
    when = plant.output.jump_measurement
    return jump_error_matrix(plant.jump.G, M, plant.output.C, when)


def _own_split(given: Any, plus: str, minus: str, X: Any, minimal: Any) -> tuple[Any, Any]:
    """The user's split; one half given determines the other; none given: the minimal one."""
    if plus in given and minus in given:
        return given[plus], given[minus]
    if plus in given:
        return given[plus], given[plus] - X
    if minus in given:
        return X + given[minus], given[minus]
    halves: tuple[Any, Any] = minimal(X)
    return halves


def _candidate(
    problem: Problem,
    form: str,
    data: dict[str, Any],
    F: Any,
    D0: Any,
    D1: Any,
    H: Any,
    given: Any = None,
) -> Candidate:
    gains = {"form": form} | data | {"D0": D0, "D1": D1}
    if H is None:
        return Candidate(form, gains)
    if form == "cooperative":
        Gp, Gn = H, 0 * H
    else:
        Gp, Gn = _own_split(given, "Gp", "Gn", H, equations.nonnegative_split)
    gains |= {"Gp": Gp, "Gn": Gn}
    W, N = equations.width_pair(F, H, gains)
    certificates = dwell_certificates(W, N, *gains["dwell_time"], **question(problem))
    return Candidate(form, gains, certificates)
