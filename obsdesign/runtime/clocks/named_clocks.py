"""Clocks of named events and sensors: which stated times a record does not keep.

No stated time enters the bounds: a clock that is not kept voids claims about widths alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.clocks import SensorGains
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.clocks.named_events import NamedEvents
from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.status import MISSING_SAMPLE, Reason, late_sample


class Kept(NamedTuple):
    """Guards of events and times of the last samples, by sensor, as a state keeps them."""

    guards: tuple[DwellGuard, ...]
    sampled: tuple[float, ...]


@dataclass(frozen=True)
class NamedClocks(NamedEvents):
    """The clocks of events and sensors."""

    sensors: Sequence[SensorGains] = ()

    def begin(self, t: float) -> Kept:
        """No event so far; the time since the last sample counts from t on."""
        return Kept(self.first_guards(), (t,) * len(self.sensors))

    def after(
        self, kept: Kept, t: float, y: Matrix | None, events: Sequence[int], *, started: bool = True
    ) -> tuple[Kept, list[Reason]]:
        """Clocks after a row of measurements and events, and sentences on those not kept.

        started: was there a row before?
        """
        guards, sentences = self.guarded(kept.guards, t, events)
        sentences += self._not_kept(kept, t, y, events)
        return Kept(guards, self.sampled_at(kept.sampled, t, y)), sentences

    def sampled_at(self, sampled: Sequence[float], t: float, y: Matrix | None) -> tuple[float, ...]:
        """Times of the last samples after measurements y of time t."""
        if y is None:
            return tuple(sampled)
        there = self.of_sensors(y)
        return tuple(
            t if np.isfinite(own).any() else last for last, own in zip(sampled, there, strict=True)
        )

    def of_sensors(self, y: Matrix) -> list[Matrix]:
        """The part of a measurement of all outputs that each sensor has."""
        ends = np.cumsum([sensor.outputs for sensor in self.sensors])[:-1]
        return np.split(y, ends)

    def _not_kept(
        self, kept: Kept, t: float, y: Matrix | None, events: Sequence[int]
    ) -> Iterator[Reason]:
        """Sentences on sensors that are silent for longer than stated."""
        happened = {self.events[k].name for k in events}
        outputs = sum(sensor.outputs for sensor in self.sensors)
        values = self.of_sensors(np.full(outputs, np.nan) if y is None else y)
        for sensor, last, own in zip(self.sensors, kept.sampled, values, strict=True):
            has_all, apart = bool(np.isfinite(own).all()), t - last
            if (sensor.gap == 0.0 or sensor.event in happened) and not has_all:
                yield self._titled(sensor.name, MISSING_SAMPLE)
                continue
            over, slack = apart - sensor.gap, time_tolerance(apart, t)
            if sensor.gap > 0.0 and over > slack:
                yield self._titled(sensor.name, late_sample(apart, sensor.gap))
            elif self.dt is not None and not has_all and over >= -slack:
                # no step is left in which it could come
                yield self._titled(sensor.name, MISSING_SAMPLE)

    def _titled(self, name: str, reason: Reason) -> Reason:
        """A reason about a sensor, with its name unless it is [output]."""
        is_block = name == "output" and len(self.sensors) == 1
        return reason if is_block else reason.of_clock(name)

    @cached_property
    def sees(self) -> NDArray[np.str_]:
        """What each output sees at an event (p,)."""
        sensors = self.sensors
        return np.repeat([x.sees for x in sensors], [x.outputs for x in sensors])
