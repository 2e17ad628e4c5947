"""Problems that have an interval observer, and the forms that they leave open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array
from obsdesign.analysis.unbounded_inputs import reason_against_unbounded
from obsdesign.equations.estimation_error import idle_gains
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem

_SPLITS = ("D0", "D1", "Gp", "Gn")


def reason_against(problem: Problem) -> str | None:
    """Reason against an interval observer for a problem, one sentence, or None.

    Unbounded inputs are refused, and options without effect.
    """
    gains, options = problem.gains, problem.options_as(IntervalOptions)
    if reason := reason_against_plant(problem.plant):
        return reason
    if large := large_gain(gains.get("L"), gains.get("M"), options.gain_limit):
        return large.reason("observer.gains")
    if reason := _reason_against_width(problem):
        return reason
    return _reason_against_form(problem, gains, options.form)


def reason_against_parameters(problem: Problem) -> str | None:
    """Reason against options of a problem with parameters, or None."""
    options, gains = problem.options_as(IntervalOptions), problem.gains
    if options.form == "two_coordinates" or {"S2", "R"} & set(gains):
        return (
            "form 'two_coordinates' is not available with parameters; it must be cooperative, "
            "split or coordinates."
        )
    if options.objective == "shortest_dwell" and problem.plant.state is None:
        return (
            "[state] is required by observer.objective = 'shortest_dwell' with parameters, since "
            "a box that is proved from the plant holds for its own dwell times; it is missing."
        )
    return None


def objective_of(problem: Problem) -> str:
    """What open gains are chosen for: the narrowest bounds, unless another objective is stated.

    Where L and M are given it is `feasible`: forms are tried in order, and none is searched for.
    """
    stated = problem.options_as(IntervalOptions).objective
    needed = {"L"} if problem.plant.output.measured == "periodic" else {"L", "M"}
    is_open = bool(needed - {*problem.gains, *idle_gains(problem.plant)})
    return stated or ("narrowest" if is_open else "feasible")


def reason_against_plant(plant: Plant) -> str | None:
    """Reason against a plant with unbounded inputs, one sentence, or None."""
    return reason_against_unbounded(plant, "interval")


def _reason_against_width(problem: Problem) -> str | None:
    """Reason against options of the width, or None."""
    options = problem.options_as(IntervalOptions)
    for name in ("width", "width_weights"):
        if options.is_stated(name) and objective_of(problem) != "narrowest":
            return (
                f"observer.{name} needs observer.objective = 'narrowest'; got "
                f"{objective_of(problem)!r}."
            )
    if options.width == "pre_jump":
        if reason := problem.reason_without("jump", needed_by="observer.width = 'pre_jump'"):
            return reason
        if problem.plant.output.measured == "periodic":
            return (
                "observer.width = 'pre_jump' is not available with measured = 'periodic'; "
                "it must be mean."
            )
    return None


@dataclass(frozen=True)
class LargeGain:
    """An entry of L or M beyond `gain_limit`; row and column from 1."""

    name: str
    row: int
    column: int
    value: float
    limit: float

    def entry(self, owner: str) -> str:
        """Name of the gain; owner: prefix of the gains."""
        return f"{owner}.{self.name}, row {self.row}"

    def reason(self, owner: str) -> str:
        """Reason against the gain, one sentence."""
        return (
            f"{owner}.{self.name}, row {self.row}, column {self.column} must not exceed "
            f"observer.gain_limit = {self.limit:g}; got {self.value!r}."
        )


def large_gain(L: Array | None, M: Array | None, limit: float | None) -> LargeGain | None:
    """The first entry of L or M, as far as they are given, beyond the limit; exact."""
    for name, gain in (("L", L), ("M", M)):
        if limit is None or gain is None:
            continue
        for (i, k), value in np.ndenumerate(gain):
            if abs(value) > limit:
                return LargeGain(name, i + 1, k + 1, float(value), limit)
    return None


def _reason_against_form(problem: Problem, gains: Mapping[str, Array], form: str) -> str | None:
    """Reason against a form for the given gains, or None."""
    if form in ("cooperative", "split"):
        for name in ("S", "S2", "T", "R"):
            if name in gains:
                return (
                    f"observer.gains.{name} belongs to the forms coordinates and two_coordinates; "
                    f"got it with form {form!r}."
                )
    splits = [name for name in _SPLITS if name in gains]
    if splits and form in ("cooperative", "two_coordinates"):
        return (
            f"observer.gains.{splits[0]} belongs to the forms split and coordinates; "
            f"got it with form {form!r}."
        )
    if splits and {"S2", "R"} & set(gains):
        return f"observer.gains.{splits[0]} is a split; with S2 and T there is none."
    if form == "coordinates" and "S2" in gains:
        return "observer.gains.S2 belongs to form 'two_coordinates'; got it with 'coordinates'."
    if reason := _reason_against_coordinates(problem.plant, gains, form):
        return reason
    if form == "two_coordinates" or "R" in gains:
        return problem.reason_without("jump", needed_by="form 'two_coordinates'")
    return None


def _reason_against_coordinates(plant: Plant, gains: Mapping[str, Array], form: str) -> str | None:
    """Reason against coordinates S, S2 or matrices R, T of Assumption 4, or None."""
    if "R" in gains:
        for name in ("S", "S2"):
            if name in gains:
                return f"observer.gains.{name} is built from R and T; drop {name}, or R."
        if "T" not in gains:
            return "observer.gains.T is required with R (Assumption 4); it is missing."
        if form == "coordinates":
            return "observer.gains.R belongs to form 'two_coordinates'; got it with 'coordinates'."
        if plant.output.measured == "periodic":
            return "observer.gains.R is for a continuous y; got it with measured = 'periodic'."
    elif form == "two_coordinates" or {"S2", "T"} & set(gains):
        for name in ("S", "S2"):
            if name not in gains:
                return (
                    f"observer.gains.{name} is required by form 'two_coordinates'; it is missing. "
                    "Give S and S2, or R and T, from which they are built."
                )
    return None


def open_forms(problem: Problem) -> tuple[str, ...]:
    """Return the forms that a problem leaves open, in order of preference."""
    form, gains = problem.options_as(IntervalOptions).form, problem.gains
    if form != "auto":
        return (form,)
    if {"S2", "R"} & set(gains):
        return ("two_coordinates",)
    if "S" in gains:
        return ("coordinates",)
    if any(name in gains for name in _SPLITS):
        return ("split",)
    return ("cooperative", "split", "coordinates")
