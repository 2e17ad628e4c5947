"""Base class of the options of all kinds, and which of them a problem states."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, ClassVar, Self

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from obsdesign.errors import InputError
from obsdesign.problem.schema import Fragment, file_entry

if TYPE_CHECKING:
    from obsdesign.problem.plant import Plant

# texts of options that several kinds have
POLES = "Poles of the error's flow, one per state of it; one of a conjugate pair stands for both."
WEIGHTS = (
    "Diagonal weights of the Riccati equation for L, in the plant's coordinates, ones where one "
    "is absent; without weights ones in units that balance the plant."
)


def option(
    fragment: Fragment, description: str, *, default: Value = None, whole: bool = False
) -> Value:
    """Declare an option; default: where the file has none; whole: it counts something."""
    return file_entry(fragment, description, default=default, whole=whole)


@dataclass(frozen=True, eq=False)
class Options:
    """Options of an observer, and which of them the problem states, in its order."""

    # no option itself: every instance gets its own
    _stated: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        stated = tuple(one.name for one in fields(self) if getattr(self, one.name) != one.default)
        object.__setattr__(self, "_stated", stated)

    @classmethod
    def from_entries(cls, entries: Entries) -> Self:
        """Options from the entries of a problem file, converted and named as the schema has it."""
        options = cls(**entries)
        object.__setattr__(options, "_stated", tuple(entries))
        return options

    def is_stated(self, name: str) -> bool:
        """Does the problem itself state this option?"""
        return name in self._stated

    def to_document(self) -> NewEntries:
        """Entries of a problem file: the options that the problem itself states."""
        return {name: getattr(self, name) for name in self._stated}

    def check(self, plant: Plant) -> None:
        """InputError for options that do not fit the plant or each other."""


class UnassignedOptions(Options):
    """Options of a problem without a kind: those of any kind, which nothing was checked for."""

    def __init__(self, **entries: Value) -> None:
        self.__dict__.update(entries)


def check_weights(weights: Mapping[str, tuple[float, ...]] | None, plant: Plant) -> None:
    """InputError unless the weights of a Riccati equation have the plant's sizes."""
    for name, count in (("state", plant.n), ("output", plant.p)):
        check_count(f"weights.{name}", (weights or {}).get(name), count, name)


def check_count(name: str, values: tuple[object, ...] | None, count: int, item: str) -> None:
    """InputError unless a list that is given has one entry per state or output."""
    if values is not None and len(values) != count:
        raise InputError(
            f"observer.{name} must have {count} {'entry' if count == 1 else 'entries'}, "
            f"one per {item}; got {len(values)}."
        )


def check_longest_dwell_time(entry: str, plant: Plant) -> None:
    """InputError where jumps may stay away for ever, for what is built for a longest dwell time."""
    if plant.jump and plant.jump.dwell_time and math.isinf(plant.jump.dwell_time[1]):
        raise InputError(
            f"{entry} is built for a longest dwell time: jump.dwell_time[1] must be finite; "
            "got inf."
        )
