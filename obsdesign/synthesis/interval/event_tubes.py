"""Certificates of widths for several clocks: tubes on finer and finer graphs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from lmi.bounds.graph_tube import Graph, prove_graph
from lmi.find.graph_tube import input_sizes, proposed_tubes
from lmi.time_budget import TimeBudget, ended_by_count
from obsdesign.analysis.interval.clock_system import ClockSystem
from obsdesign.analysis.interval.event_graph import (
    MOST_CELLS,
    MOST_NODES,
    EventGraph,
    stability_graph,
    width_graph,
)
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains

# parts of a sensor's longest gap, and of the shortest time between events: first and last
_FOR_STABILITY, _FOR_WIDTH = (1, 8), (8, 16)
# nodes of the first graph for widths, whose cells are fewer where several events need more
_FIRST_NODES = 400
# nodes of any graph, but for a total that lasts
_MOST_NODES = 800
# what every entry of a tube has beside what inputs make of it, relative to that
_ADDED = 1e-7


def event_certificates(gains: ClockedIntervalGains, budget: TimeBudget) -> dict[str, NewEntries]:
    """Certificates of `event_stability` and `event_width`, or the limits of their searches."""
    system = ClockSystem(gains)
    first, most = _FOR_STABILITY
    stability = _certificate(system, stability_graph, (first, most), budget)
    if "tube" not in stability:
        return {"event_stability": stability}
    width = _certificate(system, width_graph, (_first_cells(system), _FOR_WIDTH[1]), budget)
    return {"event_stability": stability, "event_width": width}


def _first_cells(system: ClockSystem) -> int:
    """Cells of the first graph for widths: as many as leave it of a moderate size."""
    cells = _FOR_WIDTH[0]
    while cells > 1 and width_graph(system, cells, _FIRST_NODES) is None:
        cells //= 2
    return cells


def _certificate(
    system: ClockSystem,
    graph_of: Callable[[ClockSystem, int, float], EventGraph | None],
    ends: tuple[int, int],
    budget: TimeBudget,
) -> NewEntries:
    """A tube that is proved, of the coarsest graph that has one, or the limit of the search.

    Cells are doubled up to the second end, or while a total lasts up to a longer one.
    """
    cells, most = ends[0], int(min(budget.scaled(ends[1]), MOST_CELLS))
    if not system.gains.events:  # cells are parts of what events leave
        most = cells
    nodes_limit = min(budget.scaled(_MOST_NODES), MOST_NODES)
    while cells <= most and (nodes := graph_of(system, cells, nodes_limit)) is not None:
        for tube in proposed_tubes(nodes.graph, _added(nodes.graph), budget):
            if prove_graph(nodes.graph, tube.tolist()).outcome == "proved":
                return {"cells": cells, "tube": tube.tolist()}
        if budget.remaining() < 0:
            return budget.ended()
        cells *= 2
    return {} if most == ends[0] else ended_by_count("cells", cells // 2)


def _added(graph: Graph) -> Matrix:
    """What every entry of a tube has at least; of any size where there are no inputs."""
    has_inputs = any(graph.f) or any(
        any(k) for stages in graph.events for stage in stages for _, k in stage.maps
    )
    return _ADDED * input_sizes(graph) if has_inputs else np.ones(graph.n)
