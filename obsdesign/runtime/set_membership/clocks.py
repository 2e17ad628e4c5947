"""Clocks of a multiplier observer: of named events and sensors, or of a jump and an output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.clocks.named_clocks import Kept, NamedClocks
from obsdesign.runtime.clocks.silent_sensors import SilentSensors
from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.status import MISSING_SAMPLE, Reason, late_sample

# time, measurements and events of a row
ClockedRow = tuple[float, Matrix | None, tuple[int, ...]]


@dataclass(frozen=True)
class OneClock(NamedClocks):
    """The clocks of a plant with one jump and one output, which messages do not name."""

    gains: SetMembershipGains = field(kw_only=True)

    def begin(self, t: float) -> Kept:
        """No jump so far; the time since the last sample counts from t on."""
        return Kept((DwellGuard.from_gains(self.gains),), (t,))

    def after(
        self, kept: Kept, t: float, y: Matrix | None, events: Sequence[int], *, started: bool = True
    ) -> tuple[Kept, list[Reason]]:
        """Clocks after a row of measurements and jumps, and sentences on those not kept."""
        is_step = self.gains.dt is not None
        guard, violation = kept.guards[0].after(t, 0 in events, is_step=is_step)
        (sampled,) = kept.sampled
        sentences = [] if violation is None else [violation]
        sentences += self._samples_not_kept(sampled, t, y, started, bool(events))
        counts = y is not None or (bool(events) and self._hides_sample(sampled, t))
        return Kept((guard,), (t if counts else sampled,)), sentences

    def _hides_sample(self, sampled: float, t: float) -> bool:
        """Does a jump at t hide the sample that was due there? It then counts as taken."""
        gains = self.gains
        if gains.period is None or gains.jump_measurement != "none":
            return False
        apart = t - sampled
        return abs(apart - gains.period) <= time_tolerance(apart, t)

    def _samples_not_kept(
        self, sampled: float, t: float, y: Matrix | None, started: bool, jump: bool
    ) -> list[Reason]:
        """Sentences on a sample of the one output that is missing or late."""
        gains = self.gains
        is_due = gains.measured != "at_jumps" or jump
        if jump and gains.jump_measurement == "none":
            is_due = False
        sentences = list[Reason]()
        if gains.period is not None and gains.measured == "periodic" and started:
            apart = t - sampled
            slack = time_tolerance(apart, t)
            is_due = is_due and apart >= gains.period - slack
            if y is not None and apart > gains.period + slack:
                sentences.append(late_sample(apart, gains.period))
        absent = [] if y is None else [f"y{i + 1}" for i in np.flatnonzero(np.isnan(y))]
        if is_due and (y is None or absent):
            which = f" of {' '.join(absent)}" if absent else ""
            sentences.insert(0, Reason(f"{MISSING_SAMPLE}{which}", MISSING_SAMPLE))
        return sentences

    @cached_property
    def sees(self) -> NDArray[np.str_]:
        """What each output sees at a jump (p,)."""
        return np.full(self.gains.p, self.gains.jump_measurement)


@dataclass(frozen=True)
class Clocks:
    """The clocks of a design, and measurements of states that have none.

    further: number of outputs behind those of the design, measured in every row before its events.
    """

    gains: SetMembershipGains
    further: int = 0

    @cached_property
    def named(self) -> NamedClocks:
        """The clocks of the design."""
        gains = self.gains
        if gains.sensors:
            return NamedClocks(gains.every_event, gains.dt, gains.spacing, gains.sensors)
        return OneClock(gains.every_event, gains=gains)

    @property
    def may_repeat(self) -> bool:
        """May rows share a time?"""
        return bool(self.gains.sensors)

    def part(self, y: Matrix | None, when: str) -> Matrix | None:
        """The measurements that saw the state before or after the events of a row, else NaN."""
        if y is None:
            return None
        own = np.where(self._sees == when, y, np.nan)
        return own if np.isfinite(own).any() else None

    def after(
        self, kept: Kept, t: float, row: tuple[Matrix | None, tuple[int, ...]], started: bool
    ) -> tuple[Kept, list[Reason]]:
        """Clocks after a row of measurements and events, and sentences on those not kept."""
        y, events = row
        y = None if y is None else y[: self.gains.p]
        measured = y is not None and bool(np.isfinite(y).any())
        return self.named.after(kept, t, y if measured else None, events, started=started)

    def sent(self, before: Matrix, y: Matrix | None) -> Matrix:
        """Values that sensors on change sent last, after a row; see `SilentSensors.sent`."""
        return self._silent.sent(before, None if y is None else y[: self.gains.p])

    def silence_strip(
        self,
        sent: Matrix,
        sampled: Sequence[float],
        row: ClockedRow,
    ) -> tuple[Matrix, Matrix] | None:
        """Readings of silent sensors before the events of a row, and how far each may be off.

        NaN where nothing is known; None where no sensor sends on change.
        """
        if not self._silent.has_senders:
            return None
        t, y, events = row
        own = None if y is None else y[: self.gains.p]
        known = self._silent.readings(sent, sampled, t, own)
        if events:
            known = np.where(self.named.sees == "after", np.nan, known)
        nothing = np.zeros(self.further)
        return np.append(known, nothing + np.nan), np.append(self._silent.change, nothing)

    @cached_property
    def _silent(self) -> SilentSensors:
        return SilentSensors(self.gains.sensors)

    @cached_property
    def _sees(self) -> NDArray[np.str_]:
        """What each output sees at an event."""
        return np.append(self.named.sees, ["before"] * self.further)
