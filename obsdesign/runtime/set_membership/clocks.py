"""Clocks of events and sensors: what a sample saw, and which stated times are not kept.

No stated time enters the bounds: a clock that is not kept voids claims about widths alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.clocks import SensorGains
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.base import Sample, no_jumps, vector
from obsdesign.runtime.dwell_guard import DwellGuard
from obsdesign.runtime.time_stamps import time_tolerance

# where no time between two events is stated
_ANY = (0.0, math.inf)


class Kept(NamedTuple):
    """Guards of events and times of the last samples, by sensor, as a state keeps them."""

    guards: tuple[DwellGuard, ...]
    sampled: tuple[float, ...]


@dataclass(frozen=True)
class Clocks:
    """The clocks of a design."""

    gains: SetMembershipGains

    def begin(self, t: float) -> Kept:
        """No event so far; the time since the last sample counts from t on."""
        guards = [DwellGuard.from_gains(self.gains)]
        if self.gains.sensors:
            ends = [event.dwell_time for event in self.gains.events]
            guards = [DwellGuard(*(_ANY if end is None else end.tolist())) for end in ends]
        return Kept(tuple(guards), (t,) * max(len(self.gains.sensors), 1))

    def events(self, sample: Sample) -> tuple[int, ...]:
        """Places of the events of a row; ValueError unless the plant has them."""
        if not sample.jump:
            return ()
        names = [event.name for event in self.gains.every_event]
        if not names:
            raise no_jumps()
        if len(names) == 1 and not sample.events:
            return (0,)
        if not sample.events or not all(0 <= k < len(names) for k in sample.events):
            raise ValueError(
                f"events must be places among {', '.join(names)}, from 0; got {sample.events!r}."
            )
        return tuple(int(k) for k in sample.events)

    def inputs(self, sample: Sample, event: int) -> Matrix:
        """Known inputs w of an event, which stand behind those of the events before it."""
        counts = [each.inputs for each in self.gains.every_event]
        if sample.w is None:
            return np.zeros(counts[event])
        first = sum(counts[:event])
        own = vector(sample.w, sum(counts), "w")[first : first + counts[event]]
        if self.gains.sensors and not np.isfinite(own).all():
            raise ValueError(f"w of event {self.gains.events[event].name} must be finite.")
        return own

    def part(self, y: Matrix | None, when: str) -> Matrix | None:
        """The measurements that saw the state before or after the events of a row, else NaN."""
        if y is None:
            return None
        own = np.where(self._sees == when, y, np.nan)
        return own if np.isfinite(own).any() else None

    def after(
        self, kept: Kept, t: float, row: tuple[Matrix | None, tuple[int, ...]], started: bool
    ) -> tuple[Kept, list[str]]:
        """Clocks after a row of measurements and events, and sentences on those not kept."""
        y, events = row
        sentences, guards = list[str](), list[DwellGuard]()
        for k, guard in enumerate(kept.guards):
            following, violation = guard.after(t, k in events)
            guards.append(following)
            if violation is not None:
                named = f"{self.gains.events[k].name}: " if self.gains.sensors else ""
                sentences.append(named + violation)
        if self.gains.sensors:
            sentences += self._sensors_not_kept(kept, t, y, events)
        else:
            sentences += self._samples_not_kept(kept.sampled[0], t, y, started, bool(events))
        return Kept(tuple(guards), self._sampled_at(kept.sampled, t, y)), sentences

    def _sampled_at(
        self, sampled: Sequence[float], t: float, y: Matrix | None
    ) -> tuple[float, ...]:  # fmt: skip
        """Times of the last samples after measurements y of time t."""
        if y is None:
            return tuple(sampled)
        there = self._of_sensors(y)
        return tuple(
            t if np.isfinite(own).any() else last for last, own in zip(sampled, there, strict=True)
        )

    def _of_sensors(self, y: Matrix) -> list[Matrix]:
        ends = np.cumsum([sensor.outputs for sensor in self.gains.sensors])[:-1]
        return np.split(y, ends) if self.gains.sensors else [y]

    def _sensors_not_kept(
        self, kept: Kept, t: float, y: Matrix | None, events: tuple[int, ...]
    ) -> Iterator[str]:
        """Sentences on sensors that are silent for longer than stated."""
        gains = self.gains
        happened = {gains.events[k].name for k in events}
        values = self._of_sensors(np.full(gains.p, np.nan) if y is None else y)
        for sensor, last, own in zip(gains.sensors, kept.sampled, values, strict=True):
            has_all, apart = bool(np.isfinite(own).all()), t - last
            if (sensor.gap == 0.0 or sensor.event in happened) and not has_all:
                yield f"{sensor.name}: missing sample"
            elif sensor.gap > 0.0 and apart > sensor.gap + time_tolerance(apart, t):
                yield (
                    f"{sensor.name}: time {apart:.9g} since the last sample, above {sensor.gap:.9g}"
                )

    def _samples_not_kept(
        self, sampled: float, t: float, y: Matrix | None, started: bool, jump: bool
    ) -> list[str]:
        """Sentences on a sample of the one output that is missing or late."""
        gains = self.gains
        is_due = gains.measured != "at_jumps" or jump
        if jump and gains.jump_measurement == "none":
            is_due = False
        sentences = []
        if gains.period is not None and gains.measured == "periodic" and started:
            apart = t - sampled
            slack = time_tolerance(apart, t)
            is_due = is_due and apart >= gains.period - slack
            if y is not None and apart > gains.period + slack:
                limit = f"above {gains.period:.9g}"
                sentences.append(f"time {apart:.9g} since the last sample, {limit}")
        absent = [] if y is None else [f"y{i + 1}" for i in np.flatnonzero(np.isnan(y))]
        if is_due and (y is None or absent):
            which = f" of {' '.join(absent)}" if absent else ""
            sentences.insert(0, f"missing sample{which}")
        return sentences

    @cached_property
    def _sees(self) -> NDArray[np.str_]:
        """What each output sees at an event (p,)."""
        if not self.gains.sensors:
            return np.full(self.gains.p, self.gains.jump_measurement)
        sensors: Sequence[SensorGains] = self.gains.sensors
        return np.repeat([x.sees for x in sensors], [x.outputs for x in sensors])
