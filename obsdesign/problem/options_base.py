"""Base class of the options of all kinds, and which of them a problem states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Self

from obsdesign.problem.schema import Fragment, file_entry

if TYPE_CHECKING:
    from obsdesign.problem.plant import Plant


def option(
    fragment: Fragment, description: str, *, default: Any = None, whole: bool = False
) -> Any:
    """Declare an option; default: where the file has none; whole: it counts something."""
    return file_entry(fragment, description, default=default, whole=whole)


class Options:
    """Options of an observer, and which of them the problem states, in its order."""

    _stated: tuple[str, ...]

    def __post_init__(self) -> None:
        declared = fields(self)  # type: ignore[arg-type]
        stated = tuple(one.name for one in declared if getattr(self, one.name) != one.default)
        object.__setattr__(self, "_stated", stated)

    @classmethod
    def from_entries(cls, entries: Mapping[str, Any]) -> Self:
        """Options from the entries of a problem file, converted and named as the schema has it."""
        options = cls(**entries)
        object.__setattr__(options, "_stated", tuple(entries))
        return options

    def is_stated(self, name: str) -> bool:
        """Does the problem itself state this option?"""
        return name in self._stated

    def to_document(self) -> dict[str, Any]:
        """Entries of a problem file: the options that the problem itself states."""
        return {name: getattr(self, name) for name in self._stated}

    def check(self, plant: Plant) -> None:
        """InputError for options that do not fit the plant or each other."""


class UnassignedOptions(Options):
    """Options of a problem without a kind: those of any kind, which nothing was checked for."""

    def __init__(self, **entries: Any) -> None:
        self.__dict__.update(entries)
