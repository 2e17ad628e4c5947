"""What a document says of itself: warnings that earlier releases state as guarantees not given."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

import obsdesign
from obsdesign.document import Design, Guarantee
from obsdesign.problem.problem import Problem
from obsdesign.verification.document import document_claim

EXAMPLES = Path(__file__).parents[2] / "examples"


@functools.cache
def made() -> Design:
    return obsdesign.design(obsdesign.load_problem(EXAMPLES / "mattsson_medvedev.toml"))


def verdict(design: Design) -> str:
    return document_claim(Problem.from_dict(design.problem), design, design.claims)[0].verdict


def without(warning: str) -> Design:
    warnings = made().warnings
    assert warnings is not None
    return replace(made(), warnings=tuple(each for each in warnings if each != warning))


def test_missed_impulses_are_warnings_and_no_guarantees() -> None:
    statements = [sentence.statement for sentence in made().guarantees]
    assert not any("told apart" in text or "are missed" in text for text in statements)
    assert made().warnings is not None
    assert any("small ones are missed" in text for text in made().warnings or ())


def test_a_warning_may_stand_among_sentences_that_are_not_given() -> None:
    for warning in made().warnings or ():
        earlier = without(warning)
        before = Guarantee.not_proved(warning)
        assert verdict(replace(earlier, guarantees=(*earlier.guarantees, before))) == "proved"


def test_a_statement_in_the_words_of_an_earlier_release_is_proved_and_another_one_is_not() -> None:
    design = obsdesign.design(obsdesign.load_problem(EXAMPLES / "ahn_1.toml"))
    (claim,) = (claim for claim in design.claims if claim.id == "rounding")
    assert "steady-state error" in claim.statement
    end = claim.statement[claim.statement.index("is at most") :]
    before = "what the rounding of the stored matrices leaves of the estimates for ever "
    for words, expected in ((before + end, "proved"), (before + end + " too", "refuted")):
        claims = tuple(
            replace(each, statement=words) if each == claim else each for each in design.claims
        )
        earlier = replace(design, claims=claims)
        verdict = document_claim(Problem.from_dict(design.problem), earlier, design.claims)[0]
        assert verdict.verdict == expected


def test_a_warning_must_stand_somewhere_once_and_guarantees_nothing() -> None:
    warning = (made().warnings or ())[0]
    before = Guarantee.not_proved(warning)
    assert verdict(made()) == "proved"
    assert verdict(without(warning)) == "refuted"
    assert verdict(replace(made(), guarantees=(*made().guarantees, before))) == "refuted"
    given = Guarantee(warning, (), given=True)
    earlier = without(warning)
    assert verdict(replace(earlier, guarantees=(*earlier.guarantees, given))) == "refuted"
    other = Guarantee.not_proved("Whatever else.")
    assert verdict(replace(made(), guarantees=(*made().guarantees, other))) == "refuted"
