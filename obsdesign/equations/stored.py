"""Entries that designs store: declared with their shapes, and checked in one place."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, field
from typing import Any, Self

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, NewEntries, Value

# what a field is declared by: of the type of its annotation, as for `dataclasses.field`
Declared = Any


@dataclass(frozen=True)
class _Shape:
    """Letters and numbers, one per axis; () is a number."""

    axes: tuple[str | int, ...]

    def __str__(self) -> str:
        return " x ".join(map(str, self.axes)) or "number"


def matrix(*axes: str | int, optional: bool = False) -> Declared:
    """Declare a read-only float array with these axes."""
    return _field({"shape": _Shape(axes)}, optional)


def number(*, optional: bool = False) -> Declared:
    """Declare a float, possibly infinite."""
    return _field({"shape": _Shape(())}, optional)


def count(*, optional: bool = False) -> Declared:
    """Declare a whole number, 1 or more."""
    return _field({"count": True}, optional)


def word(*allowed: str, optional: bool = False) -> Declared:
    """Declare one of some words."""
    return _field({"words": allowed}, optional)


def text(*, optional: bool = False) -> Declared:
    """Declare a name."""
    return _field({"text": True}, optional)


def blocks(kind: type[Stored]) -> Declared:
    """Declare blocks of entries of their own, none by default."""
    return field(default=(), metadata={"blocks": kind})


def flag(*, optional: bool = False) -> Declared:
    """Declare true or false."""
    return _field({"flag": True}, optional)


def _field(metadata: Entries, optional: bool) -> Declared:
    return field(default=None, metadata=metadata) if optional else field(metadata=metadata)


@dataclass(frozen=True, kw_only=True, eq=False)
class Stored:
    """Declared entries, with checks and the form of a design file."""

    def __post_init__(self) -> None:
        """ValueError unless every entry is there and all fit each other."""
        sizes: dict[str, int] = {}
        for entry in dataclasses.fields(self):
            value = getattr(self, entry.name)
            if value is None and entry.default is None:
                continue
            object.__setattr__(self, entry.name, _checked(entry, value, sizes))

    @classmethod
    def from_document(cls, entries: Entries) -> Self:
        """The entries that a design file states; ValueError if one is missing or does not fit."""
        names = {entry.name for entry in dataclasses.fields(cls)}
        required = [entry for entry in dataclasses.fields(cls) if entry.default is MISSING]
        for entry in required:
            if entry.name not in entries:
                raise ValueError(f"gains.{entry.name} is missing.")
        return cls(**{name: value for name, value in entries.items() if name in names})

    def to_document(self) -> NewEntries:
        """Entries of a design file, without those that the design does not have."""
        entries = {entry.name: getattr(self, entry.name) for entry in dataclasses.fields(self)}
        stated = {name: value for name, value in entries.items() if value is not None}
        blocks_of = [entry.name for entry in dataclasses.fields(self) if "blocks" in entry.metadata]
        for name in blocks_of:
            listed = [block.to_document() for block in stated.pop(name)]
            stated |= {name: listed} if listed else {}
        return stated


def _checked(entry: Field[Value], value: Value, sizes: dict[str, int]) -> Value:
    """The value of one entry; sizes gains the letters it is the first to use."""
    name, metadata = f"gains.{entry.name}", entry.metadata
    if "words" in metadata:
        if value not in metadata["words"]:
            raise ValueError(f"{name} must be one of {', '.join(metadata['words'])}.")
        return value
    if "text" in metadata:
        if not isinstance(value, str):
            raise ValueError(f"{name} must be a text.")
        return value
    if "blocks" in metadata:
        return _checked_blocks(name, metadata["blocks"], value)
    if "flag" in metadata:
        if not isinstance(value, bool | np.bool_):
            raise ValueError(f"{name} must be true or false.")
        return bool(value)
    if "count" in metadata:
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
            raise ValueError(f"{name} must be a whole number >= 1; got {value!r}.")
        return int(value)
    return _sized(name, metadata["shape"], value, sizes)


def _checked_blocks(name: str, kind: type[Stored], value: Value) -> tuple[Stored, ...]:
    """The blocks of an entry, each of that kind or its form in a design file."""
    if not isinstance(value, list | tuple):
        raise ValueError(f"{name} must be a list of tables.")
    made = []
    for i, entries in enumerate(value):
        if not isinstance(entries, kind | Mapping):
            raise ValueError(f"{name}[{i}] must be a table.")
        made.append(kind.from_document(entries) if isinstance(entries, Mapping) else entries)
    return tuple(made)


def _sized(name: str, shape: _Shape, value: Value, sizes: dict[str, int]) -> Array | float:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.array(value, dtype=object)
    if array.dtype == object or array.ndim != len(shape.axes):
        raise ValueError(f"{name} must have shape {shape}; got shape {array.shape}.")
    expected = tuple(
        axis if isinstance(axis, int) else sizes.setdefault(axis, size)
        for axis, size in zip(shape.axes, array.shape, strict=True)
    )
    if array.shape != expected:
        raise ValueError(f"{name} must have shape {expected} ({shape}); got shape {array.shape}.")
    if not shape.axes:
        return float(array)
    if name not in ("gains.dwell_time", "gains.every") and not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite.")
    array.setflags(write=False)
    return array
