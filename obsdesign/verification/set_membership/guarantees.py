"""Guarantees of the multiplier observer, in sentences."""

from __future__ import annotations

from obsdesign.document import Claim, Guarantee
from obsdesign.problem.problem import Problem

_ENCLOSURE = (
    "The bounds contain the state at every row, if they contain it at the start, b, c and v stay "
    "inside their bounds and jumps are reported at their times; this holds for samples at any "
    "spacing, missing ones included, for any dwell time and whatever the rounding."
)
_CONTRADICTION = (
    "Bounds that cross prove that plant, declared bounds and data contradict each other; the "
    "samples whose multipliers prove it are named."
)


def guarantees(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on."""
    del problem
    verdicts = {claim.id: claim.verdict for claim in claims}
    sentences = (_ENCLOSURE, _CONTRADICTION)
    return tuple(Guarantee.from_verdicts(text, ["consistent"], verdicts) for text in sentences)
