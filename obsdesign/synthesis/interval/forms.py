"""From gains L, M (and coordinates) to everything an interval observer of a form stores.

The splits default to the minimal ones, which no other split can beat. They are formed exactly and
then rounded once, so that verification finds them within an ulp of what they split.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, inverse, to_float
from obsdesign.equations.estimation_error import plant_data
from obsdesign.equations.interval import splits as equations
from obsdesign.equations.interval.width import Coordinates
from obsdesign.errors import InputError
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem

_EXACT = ("A", "C", "G", "L", "M")


def observer_data(plant: Plant) -> dict[str, Any]:
    """What `gains` repeats of the plant; with samples as events, their period too."""
    data = plant_data(plant)
    if plant.output.measured == "periodic":
        data |= {"period": plant.output.period}
    return data


def formed(
    problem: Problem, form: str, L: Any, M: Any, coordinates: Mapping[str, Any]
) -> dict[str, Any]:
    """`gains` of a design in a form; `coordinates` holds S, S2, T as far as the form has them.

    InputError for a matrix of coordinates that is singular.
    """
    plant, given = problem.plant, problem.gains
    gains = {"form": form} | observer_data(plant) | {"L": L, "M": M} | dict(coordinates)
    numbers = {name: exact(gains[name]) for name in _EXACT if name in gains}
    frame = exact_coordinates(gains)
    F, H = equations.flow_and_jump(
        numbers, plant.output.jump_measurement, plant.output.measured == "periodic"
    )
    F_z = equations.in_coordinates(F, frame.S, frame.S_inverse)
    if form == "two_coordinates":
        gains |= _two(gains, F_z, H, frame)
    elif form == "cooperative":
        gains |= {"D0": to_float(F_z), "D1": np.zeros(F.shape)}
        if H is not None:
            gains |= {"Gp": to_float(H), "Gn": np.zeros(H.shape)}
    else:
        gains |= _own_split(given, "D0", "D1", F_z, equations.metzler_split)
        if H is not None:
            H_z = equations.in_coordinates(H, frame.S, frame.S_inverse)
            gains |= _own_split(given, "Gp", "Gn", H_z, equations.nonnegative_split)
    return gains


def exact_coordinates(gains: Mapping[str, Any]) -> Coordinates:
    """The coordinates of `gains` in exact numbers; InputError if one is singular."""
    frame = Coordinates.of(
        {name: exact(gains[name]) for name in ("S", "S2") if name in gains}, inverse
    )
    if name := frame.singular():
        raise InputError(f"observer.gains.{name} must be invertible; it is singular.")
    return frame


def _own_split(given: Any, plus: str, minus: str, X: Any, minimal: Any) -> dict[str, Any]:
    """The user's split; one half given determines the other; none given: the minimal one."""
    if plus in given and minus in given:
        return {plus: given[plus], minus: given[minus]}
    if plus in given:
        return {plus: given[plus], minus: to_float(exact(given[plus]) - X)}
    if minus in given:
        return {plus: to_float(X + exact(given[minus])), minus: given[minus]}
    return {name: to_float(half) for name, half in zip((plus, minus), minimal(X), strict=True)}


def _two(gains: Mapping[str, Any], R: Any, H: Any, frame: Coordinates) -> dict[str, Any]:
    """R and T of Theorem 7; what only rounding made negative of R is carried as D1."""
    rounded = to_float(R)
    noise = _noise(rounded) & ~np.eye(len(rounded), dtype=bool)
    found = {"D0": np.where(noise, 0.0, rounded), "D1": np.where(noise, -rounded, 0.0)}
    if "T" not in gains:
        T = to_float(frame.S2_inverse @ H @ frame.S2)
        found["T"] = np.where(_noise(T), 0.0, T)
    return found


def _noise(X: Any) -> Any:
    """Entries that would be zero in decimals, and are negative by rounding."""
    return (X < 0) & (-(2.0**-46) * np.abs(X).max(initial=0.0) < X)
