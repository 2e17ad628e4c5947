"""Observers of plants with modes: one observer for each mode, and one state for all of them.

A row's mode holds from the row on: the row's measurement is used by the mode before, then the map
on entry, where there is one, acts as a jump of the new mode. Every mode's observer keeps its own
matrices by step size.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.equations.modes import ModeGains, SwitchedGains
from obsdesign.runtime.base import Estimate, Sample, Stepped
from obsdesign.runtime.columns import Event
from obsdesign.runtime.dwell_guard import DwellGuard
from obsdesign.runtime.interval.clock import MISSING
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.runtime.interval.state import IntervalState
from obsdesign.runtime.luenberger.observer import LuenbergerObserver, LuenbergerState
from obsdesign.runtime.state_marks import Past
from obsdesign.runtime.time_stamps import time_tolerance


class SwitchedInterval(NamedTuple):
    """State of an interval observer of modes: mode, the time of entry, the state of the bounds.

    mode None: not yet known; entered: time of entry into it, or of the first row; is_whole: was
    the entry in the record?
    """

    t: float
    inner: IntervalState
    mode: int | None = None
    entered: Past = -math.inf
    is_whole: bool = False


class SwitchedPoint(NamedTuple):
    """The same of a point observer."""

    t: float
    inner: LuenbergerState
    mode: int | None = None
    entered: Past = -math.inf
    is_whole: bool = False


Switched = TypeVar("Switched", SwitchedInterval, SwitchedPoint)


@dataclass(frozen=True)
class _Changes(Generic[ModeGains]):
    """Modes of a design, and what objects to a change of mode or a stay."""

    gains: SwitchedGains[ModeGains]

    def place(self, sample: Sample, mode: int | None) -> int:
        """The mode from a sample on; ValueError for one that the design does not have."""
        names = self.gains.names
        if sample.bounds is not None:
            raise ValueError("bounds of a row are not used with modes.")
        if sample.mode is None:
            if mode is None:
                raise ValueError(f"the first sample must name its mode ({', '.join(names)}).")
            return mode
        if sample.mode not in names:
            raise ValueError(f"mode must be one of {', '.join(names)}; got {sample.mode!r}.")
        return names.index(sample.mode)

    def objections(
        self, t: float, state: SwitchedInterval | SwitchedPoint, after: int
    ) -> list[str]:
        """Reasons for which a row, with its change of mode if it has one, is not admissible.

        The stay in which a record begins may have begun before: only its longest is checked.
        """
        if state.mode is None:
            return []
        span, reasons = self.gains.spans[state.mode], []
        low, high = span.every.tolist()
        stay, slack = t - state.entered, time_tolerance(t - state.entered, t)
        if state.is_whole and after != state.mode and stay < low - slack:
            reasons.append(f"stay {stay:.9g} in {span.name} below {low:.9g}")
        elif stay > high + slack:
            reasons.append(f"stay {stay:.9g} in {span.name} above {high:.9g}")
        if after != state.mode and after not in self.gains.following[state.mode]:
            reasons.append(f"{self.gains.names[after]} does not follow {span.name}")
        return reasons

    def keeps_measurement(self, before: int, after: int) -> bool:
        """Is y the same function of the state before and after this change?"""
        first, second = self.gains.gains[before], self.gains.gains[after]
        return getattr(second, "G", None) is None and np.array_equal(first.C, second.C)


class _Switched(Stepped[Switched], Generic[Switched, ModeGains]):
    """What observers of modes share: columns are those of any mode's observer."""

    gains: SwitchedGains[ModeGains]

    @cached_property
    @abstractmethod
    def observers(self) -> Sequence[IntervalObserver | LuenbergerObserver]:
        """One observer for each mode."""

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t."""
        return self.observers[0].names

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of the modes."""
        return self.gains.names

    @property
    def guards(self) -> Sequence[DwellGuard]:
        """Those of every mode's observer."""
        return self.observers[0].guards

    @property
    def reads(self) -> dict[str, int | bool]:
        """How many y, u, w a sample has; jumps are not reported."""
        return {**self.observers[0].reads, "w": 0, "jump": False}

    @property
    def event_names(self) -> tuple[str, ...]:
        """Columns of an event file."""
        return self.observers[0].event_names

    def event_cells(self, event: Event) -> Sequence[float | str]:
        """Cells of an event in an event file."""
        return self.observers[0].event_cells(event)


@dataclass(frozen=True)
class SwitchedIntervalObserver(_Switched[SwitchedInterval, IntervalGains]):
    """Executes a design of kind `interval` with modes."""

    gains: SwitchedGains[IntervalGains]
    kind = "interval"
    finds_events = True

    @classmethod
    def from_gains(cls, gains: Entries) -> SwitchedIntervalObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(SwitchedGains.from_document(gains, IntervalGains))

    @cached_property
    def observers(self) -> tuple[IntervalObserver, ...]:
        """One observer for each mode."""
        return tuple(map(IntervalObserver, self.gains.gains))

    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> SwitchedInterval:
        """State at time t from bounds of x(t), before the first sample and its mode."""
        return SwitchedInterval(t, self.observers[0].init(t, lower=lower, upper=upper))

    def start(self, t: float, initial: Sequence[float] | None) -> SwitchedInterval:
        """State from x1_lo, x1_hi, x2_lo, ...; InputError if they are not bounds."""
        return SwitchedInterval(t, self.observers[0].start(t, initial))

    def step(self, state: SwitchedInterval, sample: Sample) -> tuple[SwitchedInterval, Estimate]:
        """Move to the time of the sample in the mode before, use it, and enter its mode."""
        changes = _Changes(self.gains)
        after = changes.place(sample, state.mode)
        before = after if state.mode is None else state.mode
        inner, estimate = self.observers[before].step(state.inner, sample)
        reasons = changes.objections(sample.t, state, after)
        events = list(estimate.events) + [(estimate.t, text) for text in reasons]
        entered, is_whole = (estimate.t, False) if state.mode is None else state[3:]
        if after != before:
            entered, is_whole = estimate.t, True
            events.append((estimate.t, f"mode {self.modes[after]}"))
            inner, estimate = self._entered(inner, estimate, before, after)
        status = _joined(estimate.status, reasons)
        following = SwitchedInterval(estimate.t, inner, after, entered, is_whole)
        return following, estimate._replace(events=tuple(events), status=status)

    def _entered(
        self, inner: IntervalState, estimate: Estimate, before: int, after: int
    ) -> tuple[IntervalState, Estimate]:
        """The state in the new mode: the same box, or that of the map on entry."""
        gains = self.gains.gains[after]
        if not _Changes(self.gains).keeps_measurement(before, after):
            inner = inner._replace(y=None, is_usual=False)
        if gains.G is None:
            return inner, estimate
        guard = DwellGuard.from_gains(gains)
        jump = Sample(estimate.t, jump=True)
        held = inner._replace(started=False, guard=guard)
        inner, jumped = self.observers[after].step(held, jump)
        # nothing is measured between the row's sample and the new mode: none is missing
        faults = [
            x for x in jumped.status.split("; ") if x not in ("ok", MISSING, *_parts(estimate))
        ]
        status = _joined(estimate.status, faults)
        return inner._replace(guard=guard), jumped._replace(status=status)


@dataclass(frozen=True)
class SwitchedPointObserver(_Switched[SwitchedPoint, LuenbergerGains]):
    """Executes a design of kind `luenberger` with modes."""

    gains: SwitchedGains[LuenbergerGains]
    kind = "luenberger"
    finds_events = False

    @classmethod
    def from_gains(cls, gains: Entries) -> SwitchedPointObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(SwitchedGains.from_document(gains, LuenbergerGains))

    @cached_property
    def observers(self) -> tuple[LuenbergerObserver, ...]:
        """One observer for each mode."""
        return tuple(map(LuenbergerObserver, self.gains.gains))

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> SwitchedPoint:
        """State at time t from a guess of x(t), before the first sample and its mode."""
        return SwitchedPoint(t, self.observers[0].init(t, x=x))

    def start(self, t: float, initial: Sequence[float] | None) -> SwitchedPoint:
        """State from x1, ..., xn; InputError unless n finite numbers."""
        return SwitchedPoint(t, self.observers[0].start(t, initial))

    def step(self, state: SwitchedPoint, sample: Sample) -> tuple[SwitchedPoint, Estimate]:
        """Move to the time of the sample in the mode before, use it, and enter its mode."""
        changes = _Changes(self.gains)
        after = changes.place(sample, state.mode)
        before = after if state.mode is None else state.mode
        inner, estimate = self.observers[before].step(state.inner, sample)
        reasons = changes.objections(sample.t, state, after)
        entered, is_whole = (estimate.t, False) if state.mode is None else state[3:]
        if after != before:
            entered, is_whole = estimate.t, True
            y = inner.y if changes.keeps_measurement(before, after) else None
            G = self.gains.gains[after].G
            x = inner.x if G is None else np.asarray(G @ inner.x)
            inner, estimate = replace(inner, x=x, y=y), estimate._replace(x=x)
        status = _joined(estimate.status, reasons)
        following = SwitchedPoint(estimate.t, inner, after, entered, is_whole)
        return following, estimate._replace(status=status)


def _parts(estimate: Estimate) -> list[str]:
    """Reasons in the status of an estimate."""
    return estimate.status.split("; ")


def _joined(status: str, reasons: Sequence[str]) -> str:
    """A status with further reasons."""
    stated = [] if status == "ok" else [status]
    return "; ".join([*stated, *reasons]) or "ok"


SWITCHED = {"interval": SwitchedIntervalObserver, "luenberger": SwitchedPointObserver}
