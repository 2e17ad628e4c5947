"""Rows that arrive late: a buffer in the order of time."""

from __future__ import annotations

import itertools
import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Value
from obsdesign.runtime.announced import first_changed, with_events_ahead
from obsdesign.runtime.base import Sample
from obsdesign.runtime.bounds import Bounds
from obsdesign.runtime.clocks.time_grid import steps_to_row
from obsdesign.runtime.clocks.time_stamps import time_tolerance

_EVENT = 1  # between samples that see the state before it, 0, and after it, 2


class _Row(NamedTuple):
    """A row of the buffer; rank: its place in the order of the file."""

    t: float
    rank: int
    sample: Sample


class Arrival(NamedTuple):
    """A row has arrived: all rows of the buffer, the place of the new one, how many leave it.

    since: place of the first row that it changes: an event at an uncertain time changes rows before
    its own.
    """

    samples: Sequence[Sample]
    place: int
    leaving: int
    since: int


class LateRows:
    """Rows of the last `lag` in the order of time; of one time as `insert` places them.

    lag: longest time between a row and its arrival, or the stamp of an event that may come before
    it; may_repeat: rows may share a time; now: time of the last arrival so far; before: that of the
    row before the buffer; errors: of the time stamps of events; dt: step of discrete time;
    sees_after (p,): does an output see the state after an event of its time?
    `samples` are the rows that a later arrival may still change.
    """

    def __init__(
        self, lag: float, *, may_repeat: bool = True, samples: Sequence[Sample] = (),
        now: float = -math.inf, before: float = -math.inf, errors: Sequence[float] = (),
        dt: float | None = None, sees_after: Sequence[bool] = (),
    ) -> None:  # fmt: skip
        self.lag, self.now, self._may_repeat, self._errors = lag, now, may_repeat, errors
        self._now_before, self._before, self._dt = now, before, dt
        self._sees_after = np.array(sees_after, dtype=bool)
        self._rows = [_Row(x.t, k - len(samples), x) for k, x in enumerate(samples)]
        self._rows_before = self._rows

    @property
    def samples(self) -> tuple[Sample, ...]:
        """The rows of the buffer, with the events behind them that may come before them."""
        return tuple(with_events_ahead([row.sample for row in self._rows], self._errors))

    def insert(self, sample: Sample, rank: int, *, in_file_order: bool = False) -> Arrival | None:
        """Put a row in its place; None if it has none, as `reason_against` says.

        rank: its place in the order of the file. in_file_order: do rows of one time act in this
        order also where one is late? Otherwise a late one acts as its sensors see events. Where
        rows may not share a time, a second one fills what the first leaves open. ValueError where
        it does not fit, and for a time between two steps.
        """
        self._now_before, self.now = self.now, max(self.now, received(sample))
        self._rows_before = self._rows
        if self._is_settled(sample.t):
            return None
        try:
            place = self._put(sample, rank, in_file_order=in_file_order)
        except ValueError:
            self.withdraw()
            raise
        if place is None:
            return None
        changed = first_changed(sample, self._errors)
        since = bisect_left(self._rows, changed, hi=place, key=lambda row: row.t)
        return Arrival(self.samples, place, self.leaving, since)

    def _put(self, sample: Sample, rank: int, *, in_file_order: bool) -> int | None:
        """Where the row stands, or fills another of its time; None or ValueError as `insert`."""
        if not self._may_repeat:
            first = bisect_left(self._rows, sample.t, key=lambda row: row.t)
            for row in self._rows[first : first + 1]:
                if row.t == sample.t:
                    both = row._replace(sample=_merged(row.sample, sample))
                    self._rows = [*self._rows[:first], both, *self._rows[first + 1 :]]
                    return first
        place = bisect_right(self._rows, (sample.t, rank), key=lambda row: row[:2])
        if self._now_before > sample.t and not in_file_order:
            before = self._place_by_stages(sample, place)
            if before is None:
                return None
            if before < place:
                place, rank = before, self._rows[before].rank
        self._rows = [*self._rows[:place], _Row(sample.t, rank, sample), *self._rows[place:]]
        self._check_times(place)
        return place

    def _place_by_stages(self, sample: Sample, place: int) -> int | None:
        """Place of a late row among those of its time, the last of which is before `place`.

        None where it belongs inside one of them.
        """
        first, last = self._stages(sample)
        end = place
        while place and self._rows[place - 1].t == sample.t:
            if self._stages(self._rows[place - 1].sample)[1] <= first:
                break
            place -= 1
        for row in self._rows[place:end]:
            # events keep the order in which they arrive; samples of one state have none
            if self._stages(row.sample)[0] < last + (last == _EVENT):
                return None
        return place

    def _stages(self, sample: Sample) -> tuple[int, int]:
        """First and last of what a row does: samples before events 0, these 1, samples after 2."""
        after = np.zeros(0, dtype=bool)
        if sample.y is not None and self._sees_after.size:
            after = self._sees_after[np.isfinite(np.asarray(sample.y, float))]
        stages = {2 if sees_it else 0 for sees_it in after.tolist()}
        if sample.jump or sample.events or sample.mode is not None or not stages:
            stages.add(_EVENT)
        return min(stages), max(stages)

    def _check_times(self, place: int) -> None:
        """ValueError unless a row may stand between the one before and the one behind it."""
        times = [self._before, *(row.t for row in self._rows)][place : place + 3]
        for earlier, later in itertools.pairwise(times):
            if earlier == -math.inf:
                continue
            if self._dt is not None:
                steps_to_row(earlier, later, self._dt, started=True)
            elif earlier == later and not self._may_repeat:  # the first one is final
                raise ValueError(f"t must differ from row to row; {later!r} stands twice.")

    def withdraw(self) -> None:
        """Take the last row to arrive out again: it has never come."""
        self._rows, self.now = self._rows_before, self._now_before

    def settled(self) -> list[Sample]:
        """Take out the rows that no other can precede any more."""
        count = self.leaving
        if not count:
            return []
        samples = self.samples[:count]
        self._before, self._rows = self._rows[count - 1].t, self._rows[count:]
        return list(samples)

    def reason_against(self, sample: Sample) -> str:
        """Sentence about a row that has no place in the buffer."""
        if not self._is_settled(sample.t):
            return (
                f"the row of t = {sample.t:.9g} arrived late and acts between samples or events "
                "that are in one row of this time; it is skipped. Give each a row of its own."
            )
        if sample.t >= self.now - self.lag:  # less than the rounding of stamps before
            return (
                f"the row of t = {sample.t!r} arrived after one of {self._before!r} was final; it "
                "is skipped."
            )
        return (
            f"the row of t = {sample.t:.9g} arrived at {self.now:.9g}, more than {self.lag_text} "
            "later; it is skipped."
        )

    @property
    def lag_text(self) -> str:
        """The lag and the entries that it comes from, as sentences name it."""
        entries = "report_delay and time_error" if any(self._errors) else "report_delay"
        return f"{entries} {self.lag:.9g}"

    @property
    def leaving(self) -> int:
        """How many rows no other can precede any more."""
        if self.lag == 0:  # rows of one time come in order
            return len(self._rows)
        return bisect_left(self._rows, True, key=lambda row: not self._is_settled(row.t))

    def _is_settled(self, t: float) -> bool:
        """Have all rows up to time t arrived by now?"""
        return t < self._before or self.now - t > self.lag + time_tolerance(self.lag, self.now)


def _merged(row: Sample, other: Sample) -> Sample:
    """One row of two of a time; ValueError where both state the same.

    received: of the later one.
    """
    twice = f"t must differ from row to row: two rows of {row.t!r} state"
    happens = other if other.jump or other.events else row
    if happens is other and (row.jump or row.events):
        raise ValueError(f"{twice} events.")
    entries = {name: getattr(happens, name) for name in ("jump", "events", "w")}
    for name in ("u", "mode"):
        entries[name] = _either(getattr(row, name), getattr(other, name), f"{twice} {name}.")
    if row.bounds is not None and other.bounds is not None:
        pairs = zip(row.bounds, other.bounds, strict=True)
        entries["bounds"] = Bounds(*(_either(*pair, f"{twice} bounds.") for pair in pairs))
    else:
        entries["bounds"] = row.bounds or other.bounds
    samples = [np.asarray(x.y, float) for x in (row, other) if x.y is not None]
    if len(samples) == 2 and (np.isfinite(samples[0]) & np.isfinite(samples[1])).any():
        raise ValueError(f"{twice} a sample.")
    if samples:
        entries["y"] = np.where(np.isfinite(samples[0]), samples[0], samples[-1])
    return row._replace(**entries, received=max(received(row), received(other)))


def _either(own: Value, new: Value, reason: str) -> Value:
    """The one that is stated; ValueError where both are, and differ."""
    if own is not None and new is not None and not np.array_equal(own, new):
        raise ValueError(reason)
    return new if own is None else own


def received(sample: Sample) -> float:
    """When a row arrived; at its time where nothing is stated."""
    return sample.t if sample.received is None else sample.received
