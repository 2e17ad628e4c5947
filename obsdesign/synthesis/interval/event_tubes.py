"""Certificates of widths for several clocks: tubes on finer and finer graphs."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import NewEntries
from lmi.bounds.graph_tube import Graph, prove_graph
from lmi.find.graph_tube import input_sizes, proposed_tubes
from lmi.time_budget import TimeBudget, ended_by_count
from obsdesign.analysis.interval.clock_system import ClockSystem
from obsdesign.analysis.interval.event_graph import MOST_CELLS, event_graph, homogeneous
from obsdesign.analysis.interval.late_system import LateSystem
from obsdesign.analysis.interval.turning_system import SizeSystem, TurningSystem, turns
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains

# parts of a sensor's longest gap, and of the shortest time between events: first and last
_FOR_STABILITY, _FOR_WIDTH = (1, 8), (8, 16)
# what every entry of a tube has beside what inputs make of it, relative to that
_ADDED = 1e-7


def event_certificates(gains: ClockedIntervalGains, budget: TimeBudget) -> dict[str, NewEntries]:
    """Certificates of `event_stability` and `event_width`, or the limits of their searches.

    Of `late_width` alone where the event's times are uncertain.

    None for several events, of which there is no graph.
    """
    if len(gains.events) > 1:
        return {}
    if any(event.time_error is not None for event in gains.events):
        return {"late_width": _late_certificate(gains, budget)}
    system, certificates = ClockSystem(gains), dict[str, NewEntries]()
    for name, ends in (("event_stability", _FOR_STABILITY), ("event_width", _FOR_WIDTH)):
        certificates[name] = _certificate(system, ends, name == "event_width", budget)
        if "tube" not in certificates[name]:
            break
    return certificates


def _late_certificate(gains: ClockedIntervalGains, budget: TimeBudget) -> NewEntries:
    """Certificate of `late_width`, or the limit of its search; empty where it is not to be had."""
    if not turns(gains):
        late = LateSystem(gains)
        return {} if late.reason_against() else _certificate(late, _FOR_WIDTH, True, budget)
    if TurningSystem(gains).reason_against():
        return {}
    size = SizeSystem(gains)
    sizes = _certificate(size, _FOR_WIDTH, True, budget)
    if "tube" not in sizes:
        return sizes
    nodes = event_graph(size, sizes["cells"], always=True)
    assert nodes is not None
    assert nodes.before is not None
    turning = TurningSystem(gains, tuple(sizes["tube"][nodes.before]))
    own = _certificate(turning, _FOR_WIDTH, True, budget)
    return own if "tube" not in own else {**own, "sizes": sizes}


def _certificate(
    system: ClockSystem, ends: tuple[int, int], always: bool, budget: TimeBudget
) -> NewEntries:
    """A tube that is proved, of the coarsest graph that has one, or the limit of the search.

    Cells are doubled up to the second end, or while a total lasts up to a longer one.
    """
    cells, most = ends[0], int(min(budget.scaled(ends[1]), MOST_CELLS))
    if not (system.gains.events and system.usable):  # cells are parts of what such sensors leave
        most = cells
    while cells <= most:
        nodes = event_graph(system, cells, always=always)
        assert nodes is not None
        graph = nodes.graph if always else homogeneous(nodes.graph)
        for tube in proposed_tubes(graph, _added(graph, always), budget):
            if prove_graph(graph, tube.tolist()).outcome == "proved":
                return {"cells": cells, "tube": tube.tolist()}
        if budget.remaining() < 0:
            return budget.ended()
        cells *= 2
    return {} if most == ends[0] else ended_by_count("cells", most)


def _added(graph: Graph, always: bool) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return _ADDED * input_sizes(graph) if always else np.ones(graph.n)
