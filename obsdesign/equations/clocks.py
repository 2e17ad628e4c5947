"""Events and sensors of a plant with several clocks, as a design stores them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, NewEntries
from obsdesign.equations.gains import flow_data
from obsdesign.equations.plant import Jump, Output, Plant
from obsdesign.equations.stored import Stored, count, matrix, number, text, word


@dataclass(frozen=True, kw_only=True, eq=False)
class EventGains(Stored):
    """A named jump x+ = G x + E w + c, with c in a box, or c = W u with u in a box.

    G (n, n); E (n, l); lower, upper (k,): of c, or of u where disturbance_matrix W (n, k) is given;
    dwell_time: (shortest, longest) time since the last event of this name, None for any.
    time_error: largest time between it and its stamp, None for zero; input_bound (l,): of |w|, for
    widths alone; modes: names of those in which alone it happens, joined by "+", None for any.
    """

    name: str = text()
    G: Array = matrix("n", "n")
    E: Array | None = matrix("n", "l", optional=True)
    lower: Array = matrix("k")
    upper: Array = matrix("k")
    disturbance_matrix: Array | None = matrix("n", "k", optional=True)
    dwell_time: Array | None = matrix(2, optional=True)
    time_error: float | None = number(optional=True)
    input_bound: Array | None = matrix("l", optional=True)
    modes: str | None = text(optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.disturbance_matrix is None and len(self.lower) != len(self.G):
            raise ValueError("gains.lower must have one entry per state.")
        if self.time_error is not None and not 0 < self.time_error < math.inf:
            raise ValueError("gains.time_error must be a positive number.")

    @classmethod
    def from_event(cls, event: Jump) -> EventGains:
        """The numbers of an event of a plant."""
        dwell_time = None if event.dwell_time is None else np.array(event.dwell_time)
        return cls(
            name=event.name, G=event.G, E=event.E, lower=event.lower, upper=event.upper,
            disturbance_matrix=event.disturbance_matrix, dwell_time=dwell_time,
            time_error=event.stamp_error or None, input_bound=event.input_bound,
            modes=None if event.modes is None else "+".join(event.modes),
        )  # fmt: skip

    @property
    def inputs(self) -> int:
        """Number of known inputs w."""
        return 0 if self.E is None else int(self.E.shape[1])

    @property
    def counted_inputs(self) -> Array:
        """Largest |w| (l,) that claims of widths are for: input_bound, or 1 where it is absent."""
        return np.ones(self.inputs) if self.input_bound is None else self.input_bound

    @property
    def dwell_range(self) -> tuple[float, float]:
        """(shortest, longest) time since the last one; (0, inf) where every one is allowed."""
        low, high = (0.0, math.inf) if self.dwell_time is None else self.dwell_time
        return float(low), float(high)

    @property
    def changes_state(self) -> bool:
        """Is its map other than the identity?"""
        return not np.array_equal(self.G, np.eye(len(self.G)))

    def may_happen(self, mode: str) -> bool:
        """May it happen in a mode?"""
        return self.modes is None or mode in self.modes.split("+")

    @property
    def disturbance(self) -> tuple[Array, Array, Array]:
        """(W, lower, upper): c = W u with u in the box; W = I where the box is that of c."""
        own = self.disturbance_matrix
        return np.eye(len(self.G)) if own is None else own, self.lower, self.upper


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorGains(Stored):
    """A named sensor: which outputs are its own, and when it is read.

    outputs: how many rows of C, in the order of the sensors; sees: at events it sees the state
    before, after, or nothing; gap: longest time between two samples, 0 where every row has one,
    infinite where it is not bounded; event: name of the event at which alone it is read.
    sends_on_change (o,), one for each of its outputs: it also sends as soon as one of them has
    changed by so much since the last sample; None where it does not.
    """

    name: str = text()
    outputs: int = count()
    sees: str = word("before", "after", "none")
    gap: float = number()
    event: str | None = text(optional=True)
    sends_on_change: Array | None = matrix("o", optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        changes = self.sends_on_change
        if changes is not None and (len(changes) != self.outputs or not (changes > 0).all()):
            raise ValueError("gains.sends_on_change must have a positive entry for each output.")

    @classmethod
    def from_sensor(cls, sensor: Output) -> SensorGains:
        """The clock of a sensor of a plant."""
        return cls(
            name=sensor.name, outputs=len(sensor.C), sees=sensor.jump_measurement, gap=sensor.gap,
            event=sensor.event, sends_on_change=sensor.sends_on_change,
        )  # fmt: skip


def events_of(plant: Plant) -> tuple[EventGains, ...]:
    """The events of a plant, as a design stores them."""
    return tuple(EventGains.from_event(event) for event in plant.events)


def sensors_of(plant: Plant) -> tuple[SensorGains, ...]:
    """The clocks of the sensors of a plant, as a design stores them."""
    return tuple(SensorGains.from_sensor(sensor) for sensor in plant.sensors)


def clock_data(plant: Plant) -> NewEntries:
    """The numbers of a plant with several clocks that a design stores.

    Its outputs are those of all sensors, one above the other; `jump_measurement` is of each sensor.
    """
    outputs = plant.outputs
    events = [event.to_document() for event in events_of(plant)]
    sensors = [sensor.to_document() for sensor in sensors_of(plant)]
    data: NewEntries = flow_data(plant) | {"C": outputs.C, "sensors": sensors}
    data |= {"events": events} if events else {}
    data |= {"noise_bound": outputs.noise_radius, "noise_centre": outputs.noise_centre}
    data |= {"jump_measurement": "before", "spacing": plant.timing.spacing or None}
    return {name: value for name, value in data.items() if value is not None}
