"""The interval observer for several clocks: its gains, and what follows from its clocks.

The bounds themselves need no hypothesis: of stated times only the longest silence of a sensor that
sends on change enters them. Their width does: a tube on
the graph of the clocks (`analysis.interval.event_graph`), which is made here from the problem.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_CEILING

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, Matrix, NewEntries
from lmi.arithmetic.balls import exact, to_float
from lmi.bounds.graph_proof import prove_graph
from lmi.prove.hurwitz import prove_hurwitz
from lmi.verdict import Verdict, undecided
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.analysis.interval.event_graph import (
    MOST_CELLS,
    EventGraph,
    stability_graph,
    width_graph,
)
from obsdesign.analysis.interval.several_clocks import reason_against_clocks, with_given
from obsdesign.document import Claim, Guarantee
from obsdesign.equations.clocks import clock_data
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.problem.problem import Problem
from obsdesign.verification.consistency import consistent_gains
from obsdesign.verification.interval.clock_claims import (
    all_times,
    reasons_without_tube,
    stability_claim,
    tube_from_evidence,
)
from obsdesign.verification.interval.discrete_time import step_claims
from obsdesign.verification.rates import six_digits
from obsdesign.verification.same_evidence import ROUNDED_WIDTHS
from obsdesign.verification.silent_sensors import further_sample, missing_samples

_ENCLOSURE = (
    "The bounds contain the state at every row, if they contain it at the start, b, c and v stay "
    "inside their bounds and events are reported at their times; this holds for samples of each "
    "sensor at any spacing, {}, for any times between events and whatever the "
    "rounding."
)
_MONOTONE = (
    "{} never makes the bounds wider, but for rounding: the box that it leaves is kept only where "
    "it is narrower."
)
_SOURCE = "docs/interval.md, several events and sensors; comparison with fewer samples"


@dataclass(frozen=True)
class EventWidth:
    """Evidence of `event_width`: a tube (nodes, n) for `cells`, and bounds of the width (n,).

    always: at all times; before, after: each event, by name.
    """

    cells: int
    tube: Matrix
    always: Matrix
    before: dict[str, Matrix]
    after: dict[str, Matrix]

    @classmethod
    def from_tube(
        cls, system: ClockSystem, nodes: EventGraph, cells: int, tube: Matrix
    ) -> EventWidth:
        """What a tube of the graph of all times comes to."""
        before, after = dict[str, Matrix](), dict[str, Matrix]()
        for mark in nodes.marks:
            u = exact(tube[mark.node])
            for stage in nodes.graph.events[mark.place]:
                u = stage(u)
            late = np.nextafter(to_float(u), np.inf)
            for name in (system.gains.events[e].name for e in mark.events):
                before[name] = np.maximum(before.get(name, 0.0), tube[mark.node])
                after[name] = np.maximum(after.get(name, 0.0), late)
        return cls(cells, tube, tube[list(nodes.always)].max(axis=0), before, after)

    def to_evidence(self) -> NewEntries:
        """Entries of the claim."""
        stated: NewEntries = {"cells": self.cells, "tube": self.tube.tolist()}
        stated["always"] = self.always.tolist()
        if self.before:
            stated["before"] = {name: x.tolist() for name, x in self.before.items()}
            stated["after"] = {name: x.tolist() for name, x in self.after.items()}
        return stated


def clocked_claims(
    problem: Problem, stored: Entries, certificates: EntriesByClaim
) -> tuple[Claim, ...]:
    """All claims of the design, each with its verdict; stored: gains as a file states them.

    certificates: {"event_stability": {"cells", "tube"}, "event_width": the same} where they were
    found; the graph is made from the problem, and the tube is checked on it.
    """
    reason = reason_against_clocks(problem)
    expected = {} if reason is not None else expected_of_clocks(problem, stored)
    agreement, gains = consistent_gains(
        reason, stored, expected, ClockedIntervalGains.from_document
    )
    if gains is None:
        return (agreement,)
    system = ClockSystem(gains)
    if gains.dt is not None:
        return (agreement, *step_claims(system, certificates))
    stability = stability_claim(
        system, _SOURCE, _stability(system, certificates.get("event_stability", {}))
    )
    width = Claim.from_verdict(
        "event_width",
        "asymptotically the width of the bounds is at most `always` at any time"
        + (", and at most `before` and `after` each event, " if gains.events else ", ")
        + all_times(system),
        _SOURCE,
        _width_without(system, certificates.get("event_width", {})),
    )
    return (agreement, stability, width)


def _stability(system: ClockSystem, proposed: Entries) -> Verdict:
    """The homogeneous tube of a certificate, proved."""
    return _tube(system, stability_graph, proposed)[0]


def proved_width(system: ClockSystem, proposed: Entries) -> Verdict:
    """The tube of a certificate, proved, and what it comes to."""
    verdict, nodes = _tube(system, width_graph, proposed)
    if not _is(verdict) or nodes is None:
        return verdict
    cells, tube = verdict.evidence["cells"], np.array(verdict.evidence["tube"])
    width = EventWidth.from_tube(system, nodes, cells, tube)
    return Verdict(verdict.outcome, {**verdict.evidence, **width.to_evidence()})


def _width_without(system: ClockSystem, proposed: Entries) -> Verdict:
    """The same of fewer sensors, where the certificate names some that it does "without".

    These may only be sensors on clocks of their own that never widen: the rest of the proof counts
    on the others, at their events.
    """
    if "without" not in proposed:
        return proved_width(system, proposed)
    names = proposed["without"]
    places = {system.gains.sensors[k].name: k for k in system.counted if system.never_widens}
    listed = names if isinstance(names, list) else []
    left_out = [places[x] for x in listed if isinstance(x, str) and x in places]
    if not left_out or len(left_out) < len(listed) or len(set(left_out)) < len(left_out):
        known = ", ".join(places) or "none"
        return undecided(f"without must list sensors that a proof may leave out, once: {known}")
    verdict = proved_width(replace(system, left_out=tuple(left_out)), proposed)
    return Verdict(verdict.outcome, {**verdict.evidence, "without": names})


def _tube(
    system: ClockSystem,
    graph_of: Callable[[ClockSystem, int], EventGraph | None],
    proposed: Entries,
) -> tuple[Verdict, EventGraph | None]:
    """The verdict on the tube of a certificate, and its graph, made from the problem."""
    certificate = _certificate(proposed)
    nodes = None if certificate is None else graph_of(system, certificate[0])
    if certificate is None or nodes is None:
        return undecided(reason_without_tube(system)), None
    is_endless = any(math.isinf(each.high) for each in nodes.graph.passages())
    if is_endless and (reason := _reason_against_endless(system)):
        return undecided(reason), None
    cells, tube = certificate
    verdict = prove_graph(nodes.graph, tube)
    if not _is(verdict):
        return verdict, None
    stated: NewEntries = {"cells": cells, "tube": tube}
    return Verdict(verdict.outcome, {**stated, **verdict.evidence}), nodes


def _reason_against_endless(system: ClockSystem) -> str | None:
    """Reason against proofs in which all events may stay away, or None where the flow decays."""
    if prove_hurwitz(system.W).outcome == "proved":
        return None
    names = [x.name for k, x in enumerate(system.gains.events) if math.isinf(system.dwell(k)[1])]
    return (
        f"no longest time of {', '.join(names)} is stated, and the width does not decay by itself: "
        "W = Mz(A) is not proved to be Hurwitz"
    )


def _is(verdict: Verdict) -> bool:
    return verdict.outcome == "proved"


def _certificate(proposed: Entries) -> tuple[int, list[list[float]]] | None:
    """(cells, tube) of a certificate; None where it is none."""
    cells, tube = proposed.get("cells"), tube_from_evidence(proposed.get("tube"))
    if type(cells) is not int or not 1 <= cells <= MOST_CELLS or tube is None:
        return None
    return cells, tube


def reason_without_tube(system: ClockSystem) -> str:
    """Reason why no width is proved: what the clocks leave open."""
    sentences = reasons_without_tube(system)
    dwells = [system.dwell(k) for k in range(len(system.gains.events))]
    sentences += [
        f"event {own.name} has no shortest time above zero: any number may happen at once"
        for own, (shortest, _) in zip(system.gains.events, dwells, strict=True)
        if shortest == 0.0
    ]
    if (
        dwells
        and min(longest for _, longest in dwells) == math.inf
        and (reason := _reason_against_endless(system))
    ):
        sentences.append(reason)
    return "; ".join(sentences)


def clocked_guarantees(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on."""
    verdicts = {claim.id: claim.verdict for claim in claims}
    enclosure = _ENCLOSURE.format(missing_samples(problem.plant))
    monotone = _MONOTONE.format(further_sample(problem.plant))
    given = [
        Guarantee.from_verdicts(text, ["consistent"], verdicts) for text in (enclosure, monotone)
    ]
    if "event_stability" not in verdicts:
        return tuple(given)
    bounded = (
        "For all times of events and samples that the stated clocks allow, the width of the bounds "
        "stays bounded, and without disturbance and noise it tends to zero."
    )
    given.append(Guarantee.from_verdicts(bounded, ["event_stability"], verdicts))
    evidence = next(claim.evidence for claim in claims if claim.id == "event_width")
    if verdicts["event_width"] != "proved":
        return tuple(given)
    given.append(Guarantee.from_verdicts(_width_sentence(evidence), ["event_width"], verdicts))
    return (*given, Guarantee.from_verdicts(ROUNDED_WIDTHS, ["event_width"], verdicts))


def _width_sentence(evidence: Entries) -> str:
    parts = [f"{_listed(evidence['always'])} at any time"]
    for name, before in evidence.get("before", {}).items():
        after = _listed(evidence["after"][name])
        parts.append(f"{_listed(before)} before an event {name} and {after} after it")
    return f"Asymptotically the width of the bounds is at most {', '.join(parts)}."


def _listed(width: Sequence[float]) -> str:
    return f"({', '.join(six_digits(x, ROUND_CEILING) for x in width)})"


def expected_of_clocks(problem: Problem, stored: Entries) -> NewEntries:
    """Entries of the gains: the plant's numbers, given gains, and the shapes of the others."""
    plant, n, p = problem.plant, problem.plant.n, problem.plant.p
    shapes = {"L": (n, p), "M": (len(plant.events), n, p)}
    L, M = (np.asarray(stored.get(name, 0.0)) for name in shapes)
    expected: NewEntries = clock_data(plant) | shapes
    if L.shape == shapes["L"]:
        expected["L"] = with_given(plant, problem.gains, L, np.zeros(shapes["M"]))[0]
    if M.shape == shapes["M"]:
        expected["M"] = with_given(plant, problem.gains, np.zeros(shapes["L"]), M)[1]
    if not plant.events:
        del expected["M"]
    return expected
