"""The graph of marks with nodes of all times, by the time since the last mark.

kind K          just before a mark of a kind
aged_kind K s i the same where the last sample of sensor s is in cell i of its longest gap ago
since K p       the last mark is of kind K, a time in part p ago
instant K p     the same at the time at which part p begins
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction

from lmi.bounds.graph_tube import Passage, Strategy
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.analysis.interval.mark_graph import MarkGraph, Node
from obsdesign.analysis.interval.marks import NO_TIME, Range, hull, less, meet, parts_of
from obsdesign.analysis.interval.passage_times import held, passage

# parts of the time since a mark beyond the shortest time, each larger than the one before
_PARTS_BEYOND, _LARGER = 8, Fraction(3, 2)


class TimeGraph(MarkGraph):
    """Nodes of marks, and of all times since them."""

    def __init__(self, system: ClockSystem, events: Sequence[int], cells: int) -> None:
        super().__init__(system, events, cells)
        self.n, self.parts = len(system.f), self._parts()
        times: dict[int, list[Range]] = {}
        for mark, _, time in self.marks.following:
            times.setdefault(self.event(mark), []).append(time)
        self.until = {kind: hull(own) for kind, own in times.items()}

    def always(self) -> tuple[int, ...]:
        """Places of the nodes of all times."""
        return tuple(
            self.place("since", kind, part) for kind in self.until for part in self._reached(kind)
        )

    def _parts(self) -> list[Range]:
        """Parts of the time since a mark: equal ones at first, larger and larger ones on."""
        longest, unit = self.marks.longest, self.marks.unit
        first = min((x for x in (unit, longest) if x is not None), default=None)
        count = self.marks.cells
        parts = [] if unit is None or first is None else parts_of(first, count)
        start = first if parts and first is not None else Fraction(0)
        growth = [_LARGER**k for k in range(_PARTS_BEYOND)]
        if longest is None:
            width = start / count or Fraction(1)
        elif longest > start:
            width = (longest - start) / sum(growth)
        else:
            return parts or [NO_TIME]
        for factor in growth:
            parts.append((start, start + width * factor))
            start += width * factor
        return [*parts, (start, None)] if longest is None else parts

    def _reached(self, kind: int) -> list[int]:
        """Parts of the time until the next mark."""
        most = self.until[kind][1]
        return [k for k, (low, _) in enumerate(self.parts) if most is None or low < most or not k]

    def strategies(self, node: Node) -> list[Strategy]:
        """Strategies of a node."""
        match node:
            case Node("kind", (kind,)):
                return [tuple(passage(self.place("mark", x), None) for x in self._of_kind(kind))]
            case Node("aged_kind", (kind, sensor, cell)):
                return self._of_aged_kind(kind, sensor, cell)
            case Node("instant", (kind, part)):
                low = self.parts[part][0]
                own = self._at_time(kind, part - 1, (low, low))
                return [*own, *self._along(kind, part - 1, at_end=True)]
            case Node("since", (kind, part)):
                own = self._at_time(kind, part, self.parts[part])
                return [*own, *self._along(kind, part, at_end=False)]
            case Node("mark", (mark,)):
                return [*super().strategies(node), self._before(mark, NO_TIME)]
            case Node("sample", (mark, sensor, cell)):
                earlier = self._before(mark, self.cells[sensor][cell])
                return [*super().strategies(node), earlier]
        return super().strategies(node)

    def carried_of(self, kind: int, cell: int) -> int:
        """The cell that marks of a kind leave of the age of a sample."""
        return self.system.carried_age(self.marks.kinds[kind], cell)

    def _of_kind(self, kind: int) -> list[int]:
        return [mark for mark in self.preceding if self.event(mark) == kind]

    def _of_aged_kind(self, kind: int, sensor: int, cell: int) -> list[Strategy]:
        marks = [x for x in self._of_kind(kind) if (x, cell) in self.aged[sensor]]
        own = tuple(passage(self.place("aged", x, sensor, cell), None) for x in marks)
        return [own, (passage(self.place("kind", kind), None),)]

    def _before(self, mark: int, earlier: Range) -> Strategy:
        """The bounds of all parts in which a mark comes, or a time before it in a range."""
        times: dict[int, list[Range]] = {}
        for before in self._since(self.preceding[mark], earlier):
            times.setdefault(self.event(before.mark), []).append(before.time)
        return tuple(
            passage(self.place("since", kind, part), None)
            for kind, own in times.items()
            for part in self._met(kind, hull(own))
        )

    def _met(self, kind: int, time: Range) -> Iterator[int]:
        """Parts that a range of times meets; of two that meet at its first time the later one."""
        reached = self._reached(kind)
        for part in reached:
            low, high = self.parts[part]
            is_late = high is None or high > time[0] or part == reached[-1]
            if is_late and (time[1] is None or low <= time[1]):
                yield part

    def _along(self, kind: int, part: int, *, at_end: bool) -> list[Strategy]:
        """From the instant at which a part begins to all of it, or to its end."""
        low, high = self.parts[part]
        length = None if high is None else high - low
        time = (length, length) if at_end and length is not None else (Fraction(0), length)
        if part:
            own = passage(self.place("instant", kind, part), None, time)
        else:
            own = passage(self.place("kind", kind), kind, time)
        through = (self.place("since", kind, part),)
        return held(self.n, (own,), through, (True,) * self.n)

    def _at_time(self, kind: int, part: int, times: Range) -> Iterator[Strategy]:
        """Bounds at times in a part: from the mark on, or from a sensor's last sample."""
        yield (passage(self.place("kind", kind), kind, times),)
        for sensor in self.cells:
            own = [*self._silent(kind, sensor, times), *self._sampled(kind, sensor, part, times)]
            first = next(k for k in range(part + 1) if self._is_recent(sensor, k, times))
            through = tuple(self.place("since", kind, k) for k in range(first, part + 1))
            yield from held(self.n, tuple(own), through, self.system.touched(sensor))

    def _is_recent(self, sensor: int, part: int, times: Range) -> bool:
        """May the last sample, at some times, be in a part?"""
        high = self.parts[part][1]
        return high is None or times[0] - high <= self.system.gap(sensor)

    def _sampled(self, kind: int, sensor: int, part: int, times: Range) -> Iterator[Passage]:
        """From the last sample, which is after the mark."""
        for k in range(part + 1):
            time = less(times, self.parts[k])
            time = None if time is None else meet(time, (Fraction(0), self.system.gap(sensor)))
            if time is not None:
                yield passage(self.place("since", kind, k), self.sampled(sensor), time)

    def _silent(self, kind: int, sensor: int, times: Range) -> Iterator[Passage]:
        """From the mark, where there is no sample since."""
        for j in range(len(self.cells[sensor])):
            time = meet(times, self.silence(sensor, self.carried_of(kind, j)))
            if time is not None and any((x, j) in self.aged[sensor] for x in self._of_kind(kind)):
                yield passage(self.place("aged_kind", kind, sensor, j), kind, time)
