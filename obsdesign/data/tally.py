"""Numbers of rows of a run, by the kinds of the reasons in their statuses."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from obsdesign.runtime.columns import Batch
from obsdesign.runtime.status import OK, Reason, reasons_of


@dataclass
class KindCount:
    """Rows with reasons of one kind: how many, the time of the first, the range of the numbers."""

    rows: int = 0
    first: float = math.nan
    least: float = math.inf
    largest: float = -math.inf

    def add(self, t: float, number: float | None) -> None:
        """Count a row at time t."""
        self.first = t if self.rows == 0 else self.first
        self.rows += 1
        if number is not None:
            self.least, self.largest = min(self.least, number), max(self.largest, number)

    def __str__(self) -> str:
        """The numbers and the time, for a person."""
        when = f"{'first ' if self.rows > 1 else ''}at t = {self.first:.9g}"
        if self.least > self.largest:
            return when
        ends = dict.fromkeys(f"{end:.9g}" for end in (self.least, self.largest))
        return f"{' to '.join(ends)}; {when}"


@dataclass
class Tally:
    """Numbers of rows of a run; kinds: of reasons, whose number does not grow with the record.

    start: time of the first row, NaN before it.
    """

    rows: int = 0
    good: int = 0
    kinds: dict[str, KindCount] = field(default_factory=dict)
    start: float = math.nan

    def add(self, t: float, status: str) -> None:
        """Count a row at time t."""
        self.start = t if self.rows == 0 else self.start
        self.rows += 1
        if status == OK:
            self.good += 1
            return
        for reason in reasons_of(status):
            self._count(t, reason)

    def add_rows(self, batch: Batch) -> None:
        """Count the rows of a batch."""
        self.start = float(batch.t[0]) if self.rows == 0 else self.start
        if (good := batch.status.count(OK)) == len(batch.status):
            self.rows, self.good = self.rows + good, self.good + good
            return
        for t, status in zip(batch.t.tolist(), batch.status, strict=True):
            self.add(t, status)

    def _count(self, t: float, reason: Reason) -> None:
        self.kinds.setdefault(reason.kind, KindCount()).add(t, reason.number)

    def rows_with(self, kind: str) -> int:
        """Number of rows with a reason of this kind."""
        return self.kinds[kind].rows if kind in self.kinds else 0

    def __str__(self) -> str:
        """The statuses with their numbers of rows, the most frequent first."""
        listed = [(self.good, OK)] if self.good else []
        listed += [(count.rows, f"{kind} ({count})") for kind, count in self.kinds.items()]
        listed.sort(key=lambda entry: -entry[0])
        return ", ".join(f"{rows} {text}" for rows, text in listed)
