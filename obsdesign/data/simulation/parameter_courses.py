"""Courses of parameters in a simulation: constant between rows, inside their ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries, Value
from obsdesign.data.simulation.signals import Signals
from obsdesign.errors import InputError
from obsdesign.problem.parameters import Parameter
from obsdesign.problem.plant import Plant

COURSES = ("nominal", "random", "extreme", "bang-bang")
# rows from one switch of a bang-bang course to the next, on average
_ROWS_HELD = 12


class SignalsAtRows:
    """The signals on the way to each row, of the plant with the parameters there.

    values: (rows, q), those of each parameter, in the order of the plant.
    """

    def __init__(self, uncertain: Plant, source: Signals, values: Matrix) -> None:
        self._plant, self._source, self._last, self.values = uncertain, source, -1, values
        self._own = source

    def at(self, row: int) -> Signals:
        """Signals of a row; the same object as of the row before where no parameter changes."""
        if self._last < 0 or not np.array_equal(self.values[row], self.values[self._last]):
            self._own = self._source.of_plant(certain_plant(self._plant, self.values[row]))
        self._last = row
        return self._own


def drawn_courses(
    plant: Plant, course: str | Mapping[str, float], rows: int, rng: np.random.Generator
) -> Matrix:
    """Courses (rows, q) of all parameters of a plant; constant ones keep one value.

    course: nominal (middle of the range), random (drawn at every row), extreme (an end, held),
    bang-bang (from end to end), or values by name, the others nominal. InputError for others.
    """
    parameters = plant.parameters
    if not isinstance(course, str):
        return np.tile(_fixed(parameters, course), (rows, 1))
    if course not in COURSES:
        raise InputError(
            f"parameters must be one of {', '.join(COURSES)} or values by name; got {course!r}."
        )
    drawn = [_course(each, course, rows, rng) for each in parameters]
    return np.array(drawn).reshape(len(parameters), rows).T


def nominal_plant(plant: Plant) -> Plant:
    """The plant itself without parameters, else with each in the middle of its range."""
    return certain_plant(plant, _fixed(plant.parameters, {})) if plant.parameters else plant


def certain_plant(plant: Plant, values: Sequence[float] | Matrix) -> Plant:
    """The plant with these values of its parameters, (q,), rounded once."""
    added: dict[str, Matrix] = {}
    for parameter, value in zip(plant.parameters, values, strict=True):
        for key, unit in parameter.effects.items():
            added[key] = added.get(key, 0.0) + value * unit
    flow, jump, output = plant.flow, plant.jump, plant.output
    flow = replace(flow, A_radius=None, **_sums(flow, ("A", "B"), added))
    if jump is not None:
        jump = replace(jump, G_radius=None, **_sums(jump, ("G", "E"), added))
    return Plant(flow, jump, replace(output, C_radius=None, **_sums(output, ("C",), added)))


def _sums(block: Value, keys: tuple[str, ...], added: Mapping[str, Matrix]) -> NewEntries:
    """Matrices of a block with what parameters add to them, of those to which they do."""
    return {key: getattr(block, key) + added[key] for key in keys if key in added}


def _course(parameter: Parameter, course: str, rows: int, rng: np.random.Generator) -> Matrix:
    """Values of one parameter, (rows,)."""
    low, high = parameter.range
    if course == "nominal":
        return np.full(rows, _middle(parameter))
    if course == "random":
        drawn = rng.uniform(0.0, 1.0, rows)
        if parameter.constant:
            drawn[:] = drawn[:1]
        return np.clip(low + (high - low) * drawn, low, high)
    switches = rng.random(rows) < 1 / _ROWS_HELD
    if course == "extreme" or parameter.constant:
        switches[:] = False
    is_high = (rng.random() < 0.5) ^ (np.cumsum(switches) % 2 == 1)
    return np.where(is_high, high, low)


def _middle(parameter: Parameter) -> float:
    low, high = parameter.range
    return low + (high - low) / 2


def _fixed(parameters: Sequence[Parameter], stated: Mapping[str, float]) -> list[float]:
    """Stated values, the middle of the range of all others."""
    names = [parameter.name for parameter in parameters]
    for name in stated:
        if name not in names:
            raise InputError(
                f"parameters: {name!r} is no parameter of the plant; it has "
                f"{', '.join(names) or 'none'}."
            )
    values = []
    for parameter in parameters:
        low, high = parameter.range
        value = float(stated.get(parameter.name, _middle(parameter)))
        if not low <= value <= high:
            raise InputError(
                f"parameters: {parameter.name} must be from {low:g} to {high:g}; got {value:g}."
            )
        values.append(value)
    return values
