"""Certificates of interval observers of modes: stability, and tubes on the graph of marks."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import NewEntries
from lmi.arithmetic.balls import exact
from lmi.bounds.graph_proof import prove_graph
from lmi.bounds.graph_tube import Graph
from lmi.find.graph_tube import MARGINS, input_sizes, proposed_tubes
from lmi.time_budget import TimeBudget, ended_by_count
from obsdesign.analysis.interval.mode_graph import MOST_CELLS, ModeSystem, mode_graph
from obsdesign.analysis.modes import graph_of
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.equations.modes import SwitchedGains
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Certificates
from obsdesign.synthesis.modes import stability_certificates

# cells of the shortest time between two events: of the first graph, and of the last
_FIRST, _LAST = 8, 16
# what every entry of a tube has beside what inputs make of it, relative to that
_ADDED = 1e-7
# room above the image of a tube: that of a few nodes alone is small
_MARGINS_OF_MODES = (2e-6, 2e-5, *MARGINS)


def mode_certificates(
    problem: Problem, gains: SwitchedGains[IntervalGains], budget: TimeBudget
) -> Certificates:
    """Certificates of `mode_stability` and, where it has one, of `mode_width`."""
    widths = tuple(WidthSystem.from_gains(own, exact, np.asarray) for own in gains.gains)
    system = ModeSystem(gains, widths)
    modes = graph_of(problem, [own.W for own in widths], [own.N for own in widths])
    certificates = stability_certificates("mode_stability", modes, budget)
    if "cells" not in certificates.evidence["mode_stability"]:
        return certificates
    if system.may_widen:
        stability = _tube(system, budget, has_inputs=False)
        certificates = Certificates({"mode_stability": stability}, certificates.solvers)
        if "tube" not in stability:
            return certificates
    width = _tube(system, budget, has_inputs=True)
    return certificates.joined(Certificates({"mode_width": width}))


def _tube(system: ModeSystem, budget: TimeBudget, *, has_inputs: bool) -> NewEntries:
    """A tube that is proved, of the coarsest graph that has one, or the limit of the search."""
    parts, most = _FIRST if system.events else 1, int(min(budget.scaled(_LAST), MOST_CELLS))
    while parts > 1 and mode_graph(system, parts) is None:
        parts //= 2
    while (nodes := mode_graph(system, parts)) is not None:
        graph = nodes.graph if has_inputs else nodes.graph.without_inputs()
        for tube in proposed_tubes(graph, _added(graph), budget, _MARGINS_OF_MODES):
            if prove_graph(graph, tube.tolist(), budget).outcome == "proved":
                return {"parts": parts, "tube": tube.tolist()}
        if budget.remaining() < 0:
            return budget.ended()
        if not system.events or parts >= most:
            break
        parts *= 2
    return ended_by_count("parts", parts)


def _added(graph: Graph) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return _ADDED * input_sizes(graph) if graph.has_inputs() else np.ones(graph.n)
