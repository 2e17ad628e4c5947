"""Claims of a plant with parameters whose state has no known bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, EntriesByClaim
from lmi.arithmetic.balls import exact, inverse
from lmi.prove.hurwitz import prove_hurwitz
from lmi.verdict import Verdict, undecided
from obsdesign.document import Claim
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.sourced_width import sourced_width
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.equations.parameters import NormalForm
from obsdesign.problem.problem import Problem
from obsdesign.verification.dwell import Dwell, dwell_stability, source_of
from obsdesign.verification.interval.width import limit_claim, width_claim
from obsdesign.verification.rates import shown

ID = "source_width"
_SOURCE = "comparison with the positive system of (|m|, |x - m|), docs/uncertain_plants.md"
_CONSTANT = "constant"


def sourced_claims(
    problem: Problem, gains: IntervalGains, certificates: EntriesByClaim, paranoid: bool
) -> tuple[Claim, ...]:
    """Stability of the radius under all parameters, and its limit by source, if one is proposed."""
    if problem.plant.output.measured == "at_jumps":
        gains = replace(gains, flow_correction=None)  # nothing is measured between jumps
    form = NormalForm.from_plant(problem.plant, exact)
    width = sourced_width(gains, form, exact, inverse)
    low, high = gains.dwell_ends
    claims = [_decay(width.W)] if width.N is None or math.isinf(high) else []
    if width.N is not None:
        jitter = math.inf if gains.dwell_jitter is None else gains.dwell_jitter
        dwell, proposed = Dwell(low, high, jitter), certificates.get("dwell_stability", {})
        claims.append(_stability(width.W, width.N, dwell, proposed, paranoid))
    return (*claims, *_width(width.systems, (low, high), certificates.get(ID)))


def _decay(W: Array) -> Claim:
    return Claim.from_verdict(
        "hurwitz",
        "the radius of the bounds decays between jumps, whatever the parameters do inside their "
        "ranges: W = D0 + D1 + sum |R_i| + (|L| + sum |Q_i|) sum |C_i| is Hurwitz",
        _SOURCE, prove_hurwitz(W),
    )  # fmt: skip


def _stability(W: Array, N: Array, dwell: Dwell, proposed: Entries, paranoid: bool) -> Claim:
    verdict = dwell_stability(W, N, dwell, proposed, paranoid)
    return Claim(
        "dwell_stability",
        "the map r -> e^(W T) N r of the radius is stable for every sequence of dwell times T in "
        f"{dwell}, whatever the parameters do inside their ranges: W = D0 + D1 + sum |R_i| + "
        "(|L| + sum |Q_i|) sum |C_i|, N likewise at jumps",
        source_of(verdict, _SOURCE),
        verdict.outcome,
        {"dwell_time": [dwell.low, dwell.high], **verdict.evidence},
    )


def _width(
    systems: Mapping[str, WidthSystem], ends: tuple[float, float], proposed: Entries | None
) -> tuple[Claim, ...]:
    """The claim that widths come to a sum over sources; none where nothing is proposed."""
    if not isinstance(proposed, Mapping) or set(proposed) != set(systems):
        return ()
    evidence: dict[str, Entries] = {}
    verdict = Verdict("proved", evidence)
    for source, system in systems.items():
        tube = proposed[source] if isinstance(proposed[source], Mapping) else {}
        listed = (
            limit_claim(system, tube, _SOURCE)
            if system.N is None
            else width_claim(system, ends, tube, _SOURCE)
        )
        if not listed or listed[0].verdict != "proved":
            verdict = undecided(f"the tube of {source} is not proved", source=source)
            break
        kept = ("tube", "after_jump", "before_jump", "always", "steps")
        evidence[source] = {key: value for key, value in listed[0].evidence.items() if key in kept}
    statement = (
        "an ultimate bound of the width is that of `constant` plus, for "
        "each y, u and w, its largest magnitude times that of its name: tubes of (|m|, 2 |x - m|), "
        "of which the second halves are widths; x itself need not be bounded"
    )
    return (Claim.from_verdict(ID, statement, f"{_SOURCE}; tube", verdict),)


def sourced_sentences(claims: Sequence[Claim], measured: str) -> list[tuple[str, list[str]]]:
    """The guarantees of such a plant beside the enclosure, each with the claims it rests on."""
    evidence = [claim.evidence for claim in claims if claim.id == ID and claim.verdict == "proved"]
    if not evidence:
        return []
    widths = {source: _widths(own) for source, own in evidence[0].items()}
    terms = [shown(widths[_CONSTANT])]
    terms += [f"{shown(own)} |{source}|" for source, own in widths.items() if source != _CONSTANT]
    sentence = (
        f"{measured}, the ultimate bound of the width is {' + '.join(terms)}, "
        "each magnitude the largest that occurs."
    )
    return [(sentence, [ID])]


def _widths(evidence: Entries) -> list[float]:
    values = np.asarray(evidence["always"], np.float64)
    return [float(value) for value in values[len(values) // 2 :]]
