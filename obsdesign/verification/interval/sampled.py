"""Interval observers with samples: stability and width where samples are events, step limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, inverse, to_float, upper_ends
from lmi.bounds.interleaved import Bounds, Interleaved, prove_interleaved, sampled_flow
from lmi.prove.hurwitz import prove_hurwitz
from lmi.refute.spectral import refute_spectral
from lmi.verdict import Verdict, undecided
from obsdesign.document import Claim
from obsdesign.equations.interval.width import SAMPLED_MAPS, WidthSystem, slope_scheme
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.interval.width import (
    limit_claim,
    raised_product,
    shown,
    vectors,
    width_claim,
)

_MAPS_IN_WORDS = (
    "w+ = |X e^(A s)| w + what f adds over a time s, with X = I between events, X = I - L C (k is "
    "added) at samples and X = G (h is added) at jumps,"
)
_COMPARISON_IN_WORDS = "w' = W w + f, w+ = K w + k at samples and w+ = N w + h at jumps"


def samples_claim(
    system: WidthSystem, gains: Mapping[str, Any], proposed: Mapping[str, Any], source: str
) -> Claim:
    """Samples as events: bounded width for every sequence of jumps between them.

    proposed: "tube", "sampled", "always" and, with jumps, "jumped"; checked, not believed. "maps":
    `SAMPLED_MAPS`; without it, as in designs of earlier versions, the claim is about the wider
    comparison system.
    """
    period = float(gains["period"])
    merged = proposed.get("maps") == SAMPLED_MAPS
    system = system if merged else system.compared()
    low, high = (float(end) for end in gains.get("dwell_time", (math.inf, math.inf)))
    ends = (low, high)
    lost = system.N is not None and gains["jump_measurement"] == "none"
    names = ("tube", "sampled", "always") + (() if system.N is None else ("jumped",))
    found = vectors(proposed, names, len(system.f))
    verdict = undecided("no tube was given or found for samples and jumps between them")
    if found is not None:
        verdict = _proof(system, period, ends, found, lost)
    if verdict.outcome == "proved" and found is not None:
        widths = {name: to_float(found[name]).tolist() for name in names}
        if system.N is not None:
            widths["after_jump"] = raised_product(system.out, found["jumped"])
        widths["after_sample"] = raised_product(system.out, found["sampled"])
        verdict = Verdict("proved", {**widths, **verdict.evidence})
    elif system.N is None or math.isinf(high):
        counter = _refutation(system, period)
        verdict = counter if counter.outcome == "refuted" else verdict
    jumps = "" if system.N is None else f" and jumps with dwell times in {Dwell(*ends)}"
    spared = " (none is needed at the time of a jump)" if lost else ""
    statement = (
        f"with a sample every {period!r}{spared}{jumps}, the width stays bounded: a tube that "
        f"{_MAPS_IN_WORDS if merged else _COMPARISON_IN_WORDS} do not leave and are drawn to"
    )
    evidence = {**({"maps": SAMPLED_MAPS} if merged else {}), **verdict.evidence}
    return Claim("sampled_stability", statement, source, verdict.outcome, evidence)


def _refutation(system: WidthSystem, period: float) -> Verdict:
    """From sample to sample the error itself does not contract, or its absolute map does not."""
    assert system.A is not None
    assert system.K is not None
    counter = refute_spectral(system.A, system.K, period, period)
    if counter.outcome == "refuted":
        return counter
    sample = Interleaved.of(system, period, math.inf, math.inf).over_period()
    below = np.maximum(-upper_ends(-sample), 0.0)[:-1, :-1]
    if not np.isfinite(below).all():
        return undecided("the map from sample to sample overflows")
    return refute_spectral(0 * below, below, period, period)


def _proof(
    system: WidthSystem,
    period: float,
    ends: tuple[float, float],
    found: Mapping[str, Any],
    lost: bool,
) -> Verdict:
    question = Interleaved.of(system, period, *ends, lost)
    bounds = Bounds(found["tube"], found["sampled"], found.get("jumped"), found["always"])
    return prove_interleaved(question, exact(system.out), bounds)


def spacing_claim(
    system: WidthSystem,
    gains: Mapping[str, Any],
    ends: tuple[float, float],
    proposed: Mapping[str, Any],
    source: str,
) -> tuple[Claim, ...]:
    """A continuous y known at samples: the width for all spacings up to a limit; extra."""
    limit = proposed.get("step_limit")
    if limit != gains.get("step_limit", limit):
        nothing = undecided("the step limit of the gains is not the one to be proved")
        return (Claim("sampled_width", "the width", source, nothing.outcome, nothing.evidence),)
    if not isinstance(limit, float) or not 0 < limit < math.inf:
        return ()
    L, CA, A, C, b = slope_scheme(gains, exact, inverse)
    added = sampled_flow(exact(system.W), L, CA, A, C, b, limit)
    if added is None:
        return ()
    spaced = replace(system, W=system.W + added[0], f=system.f + added[1])
    if system.N is None:
        claims = limit_claim(spaced, proposed, source)
    else:
        claims = width_claim(spaced, ends, proposed, source)
    flow = prove_hurwitz(spaced.W) if math.isinf(ends[1]) else None
    lost = system.N is not None and gains["jump_measurement"] == "none"
    return tuple(_spaced(claim, limit, flow, lost) for claim in claims)


def at_any_spacing(claim: Claim) -> Claim:
    """The claim about the width of a design with L = 0: between jumps no sample is used."""
    evidence = {"step_limit": math.inf, **claim.evidence}
    evidence.pop("constant_dwell", None)
    statement = f"with samples at any spacing, since L = 0: {claim.statement}"
    return Claim("sampled_width", statement, claim.source, claim.verdict, evidence)


def _spaced(claim: Claim, limit: float, flow: Verdict | None, lost: bool) -> Claim:
    """lost: no sample is taken at jumps, so that two in a row would leave a step without any."""
    evidence = {"step_limit": limit, **claim.evidence}
    verdict = claim.verdict
    if verdict == "proved" and flow is not None and flow.outcome != "proved":
        verdict, evidence = "undecided", {**evidence, "reason": "the flow does not decay"}
    evidence.pop("constant_dwell", None)
    where = "at every step" if not lost else "at one end at least of every step"
    statement = f"with a sample {where} of at most {limit!r}: {claim.statement}"
    return Claim("sampled_width", statement, claim.source, verdict, evidence)


def in_every_period(lost: bool) -> str:
    """What is asked of periodic samples; lost: none is taken at the time of a jump."""
    spared = ", save where one falls on a jump," if lost else ""
    return f"With samples a period apart{spared} and any others besides"


def sampled_sentences(found: tuple[Claim, ...], lost: bool) -> list[tuple[str, list[str]]]:
    """The guarantees of proved claims about samples, and the claims behind them."""
    told = []
    for claim in found:
        if claim.verdict != "proved":
            continue
        evidence = claim.evidence
        if claim.id == "sampled_stability":
            text = (
                f"{in_every_period(lost)}, the width comes to at most "
                f"{shown(evidence['after_sample'])} after samples and {shown(evidence['always'])} "
                "at any time."
            )
            told.append((text, ["sampled_stability"]))
        if claim.id == "sampled_width":
            limit = float(evidence["step_limit"])
            apart = f"at most {limit:.6g} apart, at jumps and irregular ones too,"
            if lost:
                apart = (
                    f"at most {limit:.6g} apart, irregular ones too, save where one falls on a "
                    "jump, and a sample between any two jumps,"
                )
            if math.isinf(limit):
                apart = "at any spacing, and at jumps if M is not zero,"
            widest = shown(evidence["always"])
            text = f"With samples {apart} the width comes to at most {widest} at any time."
            told.append((text, ["sampled_width"]))
    return told


def no_spacing() -> str:
    """What is said where no step limit is proved."""
    return (
        "A bounded width for samples at a given spacing is not claimed: no limit of the spacing "
        "was proved. Unless L = 0, it must be small against 1/(|L||CA|)."
    )
