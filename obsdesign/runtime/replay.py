"""Rows that arrive late: estimates of the rows after them, computed again.

States are immutable and a step has no effect but its result: a row that arrives late is inserted,
and the rows after it are stepped again from the state before it. What comes out is, bit for bit,
what rows in the order of time give, whatever the kind of observer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from obsdesign.runtime.base import Estimate, KindState, Observer, Sample
from obsdesign.runtime.late_rows import Arrival, LateRows
from obsdesign.runtime.status import with_reasons

PROVISIONAL = "provisional"


class Revised(NamedTuple):
    """Estimates that an arrival changes.

    provisional: of the row that arrived and of those after it; final: of the rows that no other
    can precede any more.
    """

    provisional: Sequence[Estimate]
    final: Sequence[Estimate]


class Revisions:
    """Estimates of the rows of a buffer, which arrivals change.

    state: that before the first row, or a function from the time of that row to this state, where
    an earlier row may still come.
    """

    def __init__(self, observer: Observer, state: KindState | Callable[[float], KindState]) -> None:
        self._observer, self._state = observer, state
        self._entries: list[tuple[KindState, Estimate]] = []

    def revised(self, arrival: Arrival) -> Revised:
        """Estimates after the arrival of a row; ValueError as of a step, which changes nothing."""
        samples, since, leaving = arrival.samples, arrival.since, arrival.leaving
        entries = self._entries[:since]
        state = entries[-1][0] if entries else self._before(samples[0].t)
        for sample in samples[len(entries) :]:
            state, estimate = self._observer.step(state, sample)
            entries.append((state, estimate))
        if leaving:
            self._state = entries[leaving - 1][0]
        self._entries = entries[leaving:]
        estimates = [estimate for _, estimate in entries]
        return Revised([provisional(each) for each in estimates[since:]], estimates[:leaving])

    def _before(self, t: float) -> KindState:
        """The state before the first row of the buffer, which is of time t."""
        return self._state(t) if callable(self._state) else self._state


class Replay:
    """An observer on rows that arrive late: estimates of all rows that an arrival changes.

    report_delay: longest time between a row and its arrival, to which the errors of the times of
    events are added; state: as of `Revisions`.
    """

    def __init__(
        self,
        observer: Observer,
        state: KindState | Callable[[float], KindState],
        report_delay: float = 0.0,
    ) -> None:
        self._revisions = Revisions(observer, state)
        errors = observer.time_errors
        self._rows = LateRows(report_delay + max(errors, default=0.0), errors=errors)
        self._arrived = 0

    def take(self, sample: Sample) -> list[Estimate]:
        """Estimates of the row and of those after it, then of the rows that are final with it.

        The former have the status `provisional`. Rows of one time act in the order in which they
        are taken. ValueError for a sample that the observer cannot take, and for a row older than
        the lag: it is left out, and later bounds may depend on it.
        """
        arrival = self._rows.insert(sample, self._arrived)
        if arrival is None:
            raise ValueError(self._rows.reason_against(sample))
        self._arrived += 1
        try:
            revised = self._revisions.revised(arrival)
        except ValueError:
            self._rows.withdraw()
            raise
        self._rows.settled()
        return [*revised.provisional, *revised.final]


def provisional(estimate: Estimate) -> Estimate:
    """The estimate with the word that rows before it may still come, beside other reasons."""
    status = estimate.status
    reasons = [] if status == "ok" else [status]
    return estimate._replace(status=with_reasons(PROVISIONAL, reasons))
