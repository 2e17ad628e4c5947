"""Stability and widths of interval observers of modes: tubes on the graph of marks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from decimal import ROUND_CEILING

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries
from lmi.arithmetic.balls import exact, to_float
from lmi.bounds.graph_proof import prove_graph
from lmi.bounds.graph_tube import Graph
from lmi.prove.hurwitz import prove_hurwitz
from lmi.verdict import Verdict, undecided
from obsdesign.analysis.interval.mode_graph import MOST_CELLS, ModeGraph, ModeSystem, mode_graph
from obsdesign.analysis.modes import graph_of_spans
from obsdesign.document import Claim
from obsdesign.verification.interval.clock_claims import tube_from_evidence
from obsdesign.verification.modes import SOURCE, mode_stability, stability_claim
from obsdesign.verification.rates import six_digits

WIDTH = "mode_width"
_TUBE = "tube on the graph of entries and events (docs/modes.md)"


def stability_of_modes(system: ModeSystem, certificate: Entries, paranoid: bool) -> Claim:
    """Claim that the width tends to zero along all paths of modes and events.

    Events whose map is at most the identity make no width larger, and what is proved without them
    holds with them. Otherwise certificate: {"parts", "tube"}, a tube without inputs.
    """
    widths, source = system.widths, SOURCE
    modes = graph_of_spans(
        system.gains.spans, [own.W for own in widths], [own.N for own in widths]
    )  # fmt: skip
    if system.may_widen:
        # without events: only what is refuted counts, since they may stay away
        witness = {key: own for key, own in certificate.items() if key == "witness"}
        verdict, source = mode_stability(modes, witness, paranoid), _TUBE
        if verdict.outcome != "refuted":
            verdict = _proved_tube(system, certificate, has_inputs=False)[0]
    else:
        verdict = mode_stability(modes, certificate, paranoid)
    if verdict.outcome == "refuted" and (names := _needed(system)):
        verdict = undecided(
            f"these stays are refuted without events, and {names} must happen", **verdict.evidence
        )
    what = "the width w, w' = W w with W = D0 + D1 in each mode,"
    return stability_claim(verdict, what, source)


def _needed(system: ModeSystem) -> str:
    """Names of events that must happen, and may narrow the bounds; "" for none."""
    return ", ".join(
        own.name for own in system.events if own.changes_state and math.isfinite(own.dwell_range[1])
    )


def width_claim(system: ModeSystem, proposed: Entries) -> tuple[Claim, ...]:
    """Claim of widths at entry into each mode, and at all times; none without a tube."""
    if "tube" not in proposed:
        return ()
    verdict, nodes = _proved_tube(system, proposed, has_inputs=True)
    if nodes is not None:
        tube = np.array(proposed["tube"], dtype=np.float64)
        verdict = replace(verdict, evidence={**_widths(nodes, tube), **verdict.evidence})
    names = ", ".join(system.gains.names)
    events = ", w+ = |G| w + h at events" if system.events else ""
    statement = (
        f"ultimate bounds of the width are entry on entry into each mode ({names}), and "
        "always at any time in it: a tube that the width system w' = W w + f, w+ = |G| w at entry"
        f"{events} does not leave and is drawn to"
    )
    return (Claim.from_verdict(WIDTH, statement, _TUBE, verdict),)


def _widths(nodes: ModeGraph, tube: Matrix) -> NewEntries:
    """Widths of each mode, just after entry and at any time; None where it is not entered again."""
    entry: list[list[float] | None] = []
    for mode, places in enumerate(nodes.entries):
        (entered,) = nodes.graph.events[mode]
        after = [np.nextafter(to_float(entered(exact(tube[k]))), np.inf) for k in places]
        entry.append(np.max(after, axis=0).tolist() if after else None)
    always = [None if place is None else tube[place].tolist() for place in nodes.always]
    return {"entry": entry, "always": always}


def _proved_tube(
    system: ModeSystem, proposed: Entries, *, has_inputs: bool
) -> tuple[Verdict, ModeGraph | None]:
    """The verdict on the tube of a certificate, and its graph, made from the problem."""
    parts, tube = proposed.get("parts"), tube_from_evidence(proposed.get("tube"))
    if type(parts) is not int or not 1 <= parts <= MOST_CELLS or tube is None:
        return undecided(str(proposed.get("reason", "no tube was given or found"))), None
    nodes = mode_graph(system, parts)
    if nodes is None:
        return undecided(f"the graph of {parts} parts is too large"), None
    if reason := _reason_against_lasting(system):
        return undecided(reason), None
    graph: Graph = nodes.graph if has_inputs else nodes.graph.without_inputs()
    verdict = prove_graph(graph, tube)
    stated: NewEntries = {"parts": parts, "tube": tube}
    verdict = replace(verdict, evidence={**stated, **verdict.evidence})
    return verdict, nodes if verdict.outcome == "proved" else None


def _reason_against_lasting(system: ModeSystem) -> str | None:
    """Reason against a tube: a mode that may last, whose width does not decay; or None."""
    for name, span, own in zip(
        system.gains.names, system.gains.spans, system.widths, strict=True
    ):  # fmt: skip
        if math.isinf(span.every[1]) and (flow := prove_hurwitz(own.W)).outcome != "proved":
            return f"mode {name} has no longest stay and is not proved stable: {flow.reason}"
    return None


def width_text(names: Sequence[str], claim: Claim) -> str:
    """Widths of all modes in words, (0.6, 0.03) on entry into open."""
    entry, always = claim.evidence["entry"], claim.evidence["always"]
    words = []
    for name, at, ever in zip(names, entry, always, strict=True):
        if at is not None:
            words.append(
                f"{_listed(at)} on entry into {name} and {_listed(ever)} at any time in it"
            )
        elif ever is not None:
            words.append(f"{_listed(ever)} at any time in {name}")
    return "; ".join(words)


def _listed(width: Sequence[float]) -> str:
    """A width with six digits, rounded up."""
    return f"({', '.join(six_digits(x, ROUND_CEILING) for x in width)})"
