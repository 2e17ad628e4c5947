"""Witnesses against the problem, and witnesses against what synthesis chose for it.

A refutation of a window or gain that the problem leaves open says nothing of other ones:
`answers.as_answers` weakens it to undecided, unless its witness is marked here.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from obsdesign.document import Claim
from obsdesign.problem import Problem


def left_open(problem: Problem, *names: str) -> set[str]:
    """Which of these gains and options the problem leaves open."""
    return set(names) - set(problem.options) - set(problem.gains)


def of_all_choices(claim: Claim, open_choices: Iterable[str] = ()) -> Claim:
    """The claim, a witness in it marked `of_all_gains` where nothing it rests on is open."""
    witness = claim.evidence.get("witness")
    if claim.verdict != "refuted" or witness is None or set(open_choices):
        return claim
    evidence = {**claim.evidence, "witness": {**witness, "of_all_gains": True}}
    return replace(claim, evidence=evidence)
