from __future__ import annotations

import pytest

from lmi.verdict import Verdict, overall, proved, refuted, undecided


def test_a_verdict_is_never_a_bool() -> None:
    for verdict in (proved(), refuted({"theta": 1.0}), undecided("no reason")):
        with pytest.raises(TypeError, match=r"compare \.outcome"):
            bool(verdict)


def test_there_is_no_fourth_outcome() -> None:
    with pytest.raises(ValueError, match="outcome must be one of proved, refuted, undecided"):
        Verdict("probably", {})


@pytest.mark.parametrize(
    ("outcomes", "expected"),
    [
        ([], "proved"),
        (["proved", "proved"], "proved"),
        (["proved", "undecided"], "undecided"),
        (["undecided", "refuted", "proved"], "refuted"),
    ],
)
def test_the_worst_outcome_wins(outcomes: list[str], expected: str) -> None:
    assert overall(outcomes) == expected


def test_evidence_keeps_witness_and_reason() -> None:
    assert refuted({"theta": 0.5}, steps=3).evidence == {"witness": {"theta": 0.5}, "steps": 3}
    assert undecided("too hard", theta=1.0).evidence == {"reason": "too hard", "theta": 1.0}


def test_reason_and_witness_of_a_verdict() -> None:
    """A refutation has the reason of its witness, whatever else its evidence says."""
    witness = {"theta": 0.5, "reason": "it grows"}
    counter = refuted(witness, reason="found on the way")
    assert (counter.witness, counter.reason) == (witness, "it grows")
    attempt = undecided("too many boxes", boxes=9)
    assert (attempt.witness, attempt.reason) == ({}, "too many boxes")
    assert (proved(method="exact").witness, proved(method="exact").reason) == ({}, "")
