"""The graph of entries and events on which widths of modes are bounded.

A node is a mark: an entry into a mode, or an event in it, with the time that every event is ago,
and at events also the entry, in cells. An event comes no sooner than its shortest time after the
last one of its name, and than the spacing after others, and need not come; a stay lasts as long as
stated. The time from one mark to the next is in a range that both leave (`Mark.until`), and all
that happens goes from mark to mark. Source: theorem of `lmi.bounds.graph_tube`, docs/modes.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import product

import numpy as np

from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.bounds.graph_tube import Graph, Least, Passage
from obsdesign.analysis.interval.marks import NO_TIME, Mark, Range, met, parts_of
from obsdesign.analysis.interval.passage_times import passage
from obsdesign.equations.boxes import image_box
from obsdesign.equations.clocks import EventGains
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.equations.modes import ModeSpan, SwitchedGains

MOST_CELLS = 64
# marks, and passages between them, of a graph that is proved
_MOST_NODES, _MOST_PASSAGES = 200, 2500
# cells of a shortest stay, in which a mode makes up for others: so many for each of an event's time
_FINER = 4
# the clock of the stay, beside those of events by their places
_STAY = -1


@dataclass(frozen=True)
class ModeSystem:
    """Width systems of all modes, exact, with their stays and events."""

    gains: SwitchedGains[IntervalGains]
    widths: tuple[WidthSystem, ...]

    @property
    def n(self) -> int:
        """Number of states."""
        return self.gains.gains[0].n

    @property
    def events(self) -> tuple[EventGains, ...]:
        """The events within modes."""
        return self.gains.events

    def stay(self, mode: int) -> Range:
        """(shortest, longest) stay in a mode."""
        low, high = self.gains.spans[mode].every.tolist()
        return Fraction(low), None if math.isinf(high) else Fraction(high)

    def shortest(self, event: int) -> Fraction:
        """Shortest time between two events of a name."""
        return Fraction(self.events[event].dwell_range[0])

    @property
    def spacing(self) -> Fraction:
        """Least time between two events of different names."""
        return Fraction(self.gains.spacing or 0.0)

    def entered(self, mode: int) -> Least:
        """What entry into a mode makes of the width."""
        own = self.widths[mode]
        if own.N is None or own.h is None:
            return Least(((exact(np.eye(self.n)), 0 * own.f),))
        return Least(((own.N, own.h),))

    def happened(self, event: int) -> Least:
        """What an event makes of the width."""
        own = self.events[event]
        lower, upper = image_box(*own.disturbance)
        h: Exact = exact(upper) - exact(lower)
        return Least(((abs(exact(own.G)), h),))

    @property
    def may_widen(self) -> bool:
        """May an event widen the bounds by its map, apart from what it adds?"""
        unit = np.eye(self.n)
        return any(bool((abs(event.G) > unit).any()) for event in self.events)


@dataclass(frozen=True)
class ModeGraph:
    """A graph, and where its nodes are: before entries into each mode, at all times in it.

    Both are without nodes for a mode that is not entered again and again.
    """

    graph: Graph
    entries: tuple[tuple[int, ...], ...]
    always: tuple[int | None, ...]


@dataclass(frozen=True)
class _Node:
    """A mark that leads into a mode or happens in it; event None: entry.

    The time since entry that is due at an entry is the stay in the mode before, whichever it is.
    """

    mode: int
    event: int | None
    mark: Mark


def mode_graph(system: ModeSystem, cells: int) -> ModeGraph | None:
    """The graph with so many cells in the shortest time of each event; None where too large."""
    builder = _Builder(system, cells)
    return None if builder.count > _MOST_NODES else builder.graph()


class _Builder:
    """Nodes of a system, and the passages between them."""

    def __init__(self, system: ModeSystem, cells: int) -> None:
        self.system, self.cells = system, cells
        self.modes = range(len(system.widths))
        self.events = range(len(system.events))
        self.following = _repeated(system.gains.spans, system.gains.following)

    @property
    def count(self) -> int:
        """How many marks there are at most."""
        ages = [len(self._ages(e)) for e in self.events]
        stays = sum(len(self._stay_cells(mode)) for mode in self.modes)
        return len(self.modes) * math.prod(ages) + stays * sum(
            math.prod(ages[:e] + ages[e + 1 :]) for e in self.events
        )

    def _ages(self, event: int) -> list[Range]:
        """Cells of the time since an event: until it may happen again, and beyond."""
        shortest = self.system.shortest(event)
        return [*parts_of(shortest, self.cells if shortest else 0), (shortest, None)]

    def _stay_cells(self, mode: int) -> list[Range]:
        """Cells of the time since entry: until the mode may end, and beyond."""
        shortest, longest = self.system.stay(mode)
        cells = parts_of(shortest, _FINER * self.cells)
        if longest is None:
            return [*cells, (shortest, None)]
        beyond = parts_of(longest - shortest, 1 if self._decays[mode] else self.cells)
        return cells + [(shortest + a, shortest + b) for a, b in beyond if b is not None]

    @cached_property
    def _decays(self) -> list[bool]:
        """Does the width decay in each mode? The longest stay matters little then."""
        flows = [to_float(own.W) for own in self.system.widths]
        return [bool((np.linalg.eigvals(W).real < 0).all()) for W in flows]

    def _nodes(self) -> Iterator[_Node]:
        """All marks that may be."""
        for mode in self.modes:
            for ages in product(*map(self._ages, self.events)):
                due = {_STAY: NO_TIME, **dict(enumerate(ages))}
                yield _Node(mode, None, Mark((_STAY,), due))
            name = self.system.gains.names[mode]
            for event in self.events:
                if not self.system.events[event].may_happen(name):
                    continue
                ready = (self.system.shortest(event), None)
                apart = (self.system.spacing, None)
                own = [[ready] if e == event else met(self._ages(e), apart) for e in self.events]
                for stay, ages in product(self._stay_cells(mode), product(*own)):
                    due = {_STAY: stay, **dict(enumerate(ages))}
                    yield _Node(mode, event, Mark((event,), due))

    def _until(self, first: _Node, second: _Node) -> Range | None:
        """Times from a mark to the next, if it may be that one."""
        if second.event is not None:
            return first.mark.until(second.mark) if second.mode == first.mode else None
        if second.mode not in self.following[first.mode]:
            return None
        due = {**second.mark.due, _STAY: self.system.stay(first.mode)}
        return first.mark.until(replace(second.mark, due=due))

    def graph(self) -> ModeGraph | None:
        """Nodes that have one before them, and so on; then those of all times in each mode.

        None where there are too many passages between them.
        """
        nodes = list(self._nodes())
        pairs = [
            (x, y, time)
            for x, one in enumerate(nodes)
            for y, two in enumerate(nodes)
            if (time := self._until(one, two)) is not None
        ]
        while True:
            reached = {y for _, y, _ in pairs}
            kept = [pair for pair in pairs if pair[0] in reached]
            if len(kept) == len(pairs):
                break
            pairs = kept
        if len(pairs) > _MOST_PASSAGES:
            return None
        places = {node: place for place, node in enumerate(sorted(reached))}
        passages: list[list[Passage]] = [[] for _ in places]
        for x, y, time in pairs:
            passages[places[y]].append(self._passage(nodes[x], places[x], time))
        always: list[int | None] = []
        for mode in self.modes:
            own = [self._passage(nodes[x], place, self._rest(nodes[x]))
                   for x, place in places.items() if nodes[x].mode == mode]  # fmt: skip
            always.append(len(passages) if own else None)
            passages += [own] if own else []
        entries = tuple(
            tuple(p for x, p in places.items() if nodes[x].event is None and nodes[x].mode == mode)
            for mode in self.modes
        )
        flows = tuple((own.W, own.f) for own in self.system.widths)
        maps = [self.system.entered(mode) for mode in self.modes]
        maps += [self.system.happened(event) for event in self.events]
        whole = tuple((tuple(own),) for own in passages)
        return ModeGraph(
            Graph(flows, tuple((own,) for own in maps), whole), entries, tuple(always)
        )  # fmt: skip

    def _passage(self, source: _Node, place: int, time: Range) -> Passage:
        """From a mark on, in its mode."""
        own = source.mode if source.event is None else len(self.modes) + source.event
        return replace(passage(place, own, time), flow=source.mode)

    def _rest(self, node: _Node) -> Range:
        """Times until the mode that a mark leads into, or is in, has ended."""
        longest = self.system.stay(node.mode)[1]
        passed = node.mark.passed[_STAY][0]
        return Fraction(0), None if longest is None else longest - passed


def _repeated(
    spans: Sequence[ModeSpan], following: tuple[tuple[int, ...], ...]
) -> list[tuple[int, ...]]:
    """What follows each mode; a mode that may last, and is not entered again, follows itself.

    It is what the width comes to in a last stay: that of stays without end.
    """
    entered = set(range(len(spans)))
    while entered != (reached := {j for i in entered for j in following[i]} & entered):
        entered = reached
    return [
        (*after, k) if math.isinf(spans[k].every[1]) and k not in entered else tuple(after)
        for k, after in enumerate(following)
    ]
