"""Named events of a record: which happen, their known inputs, and times that are not kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.clocks import EventGains
from obsdesign.runtime.base import Sample, vector
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.jump import no_jumps
from obsdesign.runtime.status import Reason


@dataclass(frozen=True)
class NamedEvents:
    """Events in their order.

    dt: step of discrete time, None for a flow; spacing: least time between two events of different
    names, None for none.
    """

    events: Sequence[EventGains]
    dt: float | None = None
    spacing: float | None = None

    def first_guards(self) -> tuple[DwellGuard, ...]:
        """Guards before any event."""
        return tuple(DwellGuard(*event.dwell_range) for event in self.events)

    def places(self, sample: Sample) -> tuple[int, ...]:
        """Places of the events of a row; ValueError unless the plant has them, each once.

        In discrete time they are in the order of the design.
        """
        if not sample.jump and not sample.events:
            return ()
        names = [event.name for event in self.events]
        if not names:
            raise no_jumps()
        if len(names) == 1 and not sample.events:
            return (0,)
        if not sample.events or not all(0 <= k < len(names) for k in sample.events):
            raise ValueError(
                f"events must be places among {', '.join(names)}, from 0; got {sample.events!r}."
            )
        places = tuple(int(k) for k in sample.events)
        if len(set(places)) < len(places):
            raise ValueError(f"events of a row must differ; got {sample.events!r}.")
        if self.dt is not None and list(places) != sorted(places):
            raise ValueError(
                "events of a row must be in the order of the design in discrete time; got "
                f"{sample.events!r}."
            )
        return places

    def inputs(self, sample: Sample, event: int) -> Matrix:
        """Known inputs w of an event, which stand behind those of the events before it."""
        counts = [each.inputs for each in self.events]
        if sample.w is None:
            return np.zeros(counts[event])
        first = sum(counts[:event])
        own = vector(sample.w, sum(counts), "w")[first : first + counts[event]]
        if not np.isfinite(own).all():
            raise ValueError(f"w of event {self.events[event].name} must be finite.")
        return own

    def guarded(
        self, guards: Sequence[DwellGuard], t: float, events: Sequence[int]
    ) -> tuple[tuple[DwellGuard, ...], list[Reason]]:
        """Guards after the events of a row, and sentences on times that are not kept."""
        sentences, following = list[Reason](), list[DwellGuard]()
        for k, guard in enumerate(guards):
            own, violation = guard.after(t, k in events, is_step=self.dt is not None)
            following.append(own)
            if violation is not None:
                sentences.append(self.titled(k, violation))
        return tuple(following), sentences + self._too_close(guards, t, events)

    def _too_close(
        self, guards: Sequence[DwellGuard], t: float, events: Sequence[int]
    ) -> list[Reason]:
        """Sentences on events that come too soon after one of another name."""
        if not self.spacing:
            return []
        last = {k: guard.last_jump for k, guard in enumerate(guards)}
        sentences = list[Reason]()
        for k in events:
            for other, before in last.items():
                if other == k or before is None:
                    continue
                apart = t - before
                if apart < self.spacing - time_tolerance(apart, t):
                    finding = f"since {self.events[other].name} below {self.spacing:.9g}"
                    sentences.append(self.titled(k, Reason.measured("time", apart, finding)))
            last[k] = t
        return sentences

    def titled(self, event: int, reason: Reason) -> Reason:
        """A reason about an event, with its name unless it is [jump]."""
        name = self.events[event].name
        return reason if name == "jump" else reason.of_clock(name)
