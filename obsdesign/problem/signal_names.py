"""Names and units of signals, for people and files: no claim depends on them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from obsdesign.column_names import numbered
from obsdesign.entries import shown
from obsdesign.errors import InputError
from obsdesign.problem.blocks import set_fields
from obsdesign.problem.plant import Plant
from obsdesign.problem.schema import Fragment, file_entry, list_of

# titles of columns that mean something else
_RESERVED = re.compile(r"(t|jump|event|mode|status|received|[a-z]\d+(_.*)?_(lo|hi|std)|[xyuwd]\d+)")
_LONGEST = 40
# what __post_init__ fills in
_DEFAULT: Value = None
_LETTERS = {"states": "x", "outputs": "y", "inputs": "u"}
_OF_EACH = {"states": "state", "outputs": "row of output.C", "inputs": "column of flow.B"}
_KEYS = "states, outputs, inputs, units and time_unit"
_NAMES: Fragment = list_of({"type": "string", "title": "a name"}, "a list of names")
_UNITS: Fragment = {
    "type": "object",
    "title": "a table of units by name",
    "additionalProperties": {"type": "string", "title": "a unit"},
}


@dataclass(frozen=True)
class SignalNames:
    """What states, outputs and inputs are called, and their units.

    states (n), outputs (p), inputs (m, those of u): one name each, () where they have none and are
    x1, y1, u1, ...; units: by these names; time_unit: "" where it is not stated. Outputs and inputs
    may be titles of columns in data files, so that all names differ. InputError for a name that is
    empty, too long, kept for other columns or there twice.
    """

    states: tuple[str, ...] = file_entry(_NAMES, "One name per state.", default=())
    outputs: tuple[str, ...] = file_entry(
        _NAMES, "One name per row of output.C; a title of its column too.", default=()
    )
    inputs: tuple[str, ...] = file_entry(
        _NAMES, "One name per column of flow.B; a title of its column too.", default=()
    )
    units: Mapping[str, str] = file_entry(
        _UNITS, 'By name: { position = "m" }, or by x1, y1, u1.', default=_DEFAULT
    )
    time_unit: str = file_entry(
        {"type": "string", "title": "a unit"}, "Unit of all times.", default=""
    )

    def __post_init__(self) -> None:
        set_fields(self, **{key: _names(getattr(self, key), f"names.{key}") for key in _LETTERS})
        every = [name for key in _LETTERS for name in getattr(self, key)]
        for name in every:
            if every.count(name) > 1:
                raise InputError(
                    f"names: {name!r} stands {every.count(name)} times; states, outputs and inputs "
                    "need different names, since they may be titles of columns of one file."
                )
        if not isinstance(self.units, Mapping | None):
            raise InputError(f"names.units must be a table of units; got {shown(self.units)}.")
        set_fields(self, units=dict(self.units or {}))
        for name, unit in self.units.items():
            _check_text(unit, f"names.units.{name}")
        _check_text(self.time_unit, "names.time_unit")

    def check(self, plant: Plant) -> None:
        """InputError unless there is a name for each signal of a plant, and each unit is of one."""
        m = 0 if plant.flow.B is None else plant.flow.B.shape[1]
        if self.outputs and plant.has_tables:
            raise InputError("names.outputs: outputs of [[sensor]] are called as their sensor.")
        for key, size in {"states": plant.n, "outputs": plant.p, "inputs": m}.items():
            names = getattr(self, key)
            if names and len(names) != size:
                raise InputError(
                    f"names.{key} must be {size} names, one per {_OF_EACH[key]}; got {len(names)}."
                )
        outputs = [column for sensor in plant.sensors for column in sensor.columns]
        known = [*self.columns, *numbered("x", plant.n), *outputs, *numbered("u", m)]
        for name in self.units:
            if name not in known:
                raise InputError(
                    f"names.units.{name}: no signal is called so; signals are {', '.join(known)}."
                )

    def states_of(self, n: int) -> tuple[str, ...]:
        """What n states are called: x1, x2, ... without names."""
        return self.states or numbered("x", n)

    def unit(self, column: str) -> str | None:
        """Unit of a signal by its column, x1, y1, u1, ...; None where none is stated."""
        return self.units.get(column, self.units.get(self.name_of(column)))

    def name_of(self, column: str) -> str:
        """What the signal of a column x1, y1, u1, ... is called; without names the column."""
        return {of: name for name, of in self.columns.items()}.get(column, column)

    def label(self, column: str) -> str:
        """Name and unit of the signal of a column, "position [m]"."""
        unit = self.unit(column)
        return self.name_of(column) + (f" [{unit}]" if unit else "")

    @cached_property
    def columns(self) -> Mapping[str, str]:
        """Column by name: {"position": "x1", ...}; empty without names."""
        pairs: dict[str, str] = {}
        for key, letter in _LETTERS.items():
            names = getattr(self, key)
            pairs |= zip(names, numbered(letter, len(names)), strict=True)
        return pairs

    def to_entry(self) -> NewEntries:
        """The block as it stands in a file; what is not stated is left out."""
        stated = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {key: value for key, value in stated.items() if value}


def names_of(problem: Entries) -> SignalNames:
    """The names in a problem as a design stores it; InputError where they are none."""
    block = problem.get("names", {})
    if not isinstance(block, Mapping) or not set(block) <= {x.name for x in fields(SignalNames)}:
        raise InputError(f"names must be a table of {_KEYS}; got {shown(block)}.")
    return SignalNames(**block)


def _names(values: Value, entry: str) -> tuple[str, ...]:
    if isinstance(values, str) or not isinstance(values, Sequence):
        raise InputError(f"{entry} must be a list of names; got {shown(values)}.")
    for name in values:
        _check_text(name, entry)
        if not name or _RESERVED.fullmatch(name):
            why = "a name may not be empty" if not name else f"{name!r} is kept for another column"
            raise InputError(f"{entry}: {why}.")
    return tuple(values)


def _check_text(text: Value, entry: str) -> None:
    if not isinstance(text, str):
        raise InputError(f"{entry} must be text; got {shown(text)}.")
    if (
        len(text) > _LONGEST
        or text != text.strip()
        or not text.isprintable()
        or set(text) & set(',"')
    ):
        raise InputError(
            f"{entry} must be at most {_LONGEST} printable characters without commas, quotes and "
            f"blanks at its ends; got {text!r}."
        )
