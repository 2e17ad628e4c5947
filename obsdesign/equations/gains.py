"""Gains of a design as typed, checked objects; each kind derives its own from `PlantGains`.

A kind that does not store all of `PlantGains` derives from `Gains`.

    @dataclass(frozen=True, kw_only=True, eq=False)
    class LuenbergerGains(PlantGains):
        L: Array = matrix("n", "p")
        M: Array = matrix("n", "p")

A letter in a shape stands for one size throughout an object; a field that is optional is None where
the design does not have it. Dictionaries with string keys are for files: `from_document` reads one,
`to_document` writes it.
"""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, NewEntries, Value
from obsdesign.equations.plant import Plant

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Gains(Stored, ABC):
    """Entries of every kind, with checks and the forms of a design file.

    A (n, n), C (p, n); noise_centre (p,): middle of the bounds of the noise, None where it is zero.
    """

    A: Array = matrix("n", "n")
    C: Array = matrix("p", "n")
    noise_centre: Array | None = matrix("p", optional=True)

    @cached_property
    def n(self) -> int:
        """Number of states."""
        return len(self.A)

    @cached_property
    def p(self) -> int:
        """Number of outputs."""
        return len(self.C)

    @property
    @abstractmethod
    def columns(self) -> dict[str, int | bool]:
        """How many y, u, w a sample has, and whether jumps are reported."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantGains(Gains):
    """Numbers of the plant that every observer needs at run time.

    B (n, m); flow_lower, flow_upper (n,): bounds of b; G (n, n), E (n, l), jump_lower, jump_upper
    (n,): the jump, None without jumps; dwell_time: (shortest, longest), None where every dwell time
    is allowed; noise_bound (p,): |v - noise_centre| <= noise_bound. dt: step of a plant in discrete
    time, None for a flow.
    """

    B: Array | None = matrix("n", "m", optional=True)
    flow_lower: Array = matrix("n")
    flow_upper: Array = matrix("n")
    G: Array | None = matrix("n", "n", optional=True)
    E: Array | None = matrix("n", "l", optional=True)
    jump_lower: Array | None = matrix("n", optional=True)
    jump_upper: Array | None = matrix("n", optional=True)
    dwell_time: Array | None = matrix(2, optional=True)
    dwell_jitter: float | None = number(optional=True)
    noise_bound: Array | None = matrix("p", optional=True)
    jump_measurement: str = word("before", "after", "none")
    dt: float | None = number(optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dt is not None and not 0.0 < self.dt < math.inf:
            raise ValueError(f"gains.dt must be a positive number; got {self.dt!r}.")
        for name in ("jump_lower", "jump_upper"):
            if self.G is not None and getattr(self, name) is None:
                raise ValueError(f"gains.{name} must have shape n; got nothing.")

    @classmethod
    def from_plant(cls, plant: Plant, **gains: Value) -> Self:
        """Gains with the numbers of a plant."""
        return cls(**plant_data(plant), **gains)

    @cached_property
    def m(self) -> int:
        """Number of known inputs."""
        return 0 if self.B is None else int(self.B.shape[1])

    @property
    def step(self) -> float:
        """The step dt of a plant in discrete time."""
        assert self.dt is not None
        return self.dt

    @property
    def jump_matrix(self) -> Array:
        """G (n, n); ValueError where the plant has no jumps."""
        if self.G is None:
            raise ValueError("gains.G is missing: this plant has no jumps.")
        return self.G

    @property
    def flow_drift(self) -> Array:
        """Middle of the bounds of b (n,)."""
        return np.asarray((self.flow_lower + self.flow_upper) / 2)

    @property
    def jump_drift(self) -> Array:
        """Middle of the bounds of c (n,); zero without jumps."""
        if self.jump_lower is None or self.jump_upper is None:
            return np.zeros(self.n)
        return np.asarray((self.jump_lower + self.jump_upper) / 2)

    @property
    def columns(self) -> dict[str, int | bool]:
        """Numbers of y, u and w in a sample, and whether jumps are reported."""
        w = 0 if self.E is None else self.E.shape[1]
        return {"y": self.p, "u": self.m, "w": w, "jump": self.G is not None}

    @property
    def dwell_range(self) -> tuple[float, float]:
        """(shortest, longest) dwell time; (0, inf) where every one is allowed."""
        low, high = (0.0, math.inf) if self.dwell_time is None else self.dwell_time
        return float(low), float(high)


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


def plant_data(plant: Plant) -> NewEntries:
    """The plant's numbers that the runtime needs, under the names of a design's `gains`.

    What it does not state is left out: the entries of the jump where there is none, and a dwell
    time that may be any.
    """
    jump, output = plant.jump, plant.output
    data = flow_data(plant) | {"C": output.C}
    if jump is not None:
        data |= {"G": jump.G, "E": jump.E}
        data |= dict(zip(("jump_lower", "jump_upper"), jump.c_bounds, strict=True))
        dwell_time = None if jump.dwell_time is None else list(jump.dwell_time)
        jitter = jump.dwell_jitter if math.isfinite(jump.dwell_jitter) else None
        data |= {"dwell_time": dwell_time, "dwell_jitter": jitter}
    if output.noise_bound is not None:
        data |= {"noise_bound": output.noise_radius, "noise_centre": output.noise_centre}
    data |= {"jump_measurement": output.jump_measurement}
    return {name: value for name, value in data.items() if value is not None}


def flow_data(plant: Plant) -> NewEntries:
    """The numbers of the flow among them, B and dt where there are any."""
    flow, (lower, upper) = plant.flow, plant.flow.b_bounds
    data: NewEntries = {"A": flow.A, "B": flow.B, "dt": flow.dt}
    stated = {name: value for name, value in data.items() if value is not None}
    return stated | {"flow_lower": lower, "flow_upper": upper}
