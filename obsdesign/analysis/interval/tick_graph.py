"""The graph of all times with ticks since the last mark, at which ages of a sample are kept.

A bound between two samples rises and falls with them. A state that follows slowly is bounded by
what comes of that, and not of its largest value alone, where times are counted: at ticks D, 2 D,
... after a mark the age of the last sample is in a cell of length d, D = K d, and ages one tick
later are K cells more, exactly. The last tick stands for all later ones too.

    tick K s k i    k ticks after a mark of kind K, the last sample of sensor s is in cell i ago
    last K s k i    just before that sample, where it is in the tick that ends so
    first K s k     just before the first sample in that tick
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

from lmi.bounds.graph_tube import Passage, Strategy
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.analysis.interval.mark_graph import Node
from obsdesign.analysis.interval.marks import NO_TIME, Range, less, meet
from obsdesign.analysis.interval.passage_times import passage
from obsdesign.analysis.interval.time_graph import TimeGraph

_TICKS = 16  # in the shortest time between two events of a name, at most
_COARSE_CELLS = 8  # of a gap, which ticks of finer cells are made of or divide
# of marks: with more of them ticks are too many, whatever the cells
_MOST_KINDS = 3


@dataclass(frozen=True)
class Ticks:
    """Ticks of a sensor: `length`, each `cells` cells of its gap, `count` of them."""

    length: Fraction
    cells: int
    count: int


class TickGraph(TimeGraph):
    """Nodes of marks, of all times since them, and of ticks."""

    def __init__(self, system: ClockSystem, events: Sequence[int], cells: int) -> None:
        super().__init__(system, events, cells)
        self.ticks = {s: ticks for s in self.cells if (ticks := self._ticks(s)) is not None}

    def _ticks(self, sensor: int) -> Ticks | None:
        """Ticks of a sensor, None where its gap is too short for so few, or marks are too many.

        Twice as many cells divide the same ticks, or those of half the length: bounds only narrow.
        """
        cells, unit = self.cells[sensor], self.marks.unit
        if unit is None or len(self.until) > _MOST_KINDS:
            return None
        shortest = unit / _TICKS
        if self.system.gap(sensor) < shortest:
            return None
        cell = self.system.gap(sensor) / len(cells)
        coarse = 1 << ((self.marks.cells - 1) // _COARSE_CELLS).bit_length()
        own = coarse * math.ceil(shortest / (coarse * cell))
        while own % 2 == 0 and own // 2 * cell >= shortest:
            own //= 2
        own = min(own, len(cells))
        return Ticks(own * cell, own, math.ceil(unit / (own * cell)))

    def strategies(self, node: Node) -> list[Strategy]:
        """Strategies of a node."""
        match node:
            case Node("tick", (kind, sensor, k, cell)):
                return self._of_tick(kind, sensor, k, cell)
            case Node("last", (kind, sensor, k, cell)):
                return self._of_last(kind, sensor, k, cell)
            case Node("first", (kind, sensor, k)):
                in_tick = (Fraction(0), self.ticks[sensor].length)
                own = self._unsampled_since(kind, sensor, k, in_tick)
                return [tuple(own), self._in_tick(kind, sensor, k)]
            case Node("since", (kind, part)):
                more = [tuple(self._from_ticks(kind, s, part)) for s in self.ticks]
                return [*super().strategies(node), *more]
            case Node("own", (mark, *_)):
                return [*super().strategies(node), self._before(mark, NO_TIME)]
        return super().strategies(node)

    def _at_mark(self, kind: int, sensor: int) -> list[int]:
        """Cells of the last sample just before a mark."""
        cells = range(len(self.cells[sensor]))
        return [i for i in cells if any((x, i) in self.aged[sensor] for x in self._of_kind(kind))]

    def _ages(self, kind: int, sensor: int, k: int) -> set[int]:
        """Cells of the last sample at a tick, for k = 0 those that the mark leaves."""
        if not k:
            return {self.carried_of(kind, i) for i in self._at_mark(kind, sensor)}
        ticks, cells = self.ticks[sensor], range(len(self.cells[sensor]))
        if k == ticks.count:  # it stands for later ones too, at which any age is reached
            return set(cells)
        older = {j + ticks.cells for j in self._ages(kind, sensor, k - 1)}
        return set(cells[: ticks.cells]) | older & set(cells)

    def _before_tick(self, sensor: int, k: int) -> list[int]:
        """Ticks before one: the last one stands for later ones too, and is before itself."""
        return [k - 1, k] if k == self.ticks[sensor].count else [k - 1]

    def _from_tick(
        self, kind: int, sensor: int, k: int, cell: int, time: Range
    ) -> Iterator[Passage]:
        """From a tick on, from the mark for k = 0."""
        if k:
            yield passage(self.place("tick", kind, sensor, k, cell), None, time)
            return
        for i in self._at_mark(kind, sensor):
            if self.carried_of(kind, i) == cell:
                yield passage(self.place("aged_kind", kind, sensor, i), kind, time)

    def _of_tick(self, kind: int, sensor: int, k: int, cell: int) -> list[Strategy]:
        ticks = self.ticks[sensor]
        whole, at_end = (ticks.length, ticks.length), (k * ticks.length, k * ticks.length)
        during = self._during(kind, sensor, k, at_end)
        if cell < ticks.cells:
            last = self.place("last", kind, sensor, k, cell)
            own = passage(last, self.sampled(sensor), self.cells[sensor][cell])
            return [(own,), self._whatever_is_sampled(kind, sensor, k, whole), during]
        older = [
            each
            for before in self._before_tick(sensor, k)
            if cell - ticks.cells in self._ages(kind, sensor, before)
            for each in self._from_tick(kind, sensor, before, cell - ticks.cells, whole)
        ]
        return [tuple(older), during]

    def _of_last(self, kind: int, sensor: int, k: int, cell: int) -> list[Strategy]:
        """The last sample in a tick: since the tick before it, or since the first one in it."""
        length = self.ticks[sensor].length
        times = less((length, length), self.cells[sensor][cell])
        assert times is not None
        first = self.place("first", kind, sensor, k)
        own = [
            *self._unsampled_since(kind, sensor, k, times),
            passage(first, self.sampled(sensor), (Fraction(0), times[1])),
        ]
        more = self._whatever_is_sampled(kind, sensor, k, times)
        return [tuple(own), more, self._in_tick(kind, sensor, k)]

    def _unsampled_since(self, kind: int, sensor: int, k: int, times: Range) -> Iterator[Passage]:
        """From the tick before to times in the tick that k ends, where nothing is sampled since."""
        for before in self._before_tick(sensor, k):
            for j in self._ages(kind, sensor, before):
                time = meet(times, self.silence(sensor, j))
                if time is not None:
                    yield from self._from_tick(kind, sensor, before, j, time)

    def _whatever_is_sampled(self, kind: int, sensor: int, k: int, time: Range) -> Strategy:
        """From the tick before, of which some time has passed."""
        return tuple(
            each
            for before in self._before_tick(sensor, k)
            for j in self._ages(kind, sensor, before)
            for each in self._from_tick(kind, sensor, before, j, time)
        )

    def _in_tick(self, kind: int, sensor: int, k: int) -> Strategy:
        length = self.ticks[sensor].length
        return self._during(kind, sensor, k, ((k - 1) * length, k * length))

    def _during(self, kind: int, sensor: int, k: int, times: Range) -> Strategy:
        """The bounds of all parts that these times meet, and of later ones for the last tick."""
        end = None if k == self.ticks[sensor].count else times[1]
        parts = self._met(kind, (times[0], end))
        return tuple(passage(self.place("since", kind, part), None) for part in parts)

    def _from_ticks(self, kind: int, sensor: int, part: int) -> Iterator[Passage]:
        """To all times in a part, from the tick before each, whatever is sampled since."""
        ticks, times = self.ticks[sensor], self.parts[part]
        for k in range(ticks.count + 1):
            start = k * ticks.length
            time: Range | None
            if k == ticks.count:  # it stands for later ones too
                is_later = times[1] is None or times[1] >= start
                time = (Fraction(0), ticks.length) if is_later else None
            else:
                reached = meet(times, (start, start + ticks.length))
                time = None if reached is None else less(reached, (start, start))
            if time is not None:
                for j in self._ages(kind, sensor, k):
                    yield from self._from_tick(kind, sensor, k, j, time)
