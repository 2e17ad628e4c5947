"""The graph on which widths of an interval observer for several clocks are bounded.

Source: docs/interval.md. Samples that are not used only make the bound wider, so that any choice of
them bounds the width, also one that the future decides on.

Without events one node, all times: of a sensor that is silent for at most g some sample is at most
g old. With events, nodes of marks (`mark_graph`), and for widths at all times nodes of the time
since the last one (`time_graph`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from lmi.arithmetic.balls import to_float
from lmi.bounds.graph_tube import Graph, Strategy
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.analysis.interval.mark_graph import MarkGraph
from obsdesign.analysis.interval.passage_times import held, passage
from obsdesign.analysis.interval.tick_graph import TickGraph

MOST_CELLS = 256
LARGEST_GRAPH = 3000


@dataclass(frozen=True)
class MarkNode:
    """A node just before events, by place, and the place of what they do in the graph."""

    node: int
    events: tuple[int, ...]
    place: int


@dataclass(frozen=True)
class EventGraph:
    """A graph and where its nodes are; always: of all times, in parts."""

    graph: Graph
    marks: tuple[MarkNode, ...]
    always: tuple[int, ...]


def width_graph(
    system: ClockSystem, cells: int, most: float = LARGEST_GRAPH
) -> EventGraph | None:  # fmt: skip
    """The graph of widths at all times; None where it would have more than `most` nodes.

    cells: parts of a gap, and of the shortest time between two events of a name.
    """
    events = range(len(system.gains.events))
    if not events:
        return _still(system)
    builder = TickGraph(system, events, cells)
    return _whole(builder, most)


def stability_graph(
    system: ClockSystem, cells: int, most: float = LARGEST_GRAPH
) -> EventGraph | None:  # fmt: skip
    """The graph of widths without inputs, at marks; otherwise as `width_graph`.

    Only events that count are in it.
    """
    events = [e for e in range(len(system.gains.events)) if system.counts(e)]
    whole = _whole(MarkGraph(system, events, cells), most) if events else _still(system)
    return None if whole is None else replace(whole, graph=whole.graph.without_inputs())


def _whole(builder: MarkGraph, most: float) -> EventGraph | None:
    """What a builder builds; None where it would be too large."""
    graph = builder.graph(most) if builder.preceding else None
    if graph is None:
        return None
    marks = tuple(
        MarkNode(builder.place("mark", mark), builder.marks.marks[mark].events, builder.event(mark))
        for mark in builder.preceding
    )
    return EventGraph(graph, marks, builder.always() if isinstance(builder, TickGraph) else ())


def _still(system: ClockSystem) -> EventGraph:
    """One node: all times of a plant without events."""
    n, events = len(system.f), [(system.sampled(k),) for k in system.counted]
    strategies: list[Strategy] = []
    for place, sensor in enumerate(system.counted):
        own = passage(0, place, (Fraction(0), system.gap(sensor)))
        strategies += held(n, (own,), (0,), system.touched(sensor))
    diagonal = -np.diag(to_float(system.W))
    spans = [float(system.gap(k)) for k in system.counted] + (1 / diagonal[diagonal > 0]).tolist()
    span = Fraction(2.0 ** math.ceil(math.log2(max(spans, default=1.0))))
    strategies += held(n, (passage(0, None, (span, span)),), (0,), (True,) * n)
    graph = Graph(((system.W, system.f),), tuple(events), (tuple(strategies),))
    return EventGraph(graph, (), (0,))
