"""The graph of a plant with events: bounds before marks, by the last samples before them.

Nodes, each with the instants that it stands for:

    mark Y          just before the mark Y
    aged Y, s, i    the same where the last sample of sensor s is in cell i of its longest gap ago
    own Y, s, i     the same, by what this sensor alone comes to
    sample Y, s, i  just before that sample, where it is after the mark before Y
    both Y, r, s, i the same, by the last sample of another sensor r, where that is before it
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain, combinations
from typing import NamedTuple

from lmi.bounds.graph_tube import Graph, Passage, Strategy
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.analysis.interval.marks import NO_TIME, Marks, Range, less, meet, parts_of
from obsdesign.analysis.interval.passage_times import passage


class Node(NamedTuple):
    """Address of a node: its sort, and places of marks or kinds, sensors, cells."""

    sort: str
    places: tuple[int, ...]


@dataclass(frozen=True)
class Preceding:
    """A mark that another one may follow after `time`."""

    mark: int
    time: Range


class MarkGraph:
    """Nodes of marks of a system, made as passages lead from them.

    events: those that count, by place; cells: parts of a gap, and as of `Marks`.
    """

    def __init__(self, system: ClockSystem, events: Sequence[int], cells: int) -> None:
        self.system, self.marks = system, Marks(system, events, cells)
        self.cells = {k: self._gap_cells(k) for k in system.counted}
        # times in which an age grows from one cell to another
        self.grown = {
            k: [[less(later, own) for later in cells] for own in cells]
            for k, cells in self.cells.items()
        }
        self.preceding: dict[int, list[Preceding]] = {}
        for before, mark, time in self.marks.following:
            self.preceding.setdefault(mark, []).append(Preceding(before, time))
        self.aged = {sensor: set(self._aged(sensor)) for sensor in self.cells}
        self.places: dict[Node, int] = {}

    def _gap_cells(self, sensor: int) -> list[Range]:
        """Cells of the time since a sample, as short as those of the time since an event."""
        gap = self.system.gap(sensor)
        unit = min(gap, self.marks.unit or gap)
        return parts_of(gap, self.marks.count_of(gap, unit))

    def _aged(self, sensor: int) -> Iterator[tuple[int, int]]:
        """(mark, cell) that may be: the last sample after the mark before, or before that too."""
        cells, reached = self.cells[sensor], list[tuple[int, int]]()
        for mark, before in self.preceding.items():
            times = {each.time for each in before}
            reached += [(mark, i) for i, cell in enumerate(cells) if _any_left(times, cell)]
        known = set(reached)
        following: dict[int, list[tuple[int, Range]]] = {}
        for before_mark, mark, time in self.marks.following:
            following.setdefault(before_mark, []).append((mark, time))
        while reached:
            mark, j = reached.pop()
            yield mark, j
            for after, time in following.get(mark, []):
                for i in range(len(cells)):
                    if (after, i) not in known and self._kept(sensor, mark, (j, i), time):
                        known.add((after, i))
                        reached.append((after, i))

    def _since(self, before: list[Preceding], cell: Range) -> list[Preceding]:
        """Marks before one, and the time from each to a sample in a cell before that one."""
        times = [(each.mark, less(each.time, cell)) for each in before]
        return [Preceding(mark, time) for mark, time in times if time is not None]

    def _kept(self, sensor: int, mark: int, cells: tuple[int, int], time: Range) -> Range | None:
        """Time from a mark to the next by which the age of a sample goes from cell to cell."""
        grown = self.grown[sensor][self.carried(mark, cells[0])][cells[1]]
        return None if grown is None else meet(time, grown)

    def carried(self, mark: int, cell: int) -> int:
        """The cell that a mark leaves of the age of a sample."""
        return self.system.carried_age(self.marks.marks[mark].events, cell)

    def silence(self, sensor: int, cell: int) -> Range:
        """Times until the next sample of a sensor, where the age of the last one is in a cell."""
        return Fraction(0), self.system.gap(sensor) - self.cells[sensor][cell][0]

    def place(self, sort: str, *places: int) -> int:
        """The place of a node, which is made if it is new."""
        return self.places.setdefault(Node(sort, places), len(self.places))

    def event(self, mark: int) -> int:
        """The place of a mark's kind among the events of the graph."""
        return self.marks.kinds.index(self.marks.marks[mark].events)

    def sampled(self, sensor: int) -> int:
        """The place of a sensor's sample among the events of the graph."""
        return len(self.marks.kinds) + self.system.counted.index(sensor)

    def graph(self, most: float) -> Graph | None:
        """All nodes that passages lead from, the marks first; None where they are more."""
        for mark in self.preceding:
            self.place("mark", mark)
        nodes: list[list[Strategy]] = []
        while len(nodes) < len(self.places):
            if len(self.places) > most:
                return None
            node = list(self.places)[len(nodes)]
            nodes.append([each for each in self.strategies(node) if each])
        events = [self.system.happened(kind) for kind in self.marks.kinds]
        events += [(self.system.sampled(k),) for k in self.system.counted]
        flow = (self.system.W, self.system.f)
        return Graph((flow,), tuple(events), tuple(map(tuple, nodes)))

    def strategies(self, node: Node) -> list[Strategy]:
        """Strategies of a node."""
        match node:
            case Node("mark", (mark,)):
                return self._of_mark(mark)
            case Node("aged", (mark, sensor, cell)):
                return self._of_aged(mark, sensor, cell)
            case Node("own", (mark, sensor, cell)):
                return self._of_own(mark, sensor, cell)
            case Node("sample", (mark, sensor, cell)):
                before = self._since(self.preceding[mark], self.cells[sensor][cell])
                return [tuple(self._after(x) for x in before)]
            case Node("both", (mark, first, last, cell)):
                return [tuple(self._of_both(mark, first, last, cell))]
        raise ValueError(f"no node {node}")

    def _after(self, before: Preceding) -> Passage:
        """From a mark on."""
        return passage(self.place("mark", before.mark), self.event(before.mark), before.time)

    def _of_mark(self, mark: int) -> list[Strategy]:
        strategies = [self._direct(mark)]
        strategies += [self._whatever_age("aged", mark, sensor) for sensor in self.cells]
        for first, second in combinations(self.cells, 2):
            orders = (
                self._last_of_both(mark, first, second),
                self._last_of_both(mark, second, first),
            )
            strategies.append(tuple(chain(*orders)))
        return strategies

    def _direct(self, mark: int) -> Strategy:
        """From the mark before, whatever is sampled between."""
        return tuple(self._after(before) for before in self.preceding[mark])

    def _whatever_age(self, sort: str, mark: int, sensor: int) -> Strategy:
        """The bounds of a mark for all ages of the last sample of a sensor."""
        ages = [i for i in range(len(self.cells[sensor])) if (mark, i) in self.aged[sensor]]
        return tuple(passage(self.place(sort, mark, sensor, i), None) for i in ages)

    def _of_aged(self, mark: int, sensor: int, cell: int) -> list[Strategy]:
        others = [k for k in self.cells if k != sensor]
        if not others:
            return self._of_own(mark, sensor, cell)
        own = passage(self.place("own", mark, sensor, cell), None)
        return [(own,), *(self._whatever_age("own", mark, k) for k in others)]

    def _of_own(self, mark: int, sensor: int, cell: int) -> list[Strategy]:
        return [tuple(self._from_sample(mark, sensor, cell)), self._direct(mark)]

    def _from_sample(self, mark: int, sensor: int, cell: int) -> Iterator[Passage]:
        """From the last sample, which is after the mark before, or before that too."""
        cells = self.cells[sensor]
        if self._since(self.preceding[mark], cells[cell]):
            sample = self.place("sample", mark, sensor, cell)
            yield passage(sample, self.sampled(sensor), cells[cell])
        for before in self.preceding[mark]:
            for j in range(len(cells)):
                time = self._kept(sensor, before.mark, (j, cell), before.time)
                if time is not None and (before.mark, j) in self.aged[sensor]:
                    source = self.place("aged", before.mark, sensor, j)
                    yield passage(source, self.event(before.mark), time)

    def _last_of_both(self, mark: int, first: int, last: int) -> Iterator[Passage]:
        """From the last samples of two sensors to a mark, where that of `last` is the later one.

        Of samples before the mark before, the age of the later one is enough.
        """
        for i, cell in enumerate(self.cells[last]):
            if any(True for _ in self._of_both(mark, first, last, i)):
                yield passage(self.place("both", mark, first, last, i), self.sampled(last), cell)
        yield from self._unsampled(mark, last, NO_TIME)

    def _of_both(self, mark: int, first: int, last: int, cell: int) -> Iterator[Passage]:
        """To the last sample of `last` before a mark, from that of `first`, which is before it."""
        own = self.cells[last][cell]
        if not self._since(self.preceding[mark], own):
            return
        for k, age in enumerate(self.cells[first]):
            time = less(age, own)
            if time is not None and self._since(self.preceding[mark], age):
                yield passage(self.place("sample", mark, first, k), self.sampled(first), time)
        yield from self._unsampled(mark, first, own)

    def _unsampled(self, mark: int, sensor: int, earlier: Range) -> Iterator[Passage]:
        """To a time before a mark, in a range, from marks since which a sensor was silent."""
        for before in self.preceding[mark]:
            for j in range(len(self.cells[sensor])):
                since = meet(before.time, self.silence(sensor, self.carried(before.mark, j)))
                time = None if since is None else less(since, earlier)
                if time is not None and (before.mark, j) in self.aged[sensor]:
                    source = self.place("aged", before.mark, sensor, j)
                    yield passage(source, self.event(before.mark), time)


def _any_left(times: Iterable[Range], cell: Range) -> bool:
    """May a sample in a cell before a mark be after the mark before, one of some times ago?"""
    return any(less(time, cell) is not None for time in times)
