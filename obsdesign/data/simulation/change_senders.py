"""Simulated sensors that send when their reading has changed since the last sample."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Plant


@dataclass
class ChangeSender:
    """A sensor that compares its reading with the value it sent last, at every row.

    own: its outputs among all; last, sent_at: the value and the time of its last sample.
    """

    sensor: Output
    own: slice
    last: Matrix | None = field(default=None, init=False)
    sent_at: float = field(default=0.0, init=False)

    def sends(self, y: Matrix, t: float, following: float) -> bool:
        """Does it send the readings y of a row at t, `following` the time of the next row?"""
        change = self.sensor.sends_on_change
        is_still = self.last is not None and bool((np.abs(y - self.last) < change).all())
        if is_still and following - self.sent_at <= self.sensor.gap:
            return False
        self.last, self.sent_at = y, t
        return True


@dataclass(frozen=True)
class ChangeSenders:
    """The sensors of a plant that send on change."""

    senders: tuple[ChangeSender, ...]

    @classmethod
    def from_plant(cls, plant: Plant) -> ChangeSenders:
        """Those of a plant, before their first sample."""
        ends = np.cumsum([0, *(len(sensor.C) for sensor in plant.sensors)]).tolist()
        return cls(tuple(
            ChangeSender(sensor, slice(first, last))
            for sensor, first, last in zip(plant.sensors, ends, ends[1:], strict=False)
            if sensor.sends_on_change is not None
        ))  # fmt: skip

    def sent(self, y: Matrix, t: float, following: float) -> Matrix:
        """The readings (p,) of a row at t without those that are not sent, NaN there."""
        sent = y.copy()
        for sender in self.senders:
            if not sender.sends(y[sender.own], t, following):
                sent[sender.own] = np.nan
        return sent
