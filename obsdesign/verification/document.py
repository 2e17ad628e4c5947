"""The claim that a design file states what was proved again, and the sentences that follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

from lmi.arithmetic.arrays import NewEntries
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.document import Claim, Design, Guarantee
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.verification.headline import headline
from obsdesign.verification.kind import StatesWidths, Warns, conclusions_of
from obsdesign.verification.same_evidence import (
    ADDED_CLAIMS,
    OLDER_WORDING,
    ROUNDED_WIDTHS,
    Difference,
    as_marked,
    current_source,
    current_statement,
    difference,
    is_older_wording,
)


@dataclass(frozen=True)
class Sentences:
    """What follows from claims: guarantees, warnings, and the guarantees in a few words."""

    guarantees: tuple[Guarantee, ...] = ()
    warnings: tuple[str, ...] = ()
    headline: tuple[str, ...] = ()


def sentences_from(problem: Problem, claims: tuple[Claim, ...]) -> Sentences:
    """Guarantees, given where all their claims are proved here, and warnings.

    Every guarantee rests on `consistent` beside the claims it names: it is about these gains.
    """
    kind = conclusions_of(problem.require_kind(), has_modes=bool(problem.plant.modes))
    certain = {claim.id for claim in claims if claim.verdict == "proved"}
    guarantees = tuple(
        replace(entry, given=entry.given and {"consistent", *entry.claims} <= certain)
        for entry in kind.guarantees(problem, claims)
    )
    warnings = kind.warnings(problem, claims) if isinstance(kind, Warns) else ()
    return Sentences(guarantees, warnings, headline(problem, claims))


def state_rows(problem: Problem, claims: tuple[Claim, ...]) -> list[NewEntries]:
    """Numbers of each state, by name, from proved claims; none of kinds that have none."""
    kind = conclusions_of(problem.require_kind(), has_modes=bool(problem.plant.modes))
    rows = kind.states(problem, claims) if isinstance(kind, StatesWidths) else ()
    return [asdict(row) for row in rows]


def document_claim(
    problem: Problem, design: Design, claims: tuple[Claim, ...]
) -> tuple[Claim, Sentences]:
    """The claim that a document states what is recomputed from it, and the sentences.

    A claim that is undecided now and decided in the document makes it unconfirmed, not false; so do
    a statement in the words of an earlier release and bounds that another course of the proof
    gave, with the sentences that rest on them. A claim that the document leaves undecided says
    nothing that could be false, whatever is decided now; a sentence that it does not give and
    that is proved is a warning. `ADDED_CLAIMS` may be missing, and warnings that rest on a mark
    that the evidence in the document lacks (`as_marked`): they are among the sentences.
    The sentences are recomputed from the claims; there are none unless the claim is proved.
    """
    design = _in_current_words(design)
    stored = {claim.id: claim for claim in design.claims}
    claims = tuple(claim for claim in claims if claim.id in stored or claim.id not in ADDED_CLAIMS)
    open_now = [claim.id for claim in claims if _is_open_now(claim, stored.get(claim.id))]
    assumed = tuple(
        stored[claim.id] if claim.id in open_now else _as_left_open(claim, stored.get(claim.id))
        for claim in claims
    )
    marked = tuple(as_marked(claim, stored.get(claim.id)) for claim in assumed)
    sentences = _confirmed_sentences(problem, marked)
    verdict = _document_verdict(design, assumed, sentences, open_now)
    claim = Claim.from_verdict(
        "document",
        "claims and guarantees in the document are those that were proved again",
        "format of a design file",
        verdict,
    )
    if sentences is None or verdict.outcome != "proved":
        return claim, Sentences()
    more = _withheld(design, sentences)
    sentences = sentences_from(problem, assumed)
    return claim, replace(sentences, warnings=(*sentences.warnings, *more))


def _in_current_words(design: Design) -> Design:
    """The document with the sentences of earlier releases in the words of today."""
    return replace(
        design,
        claims=tuple(replace(x, statement=current_statement(x.statement)) for x in design.claims),
        guarantees=tuple(
            replace(x, statement=current_statement(x.statement)) for x in design.guarantees
        ),
        warnings=design.warnings and tuple(map(current_statement, design.warnings)),
    )


def _document_verdict(
    design: Design,
    claims: tuple[Claim, ...],
    sentences: Sentences | None,
    open_now: Sequence[str],
) -> Verdict:
    """Decide whether a document states `claims` and `sentences`.

    open_now: ids of claims that are undecided now and decided in the document.
    """
    stored = {claim.id: claim for claim in design.claims}
    older = _claims_of_older_wording(stored, claims)
    gap = None if older else _evidence_gap(stored, claims)
    entry = _false_entry(design, claims, sentences, older, gap)
    if entry is not None:  # an entry may be named "" in a forged file
        because = f"the document's {entry!r} is not what its gains and problem give"
        return refuted({"entry": entry, "reason": because})
    if open_now:
        names = ", ".join(open_now)
        return undecided(f"what the document says of {names} could not be confirmed")
    if older:
        return undecided(_restated(older[0]))
    if gap is not None:
        return undecided(f"the document's {gap.entry!r} is not quite what was proved again")
    return proved(entries=len(stored))


def _false_entry(
    design: Design,
    claims: tuple[Claim, ...],
    sentences: Sentences | None,
    older: Sequence[Claim],
    gap: Difference | None,
) -> str | None:
    """Return an entry of the document that is not what `claims` and `sentences` say, or None.

    older: claims that the document states as an earlier release; gap: in the evidence.
    """
    stored = {claim.id: claim for claim in design.claims}
    written = tuple(stored[claim.id] if claim in older else claim for claim in claims)
    entry = _difference(design.claims, written)
    if entry is not None:
        return entry
    if gap is not None and gap.false:
        return gap.entry
    if gap is None and not older:
        entry = _wrong_sentences(design, sentences)
        if entry is not None:
            return entry
    return "name" if design.name != design.problem.get("name") else None


def _confirmed_sentences(problem: Problem, claims: tuple[Claim, ...]) -> Sentences | None:
    """The sentences that follow; None where evidence that nobody confirmed cannot be read."""
    try:
        return sentences_from(problem, claims)
    except InputError:
        raise
    except (KeyError, TypeError, ValueError):
        return None


def _is_open_now(claim: Claim, stored: Claim | None) -> bool:
    """Is a claim undecided that the document has decided?"""
    return claim.verdict == "undecided" and stored is not None and stored.verdict != "undecided"


def _as_left_open(claim: Claim, stored: Claim | None) -> Claim:
    """The claim, undecided if the document leaves it so: its statement is all that is compared."""
    if stored is None or stored.verdict != "undecided":
        return claim
    return replace(claim, verdict="undecided", source=stored.source, evidence=stored.evidence)


def _claims_of_older_wording(
    stored: Mapping[str, Claim], recomputed: Sequence[Claim]
) -> list[Claim]:
    """Claims proved again that the document has proved too, as an earlier release states them."""
    return [
        claim
        for claim in recomputed
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


def _wrong_sentences(design: Design, recomputed: Sentences | None) -> str | None:
    """Return the entry of sentences in which the document says other or more, or None.

    Sentences that are not given are compared as well: they may be read as facts. One that is not
    given although it is proved says less, which is not false (`_withheld`).
    """
    if recomputed is None:
        return "guarantees"
    pairs = _pairs(design, recomputed)
    if pairs is None or not all(
        _rests_on(old, new, design.warnings is None) and old.given <= new.given
        for old, new in pairs
    ):
        return "guarantees"
    earlier = [sentence.statement for sentence in _warnings_among_guarantees(design, recomputed)]
    stated = [*(design.warnings or ()), *earlier]
    if design.warnings is not None and sorted(stated) != sorted(recomputed.warnings):
        return "warnings"
    return None


def _warnings_among_guarantees(design: Design, recomputed: Sentences) -> list[Guarantee]:
    """Sentences that earlier releases state as not given, and that are warnings."""
    return [
        sentence
        for sentence in design.guarantees
        if not sentence.given and sentence.statement in recomputed.warnings
    ]


def _pairs(design: Design, recomputed: Sentences) -> list[tuple[Guarantee, Guarantee]] | None:
    """Each sentence of the document with its recomputed one; None where they differ.

    Older designs, without warnings, state these among the sentences, lack some that are not given,
    and do not have the one on the rounding of widths.
    """
    proved_now: Sequence[Guarantee] = recomputed.guarantees
    if design.warnings is not None:
        earlier = _warnings_among_guarantees(design, recomputed)
        proved_now = (*proved_now, *earlier)
    else:
        stated = {one.statement for one in design.guarantees}
        every = (*proved_now, *map(Guarantee.not_proved, recomputed.warnings))
        proved_now = [
            one
            for one in every
            if one.statement in stated or (one.given and one.statement != ROUNDED_WIDTHS)
        ]
    old, new = (sorted(group, key=_statement) for group in (design.guarantees, proved_now))
    if list(map(_statement, old)) != list(map(_statement, new)):
        return None
    return list(zip(old, new, strict=True))


def _statement(sentence: Guarantee) -> str:
    return sentence.statement


def _rests_on(old: Guarantee, new: Guarantee, is_older: bool) -> bool:
    """Whether a sentence names the claims it rests on; older designs name fewer."""
    before, now = set(old.claims), set(new.claims)
    return before <= now if is_older else before == now


def _withheld(design: Design, recomputed: Sentences) -> tuple[str, ...]:
    """Sentences on what is proved here and stated as not given in the document."""
    pairs = _pairs(design, recomputed) or []
    return tuple(
        f"The document says less than is proved: it does not give {new.statement!r}"
        for old, new in pairs
        if new.given and not old.given
    )


def _evidence_gap(stored: Mapping[str, Claim], recomputed: tuple[Claim, ...]) -> Difference | None:
    """The gravest difference in the evidence of decided claims; undecided ones are not compared."""
    every = [
        difference(claim.id, stored[claim.id].stated_evidence(), claim.stated_evidence())
        for claim in recomputed
        if claim.id in stored and claim.verdict != "undecided"
    ]
    gaps = [gap for gap in every if gap is not None]
    return next((gap for gap in gaps if gap.false), gaps[0] if gaps else None)


def _difference(stored: tuple[Claim, ...], recomputed: tuple[Claim, ...]) -> str | None:
    """The id of a claim in which the two differ, evidence apart."""
    old, new = (
        sorted((c.id, c.statement, current_source(c.source), c.verdict) for c in group)
        for group in (stored, recomputed)
    )
    wrong = sorted({entry[0] for entry in set(old) ^ set(new)})
    if wrong:
        return wrong[0]
    return "claims" if old != new else None
