"""Observers of plants with modes: one observer for each mode, and one state for all of them.

A row's mode holds from the row on: the row's measurement and events are used by the mode before,
then the map on entry, where there is one, acts as a jump of the new mode. Every mode's observer
keeps its own matrices by step size; so does the one of each event in it, which has the event as its
jump. A kind that takes modes has a module `modes` with its observer.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Annotated, ClassVar, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.boxes import image_box
from obsdesign.equations.clocks import EventGains
from obsdesign.equations.modes import ModeGains, SwitchedGains
from obsdesign.runtime.base import Estimate, Observer, Sample, Stepped
from obsdesign.runtime.boxes import JUMP
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.clocks.named_events import NamedEvents
from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.columns import Event
from obsdesign.runtime.state_marks import Below, Past
from obsdesign.runtime.status import Reason, with_reasons


class WithInputs(Protocol):
    """The state of the observer of a mode."""

    @property
    def u(self) -> Matrix:
        """Known inputs (m,) since the last row."""


Inner = TypeVar("Inner", bound=WithInputs)


class ModeObserver(Observer, Protocol):
    """The observer of one mode."""

    @property
    def guards(self) -> Sequence[DwellGuard]:
        """Guards of dwell times as they begin."""

    @property
    def sizes(self) -> Mapping[str, int]:
        """Sizes of the axes of a state's arrays."""


class SwitchedState(NamedTuple, Generic[Inner]):
    """State of an observer of modes: mode, the time of entry, the state of a mode's observer.

    mode None: not yet known; entered: time of entry into it, or of the first row; is_whole: was
    the entry in the record? guards: of every event. A kind derives its own, with the type of
    `inner`.
    """

    t: float
    inner: Inner
    mode: Annotated[int, Below("modes")] | None = None
    entered: Past = -math.inf
    is_whole: bool = False
    guards: tuple[DwellGuard, ...] = ()


class Entry(NamedTuple, Generic[Inner]):
    """A mode is entered: the state after the map, the estimate, and what is wrong with it."""

    inner: Inner
    estimate: Estimate
    faults: Sequence[str] = ()


class SwitchedObserver(Stepped[SwitchedState[Inner]], Generic[Inner, ModeGains]):
    """Executes a design with modes; columns are those of any mode's observer."""

    gains: SwitchedGains[ModeGains]
    finds_events: ClassVar[bool]

    @abstractmethod
    def _observer(self, gains: ModeGains) -> ModeObserver:
        """The observer of one mode, or of an event in it."""

    @abstractmethod
    def _at_same_time(self, inner: Inner) -> Inner:
        """The state of an observer, from which a row of the same time may follow."""

    @abstractmethod
    def _entered(self, inner: Inner, estimate: Estimate, before: int, after: int) -> Entry[Inner]:
        """The state and the estimate in the new mode: as they were, or those of its map G."""

    def step(
        self, state: SwitchedState[Inner], sample: Sample
    ) -> tuple[SwitchedState[Inner], Estimate]:
        """Move to the time of the sample in the mode before, use it, and enter its mode."""
        after, places = self._place(sample, state.mode), self._named.places(sample)
        before = after if state.mode is None else state.mode
        inner, estimate = self._advanced(state.inner, sample, before, places)
        t, events = estimate.t, estimate.events
        guards, not_kept = self._named.guarded(state.guards, t, places)
        reasons = [*self._objections(sample.t, state, after), *not_kept]
        reasons += self._forbidden(before, places)
        entered, is_whole = (t, False) if state.mode is None else (state.entered, state.is_whole)
        if self.finds_events:
            events = (*events, *((t, text) for text in reasons))
        status = estimate.status
        if after != before:
            entered, is_whole = t, True
            if self.finds_events:
                events = (*events, (t, f"mode {self.modes[after]}"))
            inner, estimate, faults = self._entered(inner, estimate, before, after)
            status = with_reasons(status, faults)
        following = state._replace(
            t=t, inner=inner, mode=after, entered=entered, is_whole=is_whole, guards=guards
        )
        return following, estimate._replace(events=events, status=with_reasons(status, reasons))

    def _advanced(
        self, inner: Inner, sample: Sample, mode: int, places: Sequence[int]
    ) -> tuple[Inner, Estimate]:
        """The state after the flow, the measurement and the events of a row, and the estimate."""
        if not places:
            return self.observers[mode].step(inner, sample)
        measured_at = len(places) - 1 if self.gains.sees_after else 0
        estimates = list[Estimate]()
        for k, event in enumerate(places):
            w = self._named.inputs(sample, event)
            y = sample.y if k == measured_at else None
            own = sample._replace(y=y, w=w, jump=True, events=())
            if k:
                inner, own = self._at_same_time(inner), own._replace(u=inner.u)
            observer = self._at_events[mode, event, k == measured_at]
            inner, estimate = observer.step(inner, own)
            estimates.append(self._with_event_name(estimate, event))
        faults = [one.status for one in estimates if one.status != "ok"]
        events = tuple(event for one in estimates for event in one.events)
        status = with_reasons("ok", list(dict.fromkeys(faults)))
        return inner, estimates[-1]._replace(events=events, status=status)

    def _with_event_name(self, estimate: Estimate, place: int) -> Estimate:
        """The estimate of a jump with the name of its event."""
        name = self.gains.events[place].name
        named = [(t, name if text == JUMP else text) for t, text in estimate.events]
        return estimate._replace(events=tuple(named))

    def _forbidden(self, mode: int, places: Sequence[int]) -> list[Reason]:
        """Sentences on events that do not happen in a mode."""
        name, events = self.modes[mode], self.gains.events
        return [
            self._named.titled(k, Reason(f"does not happen in {name}"))
            for k in places
            if not events[k].may_happen(name)
        ]

    @cached_property
    def observers(self) -> Sequence[ModeObserver]:
        """One observer for each mode."""
        return tuple(map(self._observer, self.gains.gains))

    @cached_property
    def _at_events(self) -> Mapping[tuple[int, int, bool], ModeObserver]:
        """Observers that have an event as their jump, by (mode, event, is y measured at it?)."""
        return {
            (mode, place, is_seen): self._observer(_with_event(own, event, is_seen))
            for mode, own in enumerate(self.gains.gains)
            for place, event in enumerate(self.gains.events)
            for is_seen in (False, True)
        }

    @cached_property
    def _named(self) -> NamedEvents:
        """The events, each no sooner than its shortest time after the last one of its name.

        No claim counts on an event: one that comes late, or never, takes nothing from it.
        """
        events = [
            replace(event, dwell_time=np.array([event.dwell_range[0], math.inf]))
            for event in self.gains.events
        ]
        return NamedEvents(events, spacing=self.gains.spacing)

    def keeps_measurement(self, before: int, after: int) -> bool:
        """Is y the same function of the state before and after this change?"""
        first, second = self.gains.gains[before], self.gains.gains[after]
        return second.G is None and bool((first.C == second.C).all())

    def _place(self, sample: Sample, mode: int | None) -> int:
        """Place of the mode from a sample on; ValueError for one that the design does not have."""
        if sample.bounds is not None:
            raise ValueError("bounds of a row are not used with modes.")
        if sample.mode is None:
            if mode is None:
                listed = ", ".join(self.modes)
                raise ValueError(f"the first sample must name its mode ({listed}).")
            return mode
        if sample.mode not in self.modes:
            listed = ", ".join(self.modes)
            raise ValueError(f"mode must be one of {listed}; got {sample.mode!r}.")
        return self.modes.index(sample.mode)

    def _objections(self, t: float, state: SwitchedState[Inner], after: int) -> list[Reason]:
        """Reasons for which a row, with its change of mode if it has one, is not admissible.

        The stay in which a record begins may have begun before: only its longest is checked.
        """
        if state.mode is None:
            return []
        span, reasons = self.gains.spans[state.mode], list[Reason]()
        low, high = span.every.tolist()
        stay, slack = t - state.entered, time_tolerance(t - state.entered, t)
        if state.is_whole and after != state.mode and stay < low - slack:
            reasons.append(Reason.measured("stay", stay, f"in {span.name} below {low:.9g}"))
        elif stay > high + slack:
            reasons.append(Reason.measured("stay", stay, f"in {span.name} above {high:.9g}"))
        if after != state.mode and after not in self.gains.following[state.mode]:
            reasons.append(Reason(f"{self.modes[after]} does not follow {span.name}"))
        return reasons

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
        """Those of every mode's observer, then of every event."""
        return (*self.observers[0].guards, *self._named.first_guards())

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the axes of a state's arrays, and the number of modes."""
        return {**self.observers[0].sizes, "modes": len(self.modes)}

    @property
    def reads(self) -> dict[str, int | bool]:
        """How many y, u, w a sample has, and whether events are reported."""
        events = self.gains.events
        inputs = sum(event.inputs for event in events)
        return {**self.observers[0].reads, "w": inputs, "jump": bool(events)}

    @property
    def event_names(self) -> tuple[str, ...]:
        """Columns of an event file."""
        return self.observers[0].event_names

    def event_cells(self, event: Event) -> Sequence[float | str]:
        """Cells of an event in an event file."""
        return self.observers[0].event_cells(event)


def _with_event(own: ModeGains, event: EventGains, is_seen: bool) -> ModeGains:
    """The gains of a mode with an event as the jump; is_seen: is y measured at it?"""
    lower, upper = image_box(*event.disturbance)
    stated = own.to_document() | {"G": event.G, "jump_lower": lower, "jump_upper": upper}
    stated |= {} if event.E is None else {"E": event.E}
    if "D0" in stated:  # of kind `interval`: a split of the jump
        stated |= {"Gp": np.maximum(event.G, 0.0), "Gn": np.maximum(-event.G, 0.0)}
    stated |= {} if is_seen else {"jump_measurement": "none"}
    return type(own).from_document(stated)
