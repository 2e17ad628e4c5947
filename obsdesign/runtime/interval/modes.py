"""Interval observers of plants with modes: the box passes from mode to mode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.modes import SwitchedGains
from obsdesign.runtime.base import Estimate, Sample
from obsdesign.runtime.boxes import JUMP
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.runtime.interval.state import IntervalState
from obsdesign.runtime.modes import Entry, SwitchedObserver, SwitchedState
from obsdesign.runtime.status import MISSING_SAMPLE


class SwitchedInterval(SwitchedState[IntervalState]):
    """State of an interval observer of modes."""

    inner: IntervalState


@dataclass(frozen=True)
class SwitchedIntervalObserver(SwitchedObserver[IntervalState, IntervalGains]):
    """Executes a design of kind `interval` with modes."""

    gains: SwitchedGains[IntervalGains]
    kind: ClassVar[str] = "interval"
    finds_events: ClassVar[bool] = True

    @classmethod
    def from_gains(cls, gains: Entries) -> SwitchedIntervalObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(SwitchedGains.from_document(gains, IntervalGains))

    @cached_property
    def observers(self) -> tuple[IntervalObserver, ...]:
        """One observer for each mode."""
        return tuple(map(self._observer, self.gains.gains))

    def _observer(self, gains: IntervalGains) -> IntervalObserver:
        """The observer of one mode, or of an event in it."""
        return IntervalObserver(gains)

    def _at_same_time(self, inner: IntervalState) -> IntervalState:
        """The state of an observer, from which a row of the same time may follow."""
        return inner._replace(started=False)

    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> SwitchedInterval:
        """State at time t from bounds of x(t), before the first sample and its mode."""
        inner = self.observers[0].init(t, lower=lower, upper=upper)
        return SwitchedInterval(t, inner, guards=self._named.first_guards())

    def start(self, t: float, initial: Sequence[float] | None) -> SwitchedInterval:
        """State from x1_lo, x1_hi, x2_lo, ...; InputError if they are not bounds."""
        inner = self.observers[0].start(t, initial)
        return SwitchedInterval(t, inner, guards=self._named.first_guards())

    def reset(
        self, state: SwitchedState[IntervalState], *, lower: ArrayLike, upper: ArrayLike
    ) -> SwitchedState[IntervalState]:
        """The same instant with new bounds of x(t): ends the refutation of a state.

        Inputs, the mode and the time of entry into it are kept. ValueError as for `init`.
        """
        observer = self.observers[state.mode or 0]
        return state._replace(inner=observer.reset(state.inner, lower=lower, upper=upper))

    def _entered(
        self, inner: IntervalState, estimate: Estimate, before: int, after: int
    ) -> Entry[IntervalState]:
        """The state in the new mode: the same box, or that of the map on entry."""
        gains = self.gains.gains[after]
        if not self.keeps_measurement(before, after):
            inner = inner._replace(y=None, is_usual=False)
        if gains.G is None:
            return Entry(inner, estimate)
        guard = DwellGuard.from_gains(gains)
        held = self._at_same_time(inner)._replace(guard=guard)
        inner, jumped = self.observers[after].step(held, Sample(estimate.t, u=inner.u, jump=True))
        # nothing is measured between the row's sample and the new mode: none is missing
        known = {JUMP, MISSING_SAMPLE, *(text for _, text in estimate.events)}
        faults = [text for _, text in jumped.events if text not in known]
        return Entry(inner._replace(guard=guard), jumped, faults)
