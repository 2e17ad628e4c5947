"""Widths of an interval observer in discrete time: a tube on the graph of the clocks' ages."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim
from lmi.bounds.step_tube import StepGraph, prove_steps
from lmi.verdict import Verdict, proved, undecided
from obsdesign.analysis.interval.clock_system import ClockSystem
from obsdesign.analysis.interval.step_graph import step_graph
from obsdesign.document import Claim
from obsdesign.entries import is_number

_SOURCE = "docs/discrete_time.md, widths; comparison with fewer samples"
_CLOCKS = "for all times of samples that the clocks allow"
_EVENTS = (
    "as events go on, for all times of events and samples that the clocks allow, where a sample "
    "stamped with the time of an event acts before it, or after it, as `sees` says"
)
NO_GRAPH = (
    "No width of the bounds is guaranteed: the clocks have too many states between them to follow "
    "them all, or an event has no shortest time."
)


def step_claims(system: ClockSystem, certificates: EntriesByClaim) -> tuple[Claim, ...]:
    """`event_stability` and `event_width`; none where the clocks have no graph.

    certificates: {"event_stability": {"tube"}, "event_width": {"tube"}}; the graph is made from the
    problem, and the tube is checked on it.
    """
    graph = step_graph(system)
    if isinstance(graph, str):
        return ()
    still, clocks = graph.without_inputs(), _EVENTS if system.gains.events else _CLOCKS
    return (
        Claim.from_verdict(
            "event_stability",
            f"without disturbance and noise the width of the bounds tends to zero {clocks}: a "
            "tube of the homogeneous width system on the graph of the clocks is drawn into itself",
            _SOURCE,
            _of_tube(system, still, certificates.get("event_stability", {}), has_width=False),
        ),
        Claim.from_verdict(
            "event_width",
            f"the width of the bounds comes to at most `always` after any step {clocks}",
            _SOURCE,
            _of_tube(system, graph, certificates.get("event_width", {}), has_width=True),
        ),
    )


def _of_tube(
    system: ClockSystem, graph: StepGraph, proposed: Entries, *, has_width: bool
) -> Verdict:
    tube = _tube(proposed.get("tube"))
    if tube is None:
        return undecided(reason_without_steps(system))
    verdict = prove_steps(graph, tube)
    if verdict.outcome != "proved":
        return verdict
    width = {"always": np.max(tube, axis=0).tolist()} if has_width else {}
    return proved(tube=tube, **width, **verdict.evidence)


def _tube(values: object) -> list[list[float]] | None:
    """Rows of numbers, all equally long; None for anything else."""
    if not isinstance(values, list) or not values:
        return None
    rows = [row for row in values if isinstance(row, list) and all(map(is_number, row))]
    if len(rows) != len(values) or len({len(row) for row in rows}) != 1:
        return None
    return [[float(x) for x in row] for row in rows]


def reason_without_steps(system: ClockSystem) -> str:
    """Reason why no width is proved."""
    sentences = ["no tube was found on the graph of the clocks"]
    sentences += [
        f"sensor {name} may be silent for any time, and is not counted on"
        for name in system.not_counted
    ]
    blind = [f"x{i + 1}" for i in np.flatnonzero(~(system.gains.C != 0).any(axis=0))]
    if blind:
        sentences.append(
            f"no output has {', '.join(blind)}: boxes do not follow it from other states, as kind "
            "set_membership does"
        )
    return "; ".join(sentences)
