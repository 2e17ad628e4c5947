"""Certificates of widths for several clocks: tubes on finer and finer graphs."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import NewEntries
from lmi.bounds.graph_tube import Graph, prove_graph
from lmi.bounds.step_tube import prove_steps
from lmi.find.graph_tube import input_sizes, proposed_tubes
from lmi.find.step_tube import proposed_step_tubes, step_input_sizes
from lmi.time_budget import TimeBudget, ended_by_count
from obsdesign.analysis.interval.clock_system import ClockSystem
from obsdesign.analysis.interval.event_graph import MOST_CELLS, event_graph, homogeneous
from obsdesign.analysis.interval.step_graph import step_graph
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains

# parts of a sensor's longest gap, and of the shortest time between events: first and last
_FOR_STABILITY, _FOR_WIDTH = (1, 8), (8, 16)
# what every entry of a tube has beside what inputs make of it, relative to that
_ADDED, _ADDED_TO_STEPS = 1e-7, 1e-11


def event_certificates(gains: ClockedIntervalGains, budget: TimeBudget) -> dict[str, NewEntries]:
    """Certificates of `event_stability` and `event_width`, or the limits of their searches.

    None for several events, of which there is no graph.
    """
    if gains.dt is not None:
        return step_certificates(gains, budget)
    if len(gains.events) > 1:
        return {}
    system, certificates = ClockSystem(gains), dict[str, NewEntries]()
    for name, ends in (("event_stability", _FOR_STABILITY), ("event_width", _FOR_WIDTH)):
        certificates[name] = _certificate(system, ends, name == "event_width", budget)
        if "tube" not in certificates[name]:
            break
    return certificates


def step_certificates(gains: ClockedIntervalGains, budget: TimeBudget) -> dict[str, NewEntries]:
    """The same in discrete time, where the ages of all clocks are whole numbers."""
    graph = step_graph(ClockSystem(gains))
    if isinstance(graph, str):
        return {}
    still, certificates = graph.without_inputs(), dict[str, NewEntries]()
    sizes = _ADDED_TO_STEPS * step_input_sizes(graph)
    for name, own, added in (
        ("event_stability", still, np.ones(graph.n)), ("event_width", graph, sizes),
    ):  # fmt: skip
        tubes = (tube.tolist() for tube in proposed_step_tubes(own, added, budget))
        certificate = next((x for x in tubes if prove_steps(own, x).outcome == "proved"), None)
        if certificate is None:
            break
        certificates[name] = {"tube": certificate}
    return certificates


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
