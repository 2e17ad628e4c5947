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
