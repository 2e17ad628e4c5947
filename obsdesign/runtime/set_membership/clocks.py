"""Clocks of a multiplier observer: of named events and sensors, or of a jump and an output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.base import Sample
from obsdesign.runtime.dwell_guard import DwellGuard
from obsdesign.runtime.named_clocks import Kept, NamedClocks
from obsdesign.runtime.time_stamps import time_tolerance


@dataclass(frozen=True)
class Clocks:
    """The clocks of a design."""

    gains: SetMembershipGains

    def begin(self, t: float) -> Kept:
        """No event so far; the time since the last sample counts from t on."""
        if self.gains.sensors:
            return self._named.begin(t)
        return Kept((DwellGuard.from_gains(self.gains),), (t,))

    def events(self, sample: Sample) -> tuple[int, ...]:
        """Places of the events of a row; ValueError unless the plant has them."""
        return self._named.places(sample)

    def inputs(self, sample: Sample, event: int) -> Matrix:
        """Known inputs w of an event, which stand behind those of the events before it."""
        return self._named.inputs(sample, event)

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
        if self.gains.sensors:
            return self._named.after(kept, t, y, events)
        guard, violation = kept.guards[0].after(t, 0 in events)
        sentences = [] if violation is None else [violation]
        sentences += self._samples_not_kept(kept.sampled[0], t, y, started, bool(events))
        if events and self._hides_sample(kept.sampled[0], t):
            return Kept((guard,), (t,)), sentences
        return Kept((guard,), self._sampled_at(kept.sampled, t, y)), sentences

    def _sampled_at(
        self, sampled: Sequence[float], t: float, y: Matrix | None
    ) -> tuple[float, ...]:  # fmt: skip
        """Times of the last samples after measurements y of time t."""
        if self.gains.sensors:
            return self._named.sampled_at(sampled, t, y)
        return tuple(sampled) if y is None else (t,)

    def _hides_sample(self, sampled: float, t: float) -> bool:
        """Does a jump at t hide the sample that was due there? It then counts as taken."""
        gains = self.gains
        if gains.period is None or gains.jump_measurement != "none":
            return False
        apart = t - sampled
        return abs(apart - gains.period) <= time_tolerance(apart, t)

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
        return self._named.sees

    @cached_property
    def _named(self) -> NamedClocks:
        return NamedClocks(self.gains.every_event, self.gains.sensors, self.gains.dt)
