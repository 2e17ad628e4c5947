"""Claims about gains as answers to a problem, and why they are refuted or undecided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from lmi.arithmetic.arrays import Entries, EntriesByClaim
from lmi.time_budget import Remark, ended_part, ending, last_end
from obsdesign.document import Claim
from obsdesign.errors import DoesNotApply, InputError


class Chosen(Protocol):
    """What verification has to know of a candidate of synthesis."""

    @property
    def searched(self) -> bool:
        """Did synthesis choose something that the problem leaves open?"""

    @property
    def certificates(self) -> EntriesByClaim:
        """By claim id, what synthesis found for it."""


def as_answers(
    candidate: Chosen, claims: tuple[Claim, ...], remarks: Sequence[Remark] = ()
) -> tuple[Claim, ...]:
    """Claims about a candidate as answers to its problem.

    A claim refuted for gains that synthesis chose is undecided for the problem: others may do.

    remarks: of the searches that made the candidate; what they leave undecided says that a budget
    ended them.
    """
    if any(_witness_holds_for_all_gains(claim) for claim in claims):
        return claims
    if candidate.searched:
        claims = tuple(_undecided_for_problem(claim) for claim in claims)
    gains_ended = last_end(remarks)
    return tuple(
        with_end(claim, ended_part(candidate.certificates.get(claim.id, {})) or gains_ended)
        for claim in claims
    )


def with_untried(claim: Claim, end: Entries) -> Claim:
    """The claim where time ended before all forms were tried: no longer refuted.

    Whatever the witness: one for all gains is about all gains of its form. end: the evidence of
    the budget that ended.
    """
    return with_end(_as_undecided(claim, f"{reason(claim)}; other forms were not tried"), end)


def with_end(claim: Claim, end: Entries) -> Claim:
    """An undecided claim with the evidence of the budget that ended its search, or as it is."""
    if claim.verdict != "undecided" or is_ended(claim):
        return claim
    return replace(claim, evidence={**claim.evidence, **end})


def verdict_of_refusal(error: InputError) -> str:
    """The verdict on a kind that refused a problem: a refusal is no witness."""
    return "does_not_apply" if isinstance(error, DoesNotApply) else "undecided"


def is_ended(claim: Claim) -> bool:
    """Was a search for this undecided claim ended by its budget?"""
    return claim.verdict == "undecided" and bool(ended_part(claim.evidence))


def reason(claim: Claim) -> str:
    """Reason for which a claim is refuted or undecided, a sentence from its evidence."""
    evidence = claim.evidence
    witness = evidence.get("witness", {})
    text = str(evidence.get("reason") or witness.get("reason") or claim.statement)
    return f"{text}; {more_time(evidence)}" if is_ended(claim) else text


def more_time(evidence: Entries, gain: str = "decide it") -> str:
    """Sentence about the end of a search by its budget; evidence as of `TimeBudget.ended`."""
    return f"the search {ending(evidence)}; a longer --time may {gain}"


def _witness_holds_for_all_gains(claim: Claim) -> bool:
    """Does the witness hold for every gain that the problem leaves open?"""
    return bool(claim.evidence.get("witness", {}).get("of_all_gains"))


def _undecided_for_problem(claim: Claim) -> Claim:
    """A claim refuted for searched gains as undecided for the problem."""
    why = (
        "no gains or options that the problem leaves open were found for which it holds; for the "
        f"last ones tried, {reason(claim)}"
    )
    return _as_undecided(claim, why)


def _as_undecided(claim: Claim, why: str) -> Claim:
    """A refuted claim as an undecided one."""
    if claim.verdict != "refuted":
        return claim
    kept = {name: value for name, value in claim.evidence.items() if name != "witness"}
    these = {"witness": claim.evidence.get("witness")}
    evidence = {**kept, "these_gains": these, "reason": why}
    return replace(claim, verdict="undecided", evidence=evidence)
