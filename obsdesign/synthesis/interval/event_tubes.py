"""Certificates of widths for several clocks: tubes on finer and finer graphs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from lmi.bounds.graph_proof import prove_graph
from lmi.bounds.graph_tube import Graph
from lmi.bounds.step_tube import prove_steps
from lmi.find.graph_tube import input_sizes, proposed_tubes
from lmi.find.step_tube import proposed_step_tubes, step_input_sizes
from lmi.time_budget import TimeBudget, ended_by_count
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.analysis.interval.event_graph import (
    LARGEST_GRAPH,
    MOST_CELLS,
    EventGraph,
    stability_graph,
    width_graph,
)
from obsdesign.analysis.interval.step_graph import step_graph
from obsdesign.analysis.interval.uncertain_widths import reason_against_events
from obsdesign.analysis.interval.uncertain_widths_additive import UncertainAdditiveSystem
from obsdesign.analysis.interval.uncertain_widths_general import (
    SizeSystem,
    UncertainGeneralSystem,
    turns,
)
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains

# parts of a sensor's longest gap, and of the shortest time between events: first and last
_CELLS_OF_STABILITY, _CELLS_OF_LATE_WIDTH = (1, 8), (8, 16)
# last of event_width; the first are these too, or fewer where the first graph has too many nodes
_LAST_CELLS_OF_WIDTH, _NODES_OF_FIRST_GRAPH = 16, 400
# nodes of any graph that is searched, but for a total that lasts
_NODES_SEARCHED = 800
# sensors of which every subset is tried where all of them have no tube
_MOST_SENSORS = 4
# what every entry of a tube has beside what inputs make of it, relative to that
_ADDED, _ADDED_TO_STEPS = 1e-7, 1e-11


def event_certificates(gains: ClockedIntervalGains, budget: TimeBudget) -> dict[str, NewEntries]:
    """Certificates of `event_stability` and `event_width`, or the limits of their searches."""
    if gains.dt is not None:
        return step_certificates(gains, budget)
    if any(event.time_error is not None for event in gains.events):
        return {"late_width": _uncertain_certificate(gains, budget)}
    system = ClockSystem(gains)
    stability = _certificate(system, stability_graph, _CELLS_OF_STABILITY, budget)
    if "tube" not in stability:
        return {"event_stability": stability}
    return {"event_stability": stability, "event_width": _width(system, budget)}


def _width(system: ClockSystem, budget: TimeBudget) -> NewEntries:
    """Certificate of `event_width`: of all sensors, else the narrowest without some of them."""
    whole = _width_certificate(system, budget)
    if "tube" in whole or not system.never_widens:
        return whole
    proved = list[tuple[float, NewEntries]]()
    for left_out in _subsets(sorted(system.counted, key=system.gap, reverse=True)):
        if budget.remaining() < 0:
            break
        own = replace(system, left_out=left_out)
        certificate = _width_certificate(own, budget)
        nodes = width_graph(own, certificate["cells"]) if "tube" in certificate else None
        if nodes is not None:
            names = [system.gains.sensors[k].name for k in left_out]
            always = np.array(certificate["tube"])[list(nodes.always)].max(axis=0)
            size = float(np.log(np.maximum(always, np.finfo(float).tiny)).mean())  # in any units
            proved.append((size, certificate | {"without": names}))
    return min(proved, key=lambda own: own[0])[1] if proved else whole


def _subsets(sensors: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Sensors to leave out, never all: every subset of a few, else the first ones alone."""
    for count in range(1, len(sensors)):
        if len(sensors) <= _MOST_SENSORS:
            yield from combinations(sensors, count)
        else:
            yield tuple(sensors[:count])


def _width_certificate(system: ClockSystem, budget: TimeBudget) -> NewEntries:
    """Certificate of `event_width` with the sensors that are not left out."""
    first = _first_cells(system, _LAST_CELLS_OF_WIDTH, _NODES_OF_FIRST_GRAPH)
    return _certificate(system, width_graph, (first, _LAST_CELLS_OF_WIDTH), budget)


def _first_cells(system: ClockSystem, most: int, nodes: int) -> int:
    """Cells of the first graph for widths: as many, up to `most`, as leave it so many nodes."""
    cells = most
    while cells > 1 and width_graph(system, cells, nodes) is None:
        cells //= 2
    return cells


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


def _uncertain_certificate(gains: ClockedIntervalGains, budget: TimeBudget) -> NewEntries:
    """Certificate of `late_width`, or the limit of its search; empty where it is not to be had."""
    if reason_against_events(gains.events, gains.sensors):
        return {}
    if not turns(gains):
        additive = UncertainAdditiveSystem(gains)
        if additive.reason_against():
            return {}
        first, last = _CELLS_OF_LATE_WIDTH
        first = _first_cells(additive, first, _NODES_SEARCHED)
        return _certificate(additive, width_graph, (first, last), budget)
    if UncertainGeneralSystem(gains).reason_against():
        return {}
    size = SizeSystem(gains)
    sizes = _certificate(size, width_graph, _CELLS_OF_LATE_WIDTH, budget)
    nodes = width_graph(size, sizes["cells"]) if "tube" in sizes else None
    if nodes is None:
        return sizes
    largest = np.max([sizes["tube"][mark.node] for mark in nodes.marks], axis=0)
    general = UncertainGeneralSystem(gains, tuple(largest.tolist()))
    own = _certificate(general, width_graph, _CELLS_OF_LATE_WIDTH, budget)
    return own if "tube" not in own else {**own, "sizes": sizes}


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
    nodes_limit = min(budget.scaled(_NODES_SEARCHED), LARGEST_GRAPH)
    while cells <= most:
        if (nodes := graph_of(system, cells, nodes_limit)) is None:
            may_grow = system.gains.events and nodes_limit < LARGEST_GRAPH
            return ended_by_count("nodes", int(nodes_limit)) if may_grow else {}
        for tube in proposed_tubes(nodes.graph, _added(nodes.graph), budget):
            if prove_graph(nodes.graph, tube.tolist(), budget).outcome == "proved":
                return {"cells": cells, "tube": tube.tolist()}
        if budget.remaining() < 0:
            return budget.ended()
        cells *= 2
    return ended_by_count("cells", cells // 2) if system.gains.events else {}


def _added(graph: Graph) -> Matrix:
    """What every entry of a tube has at least; of any size where there are no inputs."""
    return _ADDED * input_sizes(graph) if graph.has_inputs() else np.ones(graph.n)
