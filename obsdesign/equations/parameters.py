"""Plants with parameters in normal form: nominal matrices and effects, exact rationals.

    A(p) = A + sum_i p_i A_i,  |p_i(t)| <= 1,  likewise B, G, E, C

where a problem file states p_i in a range: A is then flow.A + sum_i mid_i A_i and A_i becomes
half_i A_i, mid_i and half_i middle and half-width of the range.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from obsdesign.equations.plant import Plant
from obsdesign.equations.stored import Stored, matrix, text

# matrices to which parameters add
MATRICES = ("A", "B", "G", "E", "C")


def fractions_of(values: Matrix) -> Array:
    """The rational numbers that binary64 numbers are, an array of Fraction of the same shape."""
    numbers = [Fraction(value) for value in np.asarray(values, np.float64).ravel().tolist()]
    return np.array(numbers, dtype=object).reshape(np.shape(values))


@dataclass(frozen=True)
class Effect:
    """What p_i adds as it goes from 0 to 1, by the name of the matrix; None where nothing."""

    name: str
    constant: bool
    A: Array | None = None
    B: Array | None = None
    G: Array | None = None
    E: Array | None = None
    C: Array | None = None


@dataclass(frozen=True)
class NormalForm:
    """A (n, n), B (n, m), G (n, n), E (n, l), C (p, n) and effects; B, G, E None where absent."""

    A: Array
    C: Array
    B: Array | None
    G: Array | None
    E: Array | None
    effects: tuple[Effect, ...]

    @staticmethod
    def from_plant(plant: Plant, lift: Callable[[Matrix], Array] = fractions_of) -> NormalForm:
        """The normal form of a plant with one clock; lift: floats to the exact numbers wanted."""
        nominal = {
            key: None if values is None else lift(values)
            for key, values in nominal_matrices(plant).items()
        }
        effects = []
        for parameter in plant.parameters:
            low, high = lift(np.array(parameter.range))
            added: dict[str, Array] = {}
            for key, unit in parameter.effects.items():
                nominal[key] = nominal[key] + (low + high) / 2 * lift(unit)
                added[key] = (high - low) / 2 * lift(unit)
            effects.append(Effect(parameter.name, parameter.constant, **added))
        A, C = nominal.pop("A"), nominal.pop("C")
        assert A is not None
        assert C is not None
        return NormalForm(A, C, **nominal, effects=tuple(effects))

    def roundings(self) -> tuple[Effect, ...]:
        """What nearest binary64 numbers of the nominal matrices and of the effects leave out."""
        nominal = Effect("nominal", False, self.A, self.B, self.G, self.E, self.C)
        listed = []
        for effect in (nominal, *self.effects):
            lost: dict[str, Array] = {
                key: error for key in MATRICES for error in _rounding(getattr(effect, key))
            }
            if lost:
                listed.append(Effect(f"rounding_of_{effect.name}", False, **lost))
        return tuple(listed)

    def on(self, key: str) -> tuple[Array, ...]:
        """The effects on one of the matrices, of those parameters that have any."""
        listed = [getattr(effect, key) for effect in self.effects]
        return tuple(values for values in listed if values is not None)


def nominal_matrices(plant: Plant) -> Mapping[str, Matrix | None]:
    """The stated matrices to which parameters add, by their names; None for those absent."""
    flow, jump = plant.flow, plant.jump
    G, E = (None, None) if jump is None else (jump.G, jump.E)
    return {"A": flow.A, "B": flow.B, "G": G, "E": E, "C": plant.outputs.C}


def rounded(values: Array) -> Matrix:
    """The nearest binary64 numbers of exact rationals."""
    return np.array([float(value) for value in values.ravel()]).reshape(values.shape)


def rounded_up(value: Fraction) -> float:
    """The least binary64 number that is not below an exact rational."""
    nearest = float(value)
    return nearest if Fraction(nearest) >= value else math.nextafter(nearest, math.inf)


@dataclass(frozen=True)
class KnownSizes:
    """What bounds the effects of parameters: lower, upper of x (n,); largest |u| (m,), |w| (l,).

    before_jump: (lower, upper) of x just before jumps. u, w: None where none is stated.
    """

    lower: Array
    upper: Array
    before_jump: tuple[Array, Array]
    u: Array | None
    w: Array | None


def largest_in_box(X: Array, lower: Array, upper: Array) -> Array:
    """The largest |X z|, row by row, for lower <= z <= upper; exact where its arguments are."""
    result: Array = abs(X @ ((lower + upper) / 2)) + abs(X) @ ((upper - lower) / 2)
    return result


def effect_sizes(form: NormalForm, known: KnownSizes) -> tuple[Array, Array, Array]:
    """Bounds of what parameters add to x', x+ and y, exact: (n,), (n,), (p,).

    Of each parameter the largest |A_i x + B_i u|; likewise what A loses as it is rounded to
    binary64 numbers. x+ : zeros without jumps. Inputs must be known where they are uncertain.
    """
    box = (known.lower, known.upper)
    return (
        _largest_sum(form, ("A", "B"), box, known.u),
        _largest_sum(form, ("G", "E"), known.before_jump, known.w),
        _largest_sum(form, ("C", ""), box, None),
    )


def _largest_sum(
    form: NormalForm, keys: tuple[str, str], box: tuple[Array, Array], inputs: Array | None
) -> Array:
    """Largest sum over parameters of |X x + Y u|, for the effects X, Y on two matrices."""
    state, known = keys
    total = fractions_of(np.zeros(len(form.C if state == "C" else form.A)))
    for X in (*form.on(state), *_rounding(getattr(form, state))):
        total = total + largest_in_box(X, *box)
    listed = (*form.on(known), *_rounding(getattr(form, known))) if known else ()
    for Y in listed:
        assert inputs is not None
        total = total + abs(Y) @ inputs
    return total


def _rounding(values: Array | None) -> tuple[Array, ...]:
    """What exact values exceed their nearest binary64 numbers by; none where nothing."""
    if values is None:
        return ()
    error = values - fractions_of(rounded(values))
    return (error,) if error.any() else ()


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectGains(Stored):
    """An effect as a design stores it: nearest binary64 numbers, None where nothing is added."""

    name: str = text()
    A: Matrix | None = matrix("n", "n", optional=True)
    B: Matrix | None = matrix("n", "m", optional=True)
    G: Matrix | None = matrix("n", "n", optional=True)
    E: Matrix | None = matrix("n", "l", optional=True)
    C: Matrix | None = matrix("p", "n", optional=True)

    @classmethod
    def from_effect(cls, effect: Effect) -> EffectGains:
        """The stored form of an effect."""
        stated = {key: getattr(effect, key) for key in MATRICES}
        return cls(
            name=effect.name,
            **{key: rounded(values) for key, values in stated.items() if values is not None},
        )
