"""Widths of an interval observer in discrete time: a tube on the graph of the clocks' ages."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim
from lmi.bounds.step_tube import StepGraph, prove_steps
from lmi.verdict import Verdict, proved, undecided
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.analysis.interval.step_graph import step_graph
from obsdesign.document import Claim
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.problem.plant import Plant
from obsdesign.verification.interval.clock_claims import (
    all_times,
    reasons_without_tube,
    stability_claim,
    tube_from_evidence,
)

_SOURCE = "docs/discrete_time.md, widths; comparison with fewer samples"


def step_claims(system: ClockSystem, certificates: EntriesByClaim) -> tuple[Claim, ...]:
    """`event_stability` and `event_width`; none where the clocks have no graph.

    certificates: {"event_stability": {"tube"}, "event_width": {"tube"}}; the graph is made from the
    problem, and the tube is checked on it.
    """
    graph = step_graph(system)
    if isinstance(graph, str):
        return ()
    still = graph.without_inputs()
    return (
        stability_claim(
            system,
            _SOURCE,
            _of_tube(system, still, certificates.get("event_stability", {}), has_width=False),
        ),
        Claim.from_verdict(
            "event_width",
            "asymptotically the width of the bounds is at most `always` after every step, "
            f"{all_times(system)}",
            _SOURCE,
            _of_tube(system, graph, certificates.get("event_width", {}), has_width=True),
        ),
    )


def _of_tube(
    system: ClockSystem, graph: StepGraph, proposed: Entries, *, has_width: bool
) -> Verdict:
    tube = tube_from_evidence(proposed.get("tube"))
    if tube is None:
        return undecided(reason_without_steps(system))
    verdict = prove_steps(graph, tube)
    if verdict.outcome != "proved":
        return verdict
    width = {"always": np.max(tube, axis=0).tolist()} if has_width else {}
    return proved(tube=tube, **width, **verdict.evidence)


def reason_without_steps(system: ClockSystem) -> str:
    """Reason why no width is proved."""
    sentences = reasons_without_tube(system)
    blind = [f"x{i + 1}" for i in np.flatnonzero(~(system.gains.C != 0).any(axis=0))]
    if blind:
        sentences.append(
            f"no output has {', '.join(blind)}: boxes do not follow it from other states, as kind "
            "set_membership does"
        )
    return "; ".join(sentences)


def step_warnings(plant: Plant) -> tuple[str, ...]:
    """A sentence with the reason where the clocks have no graph, and widths no claim."""
    n, p = plant.n, plant.p
    gains = {"M": np.zeros((len(plant.events), n, p))} if plant.events else {}
    system = ClockSystem(ClockedIntervalGains.from_plant(plant, L=np.zeros((n, p)), **gains))
    graph = step_graph(system)
    return (f"No width of the bounds is proved: {graph}.",) if isinstance(graph, str) else ()
