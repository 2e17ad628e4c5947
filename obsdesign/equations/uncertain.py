"""Plants with parameters in normal form: nominal matrices and effects, exact rationals.

    A(p) = A + sum_i p_i A_i,  |p_i(t)| <= 1,  likewise B, G, E, C

where a problem file states p_i in a range: A is then flow.A + sum_i mid_i A_i and A_i becomes
half_i A_i, mid_i and half_i middle and half-width of the range.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from obsdesign.equations.plant import Plant

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

    def on(self, key: str) -> tuple[Array, ...]:
        """The effects on one of the matrices, of those parameters that have any."""
        listed = [getattr(effect, key) for effect in self.effects]
        return tuple(values for values in listed if values is not None)


def nominal_matrices(plant: Plant) -> Mapping[str, Matrix | None]:
    """The stated matrices to which parameters add, by their names; None for those absent."""
    flow, jump = plant.flow, plant.jump
    G, E = (None, None) if jump is None else (jump.G, jump.E)
    return {"A": flow.A, "B": flow.B, "G": G, "E": E, "C": plant.outputs.C}
