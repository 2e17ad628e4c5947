"""Is what a design file says of itself what was proved again?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from obsdesign.document import Claim, Design, Guarantee
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.verification.same_evidence import ROUNDED_WIDTHS, Difference, difference


@dataclass(frozen=True)
class Sentences:
    """What follows from claims: guarantees, and warnings."""

    guarantees: tuple[Guarantee, ...] = ()
    warnings: tuple[str, ...] = ()


def sentences_from(problem: Problem, claims: tuple[Claim, ...], verification: Any) -> Sentences:
    """Guarantees and warnings of a kind; a guarantee is given where all its claims are proved here.

    Every guarantee rests on `consistent` beside the claims it names: it is about these gains.
    """
    proved = {claim.id for claim in claims if claim.verdict == "proved"}
    guarantees = tuple(
        replace(one, given=one.given and {"consistent", *one.claims} <= proved and bool(one.claims))
        for one in map(_as_guarantee, verification.guarantees(problem, claims))
    )
    return Sentences(guarantees, getattr(verification, "warnings", lambda *_: ())(problem, claims))


def _as_guarantee(entry: Any) -> Guarantee:  # BRIDGE
    if isinstance(entry, Guarantee):
        return entry
    return Guarantee(entry["statement"], tuple(entry["claims"]), entry["given"])


def document_claim(
    problem: Problem, design: Design, claims: tuple[Claim, ...], verification: Any
) -> tuple[Claim, Sentences]:
    """The claim that the stored claims, evidence and sentences are those recomputed; the sentences.

    What is undecided now and stands as decided in the document makes it unconfirmed, not false.
    The sentences are recomputed from the claims; there are none unless the claim is proved.
    """
    stored = {claim.id: claim for claim in design.claims}
    open_now = [
        claim.id
        for claim in claims
        if claim.verdict == "undecided"
        and claim.id in stored
        and stored[claim.id].verdict != "undecided"
    ]
    assumed = tuple(stored[claim.id] if claim.id in open_now else claim for claim in claims)
    sentences: Sentences | None
    try:
        sentences = sentences_from(problem, assumed, verification)
    except InputError:
        raise
    except (KeyError, TypeError, ValueError):  # evidence that nobody confirmed
        sentences = None
    wrong = _difference(design.claims, assumed)
    evidence_gap = None if wrong is not None else _evidence_gap(stored, assumed)
    if evidence_gap is not None and evidence_gap.false:
        wrong = evidence_gap.entry
    if wrong is None:
        wrong = _wrong_sentences(design, sentences)
    if wrong is None and design.name != design.problem.get("name"):
        wrong = "name"
    verdict, evidence = "proved", dict[str, Any](entries=len(stored))
    if wrong is not None:
        because = f"the document's {wrong!r} is not what its gains and problem give"
        verdict, evidence = "refuted", {"witness": {"entry": wrong, "reason": because}}
    elif open_now:
        names = ", ".join(open_now)
        verdict = "undecided"
        evidence = {"reason": f"what the document says of {names} could not be confirmed"}
    elif evidence_gap is not None:
        why = f"the document's {evidence_gap.entry!r} is not quite what was found again"
        verdict, evidence = "undecided", {"reason": why}
    claim = Claim(
        "document",
        "claims and guarantees in the document are those that were proved again",
        "format of a design file",
        verdict,
        evidence,
    )
    return claim, sentences if sentences and verdict == "proved" else Sentences()


def _wrong_sentences(design: Design, recomputed: Sentences | None) -> str | None:
    """Key of the sentences that differ, "guarantees" or "warnings"; None if none does.

    Sentences that are not given promise nothing: older designs state warnings among them, and name
    fewer of the claims that a guarantee rests on.
    """
    if recomputed is None or _given(design.guarantees) != _given(recomputed.guarantees):
        return "guarantees"
    if design.warnings is not None and design.warnings != recomputed.warnings:
        return "warnings"
    return None


def _given(guarantees: tuple[Guarantee, ...]) -> list[str]:
    return [one.statement for one in guarantees if one.given and one.statement != ROUNDED_WIDTHS]


def _evidence_gap(stored: Mapping[str, Claim], found: tuple[Claim, ...]) -> Difference | None:
    """The gravest difference in the evidence of decided claims; what is undecided shows nothing."""
    every = [
        difference(claim.id, stored[claim.id].to_dict()["evidence"], claim.to_dict()["evidence"])
        for claim in found
        if claim.verdict != "undecided"
    ]
    gaps = [gap for gap in every if gap is not None]
    return next((gap for gap in gaps if gap.false), gaps[0] if gaps else None)


def _difference(stored: tuple[Claim, ...], found: tuple[Claim, ...]) -> str | None:
    """The id of a claim in which the two differ, evidence apart."""
    one, other = (
        sorted((c.id, c.statement, c.source, c.verdict) for c in group) for group in (stored, found)
    )
    wrong = sorted({entry[0] for entry in set(one) ^ set(other)})
    if wrong:
        return wrong[0]
    return "claims" if one != other else None
