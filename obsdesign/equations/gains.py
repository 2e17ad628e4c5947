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

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from lmi.arithmetic.arrays import Array, NewEntries, Value
from obsdesign.equations.plant import Plant
from obsdesign.equations.stored import Stored, matrix, number, word


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

    @cached_property
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
