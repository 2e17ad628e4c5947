"""The claim that a design file states what was proved again, and the sentences that follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from obsdesign.document import Claim, Design, jsonable
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.verification.same_evidence import (
    OLDER_WORDING,
    ROUNDED_WIDTHS,
    Difference,
    current_source,
    difference,
    is_older_wording,
)

Sentences = tuple[Mapping[str, Any], ...]


def guarantees_of(problem: Problem, claims: tuple[Claim, ...], verification: Any) -> Sentences:
    """Sentences that follow from claims; given where all they rest on is proved among these.

    Every sentence rests on `consistent` beside the claims it names: they are about these gains.
    """
    proved = {claim.id for claim in claims if claim.verdict == "proved"}
    return tuple(
        {**entry, "given": bool(entry["given"] and entry["claims"])
         and {"consistent", *entry["claims"]} <= proved}
        for entry in verification.guarantees(problem, claims)
    )  # fmt: skip


def document_claim(
    problem: Problem, design: Design, claims: tuple[Claim, ...], verification: Any
) -> tuple[Claim, Sentences]:
    """The claim that the stored claims, evidence and guarantees are the recomputed ones; sentences.

    A claim that is undecided now and decided in the document makes it unconfirmed, not false; so do
    a statement in the words of an earlier release and bounds that another course of the proof
    gave, with the sentences that rest on them.
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
    guarantees: Sentences | None
    try:
        guarantees = guarantees_of(problem, assumed, verification)
    except InputError:
        raise
    except (KeyError, TypeError, ValueError):  # evidence that nobody confirmed
        guarantees = None
    older = _claims_of_older_wording(stored, assumed)
    written = (stored[claim.id] if claim in older else claim for claim in assumed)
    wrong = _difference(design.claims, tuple(written))
    evidence_gap = None if wrong is not None or older else _evidence_gap(stored, assumed)
    if evidence_gap is not None and evidence_gap.false:
        wrong = evidence_gap.entry
    confirmed = not older and evidence_gap is None
    if wrong is None and confirmed and _compared(guarantees) != _compared(design.guarantees):
        wrong = "guarantees"
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
    elif older:
        verdict, evidence = "undecided", {"reason": _restated(older[0])}
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
    return claim, guarantees if guarantees and verdict == "proved" else ()


def _claims_of_older_wording(stored: Mapping[str, Claim], found: Sequence[Claim]) -> list[Claim]:
    """Claims proved again that the document has proved too, as an earlier release states them."""
    return [
        claim
        for claim in found
        if claim.id in stored
        and claim.verdict == stored[claim.id].verdict == "proved"
        and claim.source == current_source(stored[claim.id].source)
        and is_older_wording(claim.id, stored[claim.id].statement, claim.statement)
    ]


def _restated(claim: Claim) -> str:
    now, before = OLDER_WORDING[claim.id]
    return (
        f"the document's {claim.id!r} is stated as by an earlier release, {before!r} where {now!r} "
        "is proved now: its numbers and what rests on them are not confirmed; design it anew"
    )


def _compared(sentences: Any) -> Any:
    """Sentences without their claims, of which older designs name fewer."""
    entries = jsonable(sentences)
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        return entries
    return [
        {name: entry[name] for name in entry if name != "claims"}
        for entry in entries
        if entry.get("statement") != ROUNDED_WIDTHS
    ]


def _evidence_gap(stored: Mapping[str, Claim], proved: tuple[Claim, ...]) -> Difference | None:
    """The gravest difference in the evidence of decided claims; undecided ones are not compared."""
    every = [
        difference(claim.id, stored[claim.id].to_dict()["evidence"], claim.to_dict()["evidence"])
        for claim in proved
        if claim.verdict != "undecided"
    ]
    gaps = [gap for gap in every if gap is not None]
    return next((gap for gap in gaps if gap.false), gaps[0] if gaps else None)


def _difference(stored: tuple[Claim, ...], proved: tuple[Claim, ...]) -> str | None:
    """The id of a claim in which the two differ, evidence apart."""
    old, new = (
        sorted((c.id, c.statement, current_source(c.source), c.verdict) for c in group)
        for group in (stored, proved)
    )
    wrong = sorted({entry[0] for entry in set(old) ^ set(new)})
    if wrong:
        return wrong[0]
    return "claims" if old != new else None
