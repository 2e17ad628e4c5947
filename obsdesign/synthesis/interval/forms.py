"""From gains L, M (and coordinates) to everything an interval observer of a form stores.

The splits default to the minimal ones, which no other split can beat. They are formed exactly and
then rounded once, so that they are within an ulp of the matrices that they split.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.balls import exact, inverse, to_float
from obsdesign.equations.interval import splits as equations
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import Coordinates
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem

# a matrix as the difference of two with required signs
Split = Callable[[Array], tuple[Array, Array]]


def gains_of_form(
    problem: Problem, form: str, L: Array, M: Array, coordinates: Mapping[str, Array]
) -> IntervalGains:
    """Return the gains of a design in a form.

    coordinates: S, S2, T, as far as the form has them and they are given. InputError if S or S2 is
    singular.
    """
    plant = problem.plant
    is_periodic = plant.output.measured == "periodic"
    frame = _exact_coordinates(coordinates)
    F, H = equations.flow_and_jump(
        exact(plant.flow.A), exact(plant.output.C),
        None if plant.jump is None else exact(plant.jump.G),
        L=exact(L), M=exact(M), jump_measurement=plant.output.jump_measurement,
        is_periodic=is_periodic,
    )  # fmt: skip
    return IntervalGains.from_plant(
        plant,
        form=form,
        period=plant.output.period if is_periodic else None,
        L=L,
        M=M,
        **_splits(problem, form, F, H, frame) | dict(coordinates),
    )


def _splits(
    problem: Problem, form: str, F: Array, H: Array | None, frame: Coordinates
) -> dict[str, Array]:
    """Return D0, D1 and, with jumps, Gp, Gn, or T of Theorem 7.

    F, H: exact, in the plant's coordinates; H is None without jumps.
    """
    F_z = frame.similar(F)
    if form == "two_coordinates":
        R = problem.gains.get("R")
        return _theorem_7(F_z, H, frame) | ({} if R is None else {"D0": R, "D1": 0 * R})
    if form == "cooperative":
        flow = {"D0": to_float(F_z), "D1": np.zeros(F.shape)}
        return flow if H is None else flow | {"Gp": to_float(H), "Gn": np.zeros(H.shape)}
    given = problem.gains
    flow = _given_split(given, ("D0", "D1"), F_z, equations.metzler_split)
    if H is None:
        return flow
    H_z = frame.similar(H)
    return flow | _given_split(given, ("Gp", "Gn"), H_z, equations.nonnegative_split)


def _exact_coordinates(coordinates: Mapping[str, Array]) -> Coordinates:
    """S and S2 in exact numbers; InputError if one is singular."""
    frame = Coordinates.from_matrices(coordinates.get("S"), coordinates.get("S2"), inverse, exact)
    if name := frame.singular_matrix():
        raise InputError(f"observer.gains.{name} must be invertible; it is singular.")
    return frame


def _given_split(
    given: Mapping[str, Array], names: tuple[str, str], X: Array, minimal: Split
) -> dict[str, Array]:
    """The user's split; one half given determines the other; none given: the minimal one."""
    plus, minus = names
    if plus in given and minus in given:
        return {plus: given[plus], minus: given[minus]}
    if plus in given:
        return {plus: given[plus], minus: to_float(exact(given[plus]) - X)}
    if minus in given:
        return {plus: to_float(X + exact(given[minus])), minus: given[minus]}
    return {name: to_float(half) for name, half in zip(names, minimal(X), strict=True)}


def _theorem_7(R: Array, H: Array | None, frame: Coordinates) -> dict[str, Array]:
    """R and T of Theorem 7; entries of R that only rounding made negative are carried as D1."""
    rounded = to_float(R)
    noise = _rounding_noise(rounded) & ~np.eye(len(rounded), dtype=bool)
    assert H is not None
    T = to_float(frame.S2_inverse @ H @ frame.S2)
    return {
        "D0": np.where(noise, 0.0, rounded),
        "D1": np.where(noise, -rounded, 0.0),
        "T": np.where(_rounding_noise(T), 0.0, T),
    }


def _rounding_noise(X: Array) -> NDArray[np.bool_]:
    """Entries that would be zero in decimals, and are negative by rounding."""
    return np.asarray((X < 0) & (-(2.0**-46) * np.abs(X).max(initial=0.0) < X))
