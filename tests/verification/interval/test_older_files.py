"""Design files of earlier releases: gains that are zero, without the mark and its warning."""

from __future__ import annotations

from dataclasses import replace

import pytest

import obsdesign
from obsdesign.document import Design
from tests.synthesis.interval.test_default_objective import PERIODIC, TANKS, problem

ZERO = {"continuous": {"L": [[0], [0]], "M": [[0], [0]]}, "periodic": {"L": [[0]]}}
PLANTS = {"continuous": TANKS, "periodic": PERIODIC}


def without_mark(design: Design) -> Design:
    """The design as an earlier release wrote it: nothing on gains that are zero."""
    claims = tuple(
        replace(claim, evidence={k: v for k, v in claim.evidence.items() if k != "zero_gains"})
        for claim in design.claims
    )
    return replace(design, claims=claims, warnings=())


@pytest.mark.parametrize("measured", PLANTS)
def test_a_file_of_before_with_zero_gains_is_proved_and_warned_of(measured: str) -> None:
    design = obsdesign.design(problem(PLANTS[measured], gains=ZERO[measured]))
    (warning,) = design.warnings or ()
    for stored in (design, without_mark(design)):
        outcome = obsdesign.verify(stored)
        assert (outcome.verdict, outcome.warnings) == ("proved", (warning,))


def test_the_twins_with_the_mark_or_the_warning_alone_are_refuted() -> None:
    design = obsdesign.design(problem(TANKS, gains=ZERO["continuous"]))
    older = without_mark(design)
    for stored in (replace(design, warnings=()), replace(older, warnings=design.warnings)):
        assert obsdesign.verify(stored).verdict == "refuted"


def test_the_mark_in_a_file_with_gains_is_refuted() -> None:
    design = obsdesign.design(problem(PERIODIC, gains={"L": [[0.5]]}))
    claims = tuple(
        replace(claim, evidence={**claim.evidence, "zero_gains": True})
        if claim.id == "consistent" else claim
        for claim in design.claims
    )  # fmt: skip
    assert obsdesign.verify(design).verdict == "proved"
    assert obsdesign.verify(replace(design, claims=claims)).verdict == "refuted"


def test_a_file_of_the_default_objective_of_before_is_proved() -> None:
    # `feasible` was the default, and is not stated in the problem of such a file
    design = obsdesign.design(problem(TANKS, objective="feasible"))
    stored = without_mark(design)
    body = {**stored.problem, "observer": {"kind": "interval"}}
    assert obsdesign.verify(replace(stored, problem=body)).verdict == "proved"
