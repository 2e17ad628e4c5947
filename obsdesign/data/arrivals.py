"""Rows of a record as they arrive: put in the order of time, each once it is final."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from obsdesign.data.first_row import FirstRow
from obsdesign.errors import InputError
from obsdesign.runtime.base import Sample
from obsdesign.runtime.late_rows import Arrival, LateRows, received

Remark = Callable[[str], None]


class BadLine(NamedTuple):
    """A line that cannot be taken: why, its number, its time (NaN where that cannot be read).

    is_first: is it the first line of a record?
    """

    reason: str
    number: int
    t: float = math.nan
    is_first: bool = False


Skip = Callable[[BadLine], None]

SILENCE = "a row that is left out counts as silence of a sensor with sends_on_change"


@dataclass
class Arrivals:
    """How rows of a record that arrive late are put in order.

    buffer: those that an earlier row may still precede; is_stream: lines come in the order of
    arrival, whatever a column `received` says; remark: called with a sentence for each row that
    comes too late, which is left out; note: with that row and those that wait; watch: called with
    each arrival, once the first row in time states what `first` requires (nothing where that is
    known); is_first: is it the first part of a record? silence_counts: may no row be left out?
    """

    buffer: LateRows
    remark: Remark
    is_stream: bool = False
    watch: Callable[[Arrival], None] | None = None
    is_first: bool = True
    silence_counts: bool = False
    note: Callable[[Sample, Sequence[Sample]], None] | None = None
    first: FirstRow = field(default_factory=FirstRow)

    def in_order(
        self,
        lines: Iterable[tuple[int, Sample]],
        name: str,
        skip: Skip | None,
        *,
        has_received: bool,
    ) -> Iterator[Sample]:
        """Rows in the order of time, each once none before it can come; the others stay.

        lines: their numbers and samples. has_received: is there a column `received`? Without it
        rows arrive in the order of lines. skip: called for a second row of one time, where rows may
        not share it, or of a time between two steps; without it that is an InputError, and so is a
        first part of which every row comes too late, and any row that is left out where none may
        be.
        """
        delays, taken = list[float](), 0
        in_file_order = has_received and not self.is_stream
        if in_file_order:
            lines = sorted(lines, key=lambda row: received(row[1]))
        for number, sample in lines:
            try:
                arrival = self.buffer.insert(sample, number, in_file_order=in_file_order)
            except ValueError as error:
                if skip is None:
                    raise InputError(f"{name} line {number}: {error}") from None
                skip(BadLine(f"{name} line {number}: {error}", number, sample.t))
                continue
            if arrival is None and self.silence_counts:
                raise InputError(f"{name}: {self.buffer.reason_against(sample)[:-1]}: {SILENCE}.")
            if arrival is None:
                delays.append(self.buffer.now - sample.t)
                self.remark(f"{name}: {self.buffer.reason_against(sample)}")
                if self.note is not None:
                    self.note(sample, self.waiting)
                continue
            taken += 1
            if self.watch is not None and self.first.has_all(arrival.samples[0]):
                self.watch(arrival)
            yield from self._final(name)
        yield from self._final(name)  # a row that came too late may have settled others
        if self.is_first and delays and not taken:
            raise InputError(
                f"{name}: rows at most {self.buffer.lag_text} late are required; all "
                f"{len(delays)} are later, by {max(delays):.9g} at most. Is report_delay of the "
                "events and sensors stated?"
            )

    def _final(self, name: str) -> list[Sample]:
        """Take out the rows that no other can precede any more; InputError as `require_first`."""
        if self.buffer.leaving:
            self.require_first(name)
            self.first = FirstRow()
        return self.buffer.settled()

    def require_first(self, name: str) -> None:
        """InputError unless the first row in time states what it must."""
        if self.waiting:
            require_first(self.waiting[0], self.first, name)

    @property
    def waiting(self) -> Sequence[Sample]:
        """Rows that an earlier one may still precede."""
        return self.buffer.samples


def require_first(sample: Sample, first: FirstRow, name: str) -> None:
    """InputError unless the first row in time states what it must."""
    first.require(sample, name, f"the first row, that of t = {sample.t:.9g}")
