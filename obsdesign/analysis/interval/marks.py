"""Marks: instants at which events happen, and the times between them.

A mark states which events happen, one or several of a row, and how long ago the others did, in
cells of time. The time from one mark to the next is in a range that both leave: of an event that
happens at the second it is its stated one, less the time that had passed at the first; of every
other event it takes the time that had passed from its cell to the next one's. At a mark every other
event is at least the stated spacing ago. Whatever events do,
their marks follow each other so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import permutations, product

import numpy as np

from lmi.arithmetic.balls import to_float
from obsdesign.analysis.interval.clock_widths import ClockSystem

# (shortest, longest) of a time, the latter None where it is infinite
Range = tuple[Fraction, Fraction | None]
NO_TIME: Range = (Fraction(0), Fraction(0))
_ANY_TIME: Range = (Fraction(0), None)
MOST_MARKS = 250
_MOST_PARTS = 64


def meet(first: Range, second: Range) -> Range | None:
    """Times in both ranges; None for none."""
    ends = [high for _, high in (first, second) if high is not None]
    low, high = max(first[0], second[0]), min(ends, default=None)
    return None if high is not None and high < low else (low, high)


def met(ranges: Sequence[Range], other: Range) -> list[Range]:
    """What each of some ranges has in common with another, where there is any."""
    return [own for each in ranges if (own := meet(each, other)) is not None]


def less(first: Range, second: Range) -> Range | None:
    """Differences >= 0 of a time in one range and a time in the other; None for none."""
    low = Fraction(0) if second[1] is None else max(first[0] - second[1], Fraction(0))
    high = None if first[1] is None else first[1] - second[0]
    return None if high is not None and high < low else (low, high)


def hull(ranges: Sequence[Range]) -> Range:
    """The shortest range that holds all."""
    ends = [high for _, high in ranges]
    most = None if None in ends else max(high for high in ends if high is not None)
    return min(low for low, _ in ranges), most


@dataclass(frozen=True)
class Mark:
    """Events that happen at once, by place, and of every event the time since its last.

    due: just before the mark, of its own events the stated range.
    """

    events: tuple[int, ...]
    due: dict[int, Range]

    @cached_property
    def passed(self) -> dict[int, Range]:
        """Time since the last of every event, just after the mark."""
        return {e: NO_TIME if e in self.events else own for e, own in self.due.items()}

    def until(self, following: Mark) -> Range | None:
        """Times to the next mark, if it may be that one."""
        time: Range | None = _ANY_TIME
        for event, due in following.due.items():
            own = less(due, self.passed[event])
            time = None if time is None or own is None else meet(time, own)
        return time


class Marks:
    """Marks of a system; `following`: (mark, next one, time between) by place, all that may be.

    events: those that count, by place; cells: parts of the shortest of all shortest times between
    two events of a name.
    """

    def __init__(self, system: ClockSystem, events: Sequence[int], cells: int) -> None:
        self.system, self.cells = system, cells
        self.dwells = {e: _stated(system.dwell(e)) for e in events}
        self.kinds = _kinds(system, events)
        self.marks = [
            Mark(kind, dict(zip(events, due, strict=True)))
            for kind in self.kinds
            for due in product(*self._ages(kind))
        ] if self.count() <= MOST_MARKS else []  # fmt: skip
        self.following = self._following()

    @cached_property
    def unit(self) -> Fraction | None:
        """The shortest stated time between two events of a name, but for zero; None for none."""
        return min((low for low, _ in self.dwells.values() if low > 0), default=None)

    @property
    def longest(self) -> Fraction | None:
        """Longest time between two marks, None where it is infinite."""
        return min((high for _, high in self.dwells.values() if high is not None), default=None)

    def count_of(self, time: Fraction, unit: Fraction) -> int:
        """Cells of a time, `cells` in each unit; larger ones where they would be too many."""
        return min(math.ceil(time * self.cells / unit), _MOST_PARTS)

    def count(self) -> int:
        """How many marks there are at most."""
        return sum(math.prod(len(own) for own in self._ages(kind)) for kind in self.kinds)

    def _ages(self, kind: Sequence[int]) -> list[list[Range]]:
        """Of every event the ranges of the time since its last, just before a mark."""
        apart: Range = (self.system.spacing, None)
        return [
            [dwell] if e in kind else met(self._cells(dwell), apart)
            for e, dwell in self.dwells.items()
        ]

    def _cells(self, dwell: Range) -> list[Range]:
        """Cells of the time since an event: up to the shortest until the next one, and beyond."""
        shortest, longest = dwell
        cells: list[Range] = []
        if shortest > 0:
            assert self.unit is not None
            cells += parts_of(shortest, self.count_of(shortest, self.unit))
        if longest is None:
            return [*cells, (shortest, None)]
        beyond = 1 if self._decays or longest == shortest else self.cells
        return cells + [
            (shortest + low, shortest + high)
            for low, high in parts_of(longest - shortest, beyond) if high is not None
        ]  # fmt: skip

    @cached_property
    def _decays(self) -> bool:
        """Does the width decay without events? Longest times matter little then."""
        return bool((np.linalg.eigvals(to_float(self.system.W)).real < 0).all())

    def _following(self) -> list[tuple[int, int, Range]]:
        """All pairs of which the first mark has one before it, and so on."""
        pairs = [
            (x, y, time)
            for x, one in enumerate(self.marks)
            for y, two in enumerate(self.marks)
            if (time := one.until(two)) is not None
        ]
        while True:
            reached = {y for _, y, _ in pairs}
            kept = [pair for pair in pairs if pair[0] in reached]
            if len(kept) == len(pairs):
                return kept
            pairs = kept


def parts_of(length: Fraction, count: int) -> list[Range]:
    """Equal parts of [0, length]."""
    return [(length * i / count, length * (i + 1) / count) for i in range(count)]


def _stated(dwell: tuple[float, float]) -> Range:
    low, high = dwell
    return Fraction(low), None if math.isinf(high) else Fraction(high)


def _kinds(system: ClockSystem, events: Sequence[int]) -> list[tuple[int, ...]]:
    """Events of one row, in order: one of them, or several where a sensor is read at one.

    Several events of a row that no sensor is read at are the same as one by one.
    """
    kinds: list[tuple[int, ...]] = [(e,) for e in events]
    if system.spacing:  # never in one row
        return kinds
    for size in range(2, len(events) + 1):
        kinds += [kind for kind in permutations(events, size) if any(map(system.is_read, kind))]
    return kinds
