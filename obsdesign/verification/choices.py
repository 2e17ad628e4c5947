"""Witnesses against the problem, and witnesses against what synthesis chose for it.

A refutation of a window or gain that the problem leaves open does not refute other ones:
`answers.as_answers` weakens it to undecided, unless its witness is marked here.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from obsdesign.document import Claim
from obsdesign.problem.problem import Problem


def open_choices(problem: Problem, *names: str) -> set[str]:
    """Those of the gains and options `names` that the problem leaves open."""
    stated = problem.options.to_document()
    return set(names) - set(stated) - set(problem.gains)


def mark_witness(claim: Claim, choices: Iterable[str] = ()) -> Claim:
    """Mark the witness of a refuted claim `of_all_gains` where none of its choices is open."""
    witness = claim.evidence.get("witness")
    if claim.verdict != "refuted" or witness is None or set(choices):
        return claim
    evidence = {**claim.evidence, "witness": {**witness, "of_all_gains": True}}
    return replace(claim, evidence=evidence)
