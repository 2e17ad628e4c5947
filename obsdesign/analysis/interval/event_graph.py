"""The graph on which widths of an interval observer for several clocks are bounded.

Source: docs/interval.md. Samples that are not used only make the bound wider, so that any choice of
them bounds the width, also one that the future decides on.

Without events one node, all times: of a sensor that is silent for at most g some sample is at most
g old. With one event, T1 to T2 after the last one: node 0 just before it; nodes of the last sample
before it, by its distance, in `cells` equal parts of [0, g]; and for widths at all times nodes of
the time since the event: instants, and the parts between them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, pairwise

import numpy as np

from lmi.arithmetic.balls import to_float
from lmi.bounds.graph_tube import Graph, Least, Passage, Strategy
from obsdesign.analysis.interval.clock_system import ClockSystem

# parts of the time since an event beyond its shortest time, each larger than the one before
_PARTS_BEYOND, _LARGER = 8, 1.5
# bits of the length of the shortest part of the time since an event
_BITS = 20
MOST_CELLS = 256


@dataclass(frozen=True)
class Cells:
    """Ends of the parts of a range, rationals; the last may be infinite (None)."""

    ends: tuple[Fraction | None, ...]

    def __len__(self) -> int:
        return len(self.ends) - 1

    def pairs(self) -> Iterator[tuple[Fraction, Fraction | None]]:
        """(low, high) of each."""
        for low, high in zip(self.ends, self.ends[1:], strict=False):
            assert low is not None
            yield low, high


@dataclass(frozen=True)
class EventGraph:
    """A graph and where its nodes are; before: of the event, always: of all times, in parts."""

    graph: Graph
    before: int | None
    always: tuple[int, ...]


def event_graph(system: ClockSystem, cells: int, *, always: bool) -> EventGraph | None:
    """The graph of a system; None where there are several events.

    always: with nodes of all times, else of what stability takes. cells: parts of a gap.
    """
    if len(system.gains.events) > 1:
        return None
    return _Builder(system, cells).with_event(always) if system.gains.events else _still(system)


def homogeneous(graph: Graph) -> Graph:
    """The same without inputs."""
    events = tuple(
        tuple(Least(tuple((N, 0 * k) for N, k in stage.maps)) for stage in stages)
        for stages in graph.events
    )
    return Graph(graph.W, 0 * graph.f, events, graph.nodes)


def _still(system: ClockSystem) -> EventGraph:
    """One node: all times of a plant without events."""
    n, events = len(system.f), [(system.sampled(k),) for k in system.counted]
    strategies: list[Strategy] = []
    for place, sensor in enumerate(system.counted):
        ends = [(0, place, 0.0, _up(system.gap(sensor)))]
        strategies += _held(n, (0,), ends, system.touched(sensor))
    diagonal = -np.diag(to_float(system.W))
    spans = [float(system.gap(k)) for k in system.counted] + (1 / diagonal[diagonal > 0]).tolist()
    span = 2.0 ** math.ceil(math.log2(max(spans, default=1.0)))
    strategies += _held(n, (0,), [(0, None, span, span)], (True,) * n)
    graph = Graph(system.W, system.f, tuple(events), (tuple(strategies),))
    return EventGraph(graph, None, (0,))


def _held(
    n: int, through: tuple[int, ...], ends: Sequence[tuple[int, int | None, float, float]],
    touched: tuple[bool, ...],
) -> list[Strategy]:  # fmt: skip
    """A strategy where all states flow, and for each state one where the others are held.

    touched: states that it bounds: of the others it says what holds already.
    """
    silent = None if all(touched) else tuple(not one for one in touched)
    strategies = [tuple(Passage(*each, silent=silent) for each in ends)]
    for i in np.flatnonzero(touched) if n > 1 else ():
        held = tuple(j != i for j in range(n))
        strategies.append(tuple(Passage(*each, held=held, through=through) for each in ends))
    return strategies


class _Builder:
    """Nodes of a plant with one event: 0 before it, of the last samples, of the time since it."""

    def __init__(self, system: ClockSystem, cells: int) -> None:
        self.system, self.cells, self.n = system, cells, len(system.f)
        shortest, longest = system.dwell
        self.shortest = Fraction(shortest)
        self.longest = None if math.isinf(longest) else Fraction(longest)
        self.nodes: list[list[Strategy]] = [[(self._since(self.shortest, self.longest),)]]
        self.distances = {k: self._distances(k) for k in system.usable}

    def with_event(self, always: bool) -> EventGraph:
        """The graph; always: with nodes of the time since the event."""
        first = {sensor: self._last_samples(sensor) for sensor in self.system.usable}
        for sensor, places in first.items():
            self.nodes[0].append(self._to_event(sensor, places))
        for pair in combinations(self.system.usable, 2):
            self.nodes[0].append(
                tuple(
                    passage
                    for order in (pair, pair[::-1])
                    for passage in self._to_event(order[1], self._second(order, first))
                )
            )
        parts = self._parts(first) if always else ()
        events = [self.system.happened(0), *((self.system.sampled(k),) for k in self.system.usable)]
        nodes = tuple(map(tuple, self.nodes))
        return EventGraph(Graph(self.system.W, self.system.f, tuple(events), nodes), 0, parts)

    def _event_of(self, sensor: int) -> int:
        return 1 + self.system.usable.index(sensor)

    def _distances(self, sensor: int) -> Cells:
        gap = self.system.gap(sensor)
        return Cells(tuple(gap * i / self.cells for i in range(self.cells + 1)))

    def _since(self, low: Fraction, high: Fraction | None) -> Passage:
        """From the event on."""
        return Passage(0, 0, _down(max(low, Fraction(0))), _up(high))

    def _last_samples(self, sensor: int) -> list[int]:
        """Nodes just before the last sample of a sensor before the event."""
        places = []
        for low, high in self.distances[sensor].pairs():
            assert high is not None
            latest = None if self.longest is None else self.longest - low
            places.append(len(self.nodes))
            self.nodes.append([(self._since(self.shortest - high, latest),)])
        return places

    def _to_event(self, sensor: int, places: Sequence[int | None]) -> Strategy:
        """From the last sample, of a sensor, to the event; None: no such sample."""
        event = self._event_of(sensor)
        ends = zip(places, self.distances[sensor].pairs(), strict=True)
        return tuple(
            Passage(place, event, _down(low), _up(high))
            for place, (low, high) in ends
            if place is not None
        )

    def _second(self, pair: tuple[int, ...], first: dict[int, list[int]]) -> list[int | None]:
        """Nodes just before the last sample of the second sensor, that of the first one used.

        None where it is so long before the event that the first one's comes after it.
        """
        one, two = pair
        places: list[int | None] = []
        for low, high in self.distances[two].pairs():
            assert high is not None
            strategy = tuple(
                Passage(place, self._event_of(one), _down(max(a - high, Fraction(0))), _up(b - low))
                for place, (a, b) in zip(first[one], self.distances[one].pairs(), strict=True)
                if b is not None and b >= low
            )
            places.append(len(self.nodes) if strategy else None)
            self.nodes += [[strategy]] if strategy else []
        return places

    def _parts(self, first: dict[int, list[int]]) -> tuple[int, ...]:
        """Nodes of all times, by the time since the event: instants between parts, then parts."""
        parts = self._clock()
        instants = range(len(self.nodes), len(self.nodes) + len(parts) - 1)
        places = range(instants.stop, instants.stop + len(parts))
        for part, (low, _) in enumerate(parts.pairs()):
            if part:
                self.nodes.append(list(self._at_time(parts, places, part - 1, (low, low))))
                self.nodes[-1] += self._along(parts, instants, places, part - 1, at_end=True)
        for part, (low, high) in enumerate(parts.pairs()):
            self.nodes.append(list(self._at_time(parts, places, part, (low, high))))
            self.nodes[-1] += self._along(parts, instants, places, part, at_end=False)
        self.nodes[0].append(_overlapping(places, parts, self.shortest, self.longest))
        for sensor, nodes in first.items():
            for node, (low, high) in zip(nodes, self.distances[sensor].pairs(), strict=True):
                assert high is not None
                latest = None if self.longest is None else self.longest - low
                self.nodes[node].append(_overlapping(places, parts, self.shortest - high, latest))
        return tuple(places)

    def _along(
        self, parts: Cells, instants: range, places: range, part: int, *, at_end: bool
    ) -> list[Strategy]:
        """From the instant at which a part begins to all of it, or to its end."""
        low, high = list(parts.pairs())[part]
        length = math.inf if high is None else _up(high - low)
        least = _down(high - low) if at_end and high is not None else 0.0
        source, event = (instants[part - 1], None) if part else (0, 0)
        return _held(self.n, (places[part],), [(source, event, least, length)], (True,) * self.n)

    def _clock(self) -> Cells:
        """Parts of the time since the event: equal ones up to its shortest time, larger ones on."""
        ends: list[Fraction | None] = [
            self.shortest * i / self.cells for i in range(self.cells + 1)
        ] if self.shortest else [Fraction(0)]  # fmt: skip
        beyond = _PARTS_BEYOND
        if self.longest is None:
            width = self.shortest / self.cells or Fraction(1)
            for _ in range(beyond):
                ends.append((ends[-1] or Fraction(0)) + width)
                width *= Fraction(_LARGER)
            ends.append(None)
        elif self.longest > self.shortest:
            total = sum(Fraction(_LARGER) ** k for k in range(beyond))
            width = (self.longest - self.shortest) / total
            for _ in range(beyond - 1):
                ends.append((ends[-1] or Fraction(0)) + width)
                width *= Fraction(_LARGER)
            ends.append(self.longest)
        return Cells(_short(ends, self.shortest) if len(ends) > 1 else (Fraction(0), Fraction(0)))

    def _at_time(
        self, parts: Cells, places: range, part: int, times: tuple[Fraction, Fraction | None]
    ) -> Iterator[Strategy]:
        """Bounds in a part or at its end: from the event on, or from a sensor's last sample."""
        low, high = times
        yield (self._since(low, high),)
        for sensor in self.system.usable:
            gap, event = self.system.gap(sensor), self._event_of(sensor)
            ends: list[tuple[int, int | None, float, float]] = []
            for place, (a, b) in enumerate(parts.pairs()):
                if place > part or (b is not None and low - b > gap):
                    continue
                least = Fraction(0) if b is None else max(low - b, Fraction(0))
                most = gap if high is None else min(gap, high - a)
                ends.append((places[place], event, _down(least), _up(most)))
            most = gap if high is None else min(gap, high)
            since = [] if low > gap else [(0, 0, _down(low), _up(most))]
            through = tuple(range(ends[0][0], places[part] + 1))
            yield from _held(self.n, through, [*since, *ends], self.system.touched(sensor))


def _short(ends: Sequence[Fraction | None], stated: Fraction) -> tuple[Fraction | None, ...]:
    """The ends, those inside moved to short binary fractions but for one that is stated.

    The lengths of parts are floats then.

    A passage of one time alone, rounded outward, would be a range that no proof can divide.
    """
    widths = [b - a for a, b in pairwise([end for end in ends if end is not None])]
    unit = Fraction(2) ** (math.frexp(min(widths, default=Fraction(1)))[1] - _BITS)
    inside = [
        end if end is None or end == stated else round(end / unit) * unit for end in ends[1:-1]
    ]
    return (ends[0], *inside, ends[-1])


def _overlapping(
    places: Sequence[int], parts: Cells, low: Fraction, high: Fraction | None
) -> Strategy:
    """The bounds of all parts that a range of times since the event meets.

    Of two parts that meet at its first time the later one holds that time too.
    """
    return tuple(
        Passage(place, None, 0.0, 0.0)
        for place, (a, b) in zip(places, parts.pairs(), strict=True)
        if (b is None or b > low or b == parts.ends[-1]) and (high is None or a <= high)
    )


def _down(value: Fraction) -> float:
    """The largest float at most as large."""
    near = float(value)
    return math.nextafter(near, -math.inf) if Fraction(near) > value else near


def _up(value: Fraction | None) -> float:
    """The least float at least as large; infinite for None."""
    if value is None:
        return math.inf
    near = float(value)
    return math.nextafter(near, math.inf) if Fraction(near) < value else near
