"""Interval observers: what a user may rely on, in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from obsdesign.document import Claim
from obsdesign.problem.problem import Problem
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.interval.sampled import in_every_period, no_spacing, sampled_sentences
from obsdesign.verification.interval.width import width_sentence
from obsdesign.verification.rates import rates_sentence
from obsdesign.verification.same_evidence import ROUNDED_WIDTHS


def guarantees(problem: Problem, found: tuple[Claim, ...]) -> tuple[dict[str, Any], ...]:
    """The sentences a user may rely on, and those that were asked for and not proved."""
    verdicts = {claim.id: claim.verdict for claim in found}
    enclosing: list[str] = [
        name for name in ("consistent", "flow_positive", "jump_positive") if name in verdicts
    ]
    bounded: list[str] = [name for name in ("hurwitz", "dwell_stability") if name in verdicts]
    jump = problem.plant.jump
    ends = "" if jump is None else _range(problem, found)
    periodic = problem.plant.output.measured == "periodic"
    lost = jump is not None and problem.plant.output.jump_measurement == "none"
    when = f" for every sequence of dwell times in {ends}" if ends else ""
    enclosure = (
        "The bounds contain the state at every instant, if they contain it at the start, b, c and "
        "v stay inside their bounds and jumps are reported at their times; this holds for "
        "samples at any spacing, missing ones included, and for any dwell time."
    )
    at_jumps = problem.plant.output.measured == "at_jumps"
    measured = "With y measured at every jump" if at_jumps else "With y measured continuously"
    if periodic:
        measured = in_every_period(lost)
    width = (
        f"{measured}, the width of the bounds stays bounded{when}, and without disturbance and "
        f"noise it tends to zero{'' if jump is None else ' as jumps go on'}."
    )
    told: list[tuple[str, bool, list[str]]] = [(enclosure, _all(verdicts, enclosing), enclosing)]
    if periodic:
        bounded = ["sampled_stability"]
    told.append((width, _all(verdicts, enclosing + bounded), enclosing + bounded))
    for text, ids in rates_sentence(found, "the width"):
        told.append((f"{measured}: {text}", _all(verdicts, ids), ids))
    sampled = sampled_sentences(found, lost)
    for text, ids in [*width_sentence(found, measured), *sampled]:
        ids = [*enclosing, *(name for name in ("hurwitz",) if name in verdicts), *ids]
        told.append((text, _all(verdicts, ids), ids))
    if not (at_jumps or periodic or sampled):
        told.append((no_spacing(), False, []))
    told.append((ROUNDED_WIDTHS, _all(verdicts, enclosing), enclosing))
    return tuple({"statement": text, "given": given, "claims": ids} for text, given, ids in told)


def _range(problem: Problem, found: tuple[Claim, ...]) -> str:
    """The range of dwell times that is claimed."""
    for claim in found:
        if claim.id == "dwell_stability" and "dwell_time" in claim.evidence:
            low, high = claim.evidence["dwell_time"]
            return str(replace(Dwell.of(problem), low=float(low), high=float(high)))
    return str(Dwell.of(problem))


def _all(verdicts: Mapping[str, str], names: list[str]) -> bool:
    return all(verdicts[name] == "proved" for name in names)
