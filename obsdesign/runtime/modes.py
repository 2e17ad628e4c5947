"""Observers of plants with modes: one observer for each mode, and one state for all of them.

A row's mode holds from the row on: the row's measurement is used by the mode before, then the map
on entry, where there is one, acts as a jump of the new mode. Every mode's observer keeps its own
matrices by step size. A kind that takes modes has a module `modes` with its observer.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Annotated, ClassVar, Generic, NamedTuple, Protocol, TypeVar

from obsdesign.equations.modes import ModeGains, SwitchedGains
from obsdesign.runtime.base import Estimate, Observer, Sample, Stepped
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.columns import Event
from obsdesign.runtime.state_marks import Below, Past
from obsdesign.runtime.status import with_reasons

Inner = TypeVar("Inner")


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
    the entry in the record? A kind derives its own, with the type of `inner`.
    """

    t: float
    inner: Inner
    mode: Annotated[int, Below("modes")] | None = None
    entered: Past = -math.inf
    is_whole: bool = False


class Entry(NamedTuple, Generic[Inner]):
    """A mode is entered: the state after the map, the estimate, and what is wrong with it."""

    inner: Inner
    estimate: Estimate
    faults: Sequence[str] = ()


class SwitchedObserver(Stepped[SwitchedState[Inner]], Generic[Inner, ModeGains]):
    """Executes a design with modes; columns are those of any mode's observer."""

    gains: SwitchedGains[ModeGains]
    finds_events: ClassVar[bool]

    @cached_property
    @abstractmethod
    def observers(self) -> Sequence[ModeObserver]:
        """One observer for each mode."""

    @abstractmethod
    def _entered(self, inner: Inner, estimate: Estimate, before: int, after: int) -> Entry[Inner]:
        """The state and the estimate in the new mode: as they were, or those of its map G."""

    def step(
        self, state: SwitchedState[Inner], sample: Sample
    ) -> tuple[SwitchedState[Inner], Estimate]:
        """Move to the time of the sample in the mode before, use it, and enter its mode."""
        after = self._place(sample, state.mode)
        before = after if state.mode is None else state.mode
        inner, estimate = self.observers[before].step(state.inner, sample)
        t, events = estimate.t, estimate.events
        reasons = self._objections(sample.t, state, after)
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
            t=t, inner=inner, mode=after, entered=entered, is_whole=is_whole
        )  # fmt: skip
        return following, estimate._replace(events=events, status=with_reasons(status, reasons))

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

    def _objections(self, t: float, state: SwitchedState[Inner], after: int) -> list[str]:
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
            reasons.append(f"{self.modes[after]} does not follow {span.name}")
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
        """Those of every mode's observer."""
        return self.observers[0].guards

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the axes of a state's arrays, and the number of modes."""
        return {**self.observers[0].sizes, "modes": len(self.modes)}

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
