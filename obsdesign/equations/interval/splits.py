"""Interval observers for linear impulsive systems: the formulas.

    x'(t) = A x + B u + b(t)          between jumps,   lower <= b <= upper
    x(t)  = G x(t-) + E w + c         at jumps,        lower <= c <= upper
    y     = C x + v,                  |v_i(t)| <= V_i at every instant

Source: K. H. Degue, D. Efimov, J.-P. Richard, Interval Observers for Linear Impulsive Systems,
NOLCOS 2016: observers (6) (Theorem 5) and (11) (Theorem 8). Deviations from the print, with
reasons in docs/papers.md: the measurement used at a jump is the pre-jump one (the print says
post-jump, which breaks the enclosure); J of (10) has second row [n, p]; stability is tested on
the n-dimensional pair (D0 + D1, p + n), which is equivalent to (10) and cheaper.

Notation
    flow_error_matrix   F = A - L C                  n x n
    jump_error_matrix   H = G - M C  (pre-jump y), (I - M C) G  (post-jump y), G (no y)   n x n
    D0, D1              F = D0 - D1, D0 Metzler, D1 >= 0
    Gp, Gn              H = Gp - Gn, Gp >= 0, Gn >= 0
    S, S2, T            coordinates x = S z (x = S2 z2 at jumps, where T = S2^-1 H S2)
The width w = upper - lower: `obsdesign.equations.interval.width`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.estimation_error import (
    flow_error_matrix,
    jump_error_matrix,
)

Array = NDArray[Any]  # float64, or object arrays of exact rationals

FORMS = ("cooperative", "split", "coordinates", "two_coordinates")
_SPLITS = ("D0", "D1", "Gp", "Gn")


def objection(plant: Any, gains: Any, options: Any) -> str | None:
    """What forbids an interval observer for a plant, or None; one sentence.

    `gains` and `options` are those of the problem file. Anything that moves the state without
    bounds, and any request that would not be honoured.
    """
    if text := plant_objection(plant):
        return text
    if text := limit_objection(gains, options, "observer.gains"):
        return text
    if text := _width_objection(plant, options):
        return text
    return _form_objection(plant, gains, options.get("form", "auto"))


def plant_objection(plant: Any) -> str | None:
    """What moves the state without bounds, or None; one sentence."""
    if plant.flow.D is not None:
        return (
            "flow.D is refused by kind 'interval': an unknown input without bounds leaves no "
            "bounds on the state. Give bounds as flow.disturbance."
        )
    if plant.jump is not None and plant.jump.H is not None:
        return (
            "jump.H is refused by kind 'interval': impulses of unknown weight leave no bounds "
            "on the state. Give bounds as jump.disturbance."
        )
    return None


def _width_objection(plant: Any, options: Any) -> str | None:
    """A width that is asked to be narrow where nothing is made narrow, or None."""
    for name in ("width", "width_weights"):
        if name in options and options.get("objective") != "narrowest":
            return f"observer.{name} needs observer.objective = 'narrowest'; it is not asked for."
    if options.get("width") == "pre_jump":
        if plant.jump is None:
            return "[jump] is required by observer.width = 'pre_jump'; it is missing."
        if plant.output.measured == "periodic":
            return (
                "observer.width = 'pre_jump' is not available with measured = 'periodic'; "
                "it must be mean."
            )
    return None


def limit_objection(gains: Any, options: Any, where: str) -> str | None:
    """An entry of L or M beyond `gain_limit`, or None; exact. where: how the gains are called."""
    limit = options.get("gain_limit")
    for name in ("L", "M"):
        if limit is None or name not in gains:
            continue
        for (i, k), value in np.ndenumerate(gains[name]):
            if abs(value) > limit:
                return (
                    f"{where}.{name}, row {i + 1}, column {k + 1} must not exceed "
                    f"observer.gain_limit = {limit:g}; got {float(value)!r}."
                )
    return None


def _form_objection(plant: Any, gains: Any, form: str) -> str | None:
    """Gains and form that do not go together, or None."""
    if form not in (*FORMS, "auto"):
        return f"observer.form must be one of {', '.join(FORMS)} or auto; got {form!r}."
    if form in ("cooperative", "split"):
        for name in ("S", "S2", "T"):
            if name in gains:
                return (
                    f"observer.gains.{name} belongs to the forms coordinates and two_coordinates; "
                    f"got it with form {form!r}."
                )
    own = [name for name in _SPLITS if name in gains]
    if own and form in ("cooperative", "two_coordinates"):
        return (
            f"observer.gains.{own[0]} belongs to the forms split and coordinates; "
            f"got it with form {form!r}."
        )
    if own and "S2" in gains:
        return f"observer.gains.{own[0]} is a split; with S2 and T there is none."
    if form == "coordinates" and "S2" in gains:
        return "observer.gains.S2 belongs to form 'two_coordinates'; got it with 'coordinates'."
    needed = ("S", "S2") if form == "two_coordinates" or {"S2", "T"} & set(gains) else ()
    for name in needed:
        if name not in gains:
            return f"observer.gains.{name} is required by form 'two_coordinates'; it is missing."
    if form == "two_coordinates" and plant.jump is None:
        return "[jump] is required by form 'two_coordinates'; it is missing."
    return None


def forms_asked(gains: Any, options: Any) -> tuple[str, ...]:
    """The forms that a problem leaves open, in order of preference."""
    form = options.get("form", "auto")
    if form != "auto":
        return (form,)
    if "S2" in gains:
        return ("two_coordinates",)
    if "S" in gains:
        return ("coordinates",)
    if any(name in gains for name in _SPLITS):
        return ("split",)
    return ("cooperative", "split", "coordinates")


def in_coordinates(X: Array, S: Array | None, S_inverse: Array | None) -> Array:
    """S^-1 X S: a map of x in the coordinates z of x = S z; X itself where there are none."""
    return X if S is None else S_inverse @ X @ S


def flow_and_jump(
    numbers: Mapping[str, Array], jump_measurement: str, periodic: bool
) -> tuple[Array, Array | None]:
    """(F, H) that the splits are of, in x: the error between events and at jumps.

    With samples as events (`periodic`) neither L nor M acts there: (A, G). H is None without jumps.
    """
    A, C = numbers["A"], numbers["C"]
    if periodic:
        return A, numbers.get("G")
    F = flow_error_matrix(A, numbers["L"], C)
    if "G" not in numbers:
        return F, None
    return F, jump_error_matrix(numbers["G"], numbers["M"], C, jump_measurement)


def positive_part(X: Array) -> Array:
    """X+ = max(X, 0) of section 2.2."""
    part: Array = np.maximum(X, 0 * X)
    return part


def metzler_split(F: Array) -> tuple[Array, Array]:
    """Minimal D0 (Metzler), D1 >= 0 with F = D0 - D1: no other split has a smaller D0 + D1."""
    diagonal = np.diag(np.diag(F))
    return diagonal + positive_part(F - diagonal), positive_part(diagonal - F)


def nonnegative_split(H: Array) -> tuple[Array, Array]:
    """Minimal Gp, Gn >= 0 with H = Gp - Gn: H+ and H-."""
    return positive_part(H), positive_part(-H)


def absolute_metzler(X: Array) -> Array:
    """Diagonal of X kept, the other entries replaced by their absolute values."""
    plus, minus = metzler_split(X)
    return plus + minus


def completed_split(X: Array, plus: Array, minus: Array) -> tuple[Array, Array]:
    """The split of X itself that is nearest to a stored (rounded) one.

    plus - minus may differ from X by rounding; the remainder E = plus - minus - X goes where it
    keeps signs: plus + E-, minus + E+. In exact arithmetic the result is an exact split.
    """
    remainder = plus - minus - X
    return plus + positive_part(-remainder), minus + positive_part(remainder)
