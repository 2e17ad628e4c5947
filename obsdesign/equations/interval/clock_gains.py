"""Gains of the interval observer for several clocks: what a design of such a plant stores."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from lmi.arithmetic.arrays import Array, Value
from obsdesign.equations.clocks import EventGains, SensorGains, clock_data
from obsdesign.equations.gains import PlantGains
from obsdesign.equations.plant import Plant
from obsdesign.equations.stored import blocks, matrix, number


@dataclass(frozen=True, kw_only=True, eq=False)
class ClockedIntervalGains(PlantGains):
    """The plant's numbers and the gains of every sensor and every event.

    L (n, p): x+ = x + L_s (y_s - C_s x) at a sample of sensor s, whose columns are those of its
    outputs; M (e, n, p): for each of e events x+ = G x + M (y - C x), None without events. A
    corrected box is kept only where it is the narrower one: every gain is sound. spacing: least
    time between events of different names, None for none.
    """

    noise_bound: Array = matrix("p")
    events: tuple[EventGains, ...] = blocks(EventGains)
    sensors: tuple[SensorGains, ...] = blocks(SensorGains)
    L: Array = matrix("n", "p")
    M: Array | None = matrix("e", "n", "p", optional=True)
    spacing: float | None = number(optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if any(len(event.G) != self.n for event in self.events):
            raise ValueError("gains.events must have one row per state.")
        if sum(sensor.outputs for sensor in self.sensors) != self.p:
            raise ValueError("gains.sensors must have all outputs between them.")
        if len(self.event_gains) != len(self.events):
            raise ValueError("gains.M must have one matrix per event.")

    @classmethod
    def from_plant(cls, plant: Plant, **gains: Value) -> Self:
        """Gains with the numbers of a plant."""
        return cls(**clock_data(plant), **gains)

    @property
    def event_gains(self) -> Array:
        """(e, n, p), e = 0 without events."""
        return np.zeros((0, self.n, self.p)) if self.M is None else self.M

    @property
    def columns(self) -> dict[str, int | bool]:
        """Numbers of y, u and w in a sample, of all events, and whether events are reported."""
        w = sum(event.inputs for event in self.events)
        return {"y": self.p, "u": self.m, "w": w, "jump": bool(self.events)}

    @property
    def outputs(self) -> tuple[slice, ...]:
        """Where the outputs of each sensor stand among all of them."""
        ends = np.cumsum([sensor.outputs for sensor in self.sensors]).tolist()
        return tuple(slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True))
