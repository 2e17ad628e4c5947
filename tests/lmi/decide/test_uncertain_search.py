"""Brackets of dwell times and of ranges of parameters: between a certificate and a word."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lmi.decide.dwell_search import Bracket
from lmi.decide.uncertain_search import Searched, UncertainProblem, uncertain_bracket
from lmi.parameters import AffineFamily
from lmi.prove.parameter_cells import prove_cells
from lmi.refute.parameter_words import refute_witness
from lmi.time_budget import TimeBudget
from lmi.verdict import Verdict
from tests.lmi.parameter_examples import from_ranges, growing_or_reset, oscillator

ACCURACY = 1e-3


def refuted_again(problem: UncertainProblem, bracket: Bracket) -> Verdict:
    """The witness of a bracket, checked against the problem at its end."""
    assert bracket.not_proved is not None
    return refute_witness(*problem.at(bracket.not_proved), bracket.obstacle["witness"])


def checked(problem: UncertainProblem) -> Bracket:
    """A bracket, both sides of which are checked from the problem."""
    bracket = uncertain_bracket(problem)
    assert bracket.proved is not None
    certificate = prove_cells(*problem.at(bracket.proved), bracket.certificate)
    assert certificate.outcome == "proved"
    assert bracket.verdict == "refuted"
    assert refuted_again(problem, bracket).outcome == "refuted"
    return bracket


@pytest.mark.parametrize(
    ("searched", "limit"),
    [("shortest", math.log(1.2)), ("longest", math.log(2) / 1.3), ("factor", None)],
)
def test_both_sides_meet_at_the_exact_limit(searched: Searched, limit: float | None) -> None:
    problem = UncertainProblem(growing_or_reset(0.1), 0.3, 0.5, searched, ACCURACY)
    bracket = checked(problem)
    # of the factor: e^{(1.2 + 0.1 f) 0.5} = 2
    expected = (2 * math.log(2) - 1.2) / 0.1 if limit is None else limit
    assert bracket.proved == pytest.approx(expected, rel=ACCURACY)
    assert bracket.not_proved == pytest.approx(expected, rel=ACCURACY)
    assert bracket.relative_gap is not None
    assert bracket.relative_gap <= ACCURACY


def test_what_varies_has_a_gap_and_what_is_constant_has_none() -> None:
    varying = checked(UncertainProblem(oscillator(0.1), 1.0, 3.0, "factor", 0.01))
    assert varying.proved is not None
    assert varying.proved > 1.41
    assert varying.not_proved is not None
    assert varying.not_proved < 1.9
    # a constant stiffness may be anything above 0
    problem = UncertainProblem(oscillator(0.1, is_constant=True), 1.0, 3.0, "factor", 0.02)
    constant = checked(problem)
    assert constant.proved == pytest.approx(10.0, rel=0.02)
    assert constant.not_proved == pytest.approx(10.0, rel=0.02)


def scalar(flow: float, jump: float) -> AffineFamily:
    """x' = (flow +- 0.1) x, x+ = jump x."""
    return from_ranges([[flow]], [[jump]], [([[1]], [[0]])], [(-0.1, 0.1)])


def test_everything_or_nothing() -> None:
    whole = uncertain_bracket(UncertainProblem(scalar(-1, 0.5), 1.0, 2.0, "longest", ACCURACY))
    assert (whole.proved, whole.not_proved, whole.verdict) == (math.inf, None, None)
    whole = uncertain_bracket(UncertainProblem(scalar(-1, 0.5), 1.0, 2.0, "shortest", ACCURACY))
    assert (whole.proved, whole.not_proved, whole.verdict) == (0.0, None, None)
    for searched in ("shortest", "longest", "factor"):
        nothing = uncertain_bracket(UncertainProblem(scalar(1, 2), 1.0, 2.0, searched, ACCURACY))
        assert nothing.proved is None
        assert nothing.verdict == "refuted"


def test_from_zero_on() -> None:
    """Longest dwell time of a flow that grows by at most 1.1 a second, halved at jumps."""
    problem = UncertainProblem(scalar(1, 0.5), 0.0, 0.01, "longest", ACCURACY)
    assert checked(problem).proved == pytest.approx(math.log(2) / 1.1, rel=ACCURACY)
    shortest = UncertainProblem(scalar(-1, 2), 5.0, math.inf, "shortest", ACCURACY)
    assert checked(shortest).proved == pytest.approx(math.log(2) / 0.9, rel=ACCURACY)


def test_without_effects_no_factor_is_too_large() -> None:
    family = from_ranges([[-1]], [[0.5]], [([[0]], [[0]])], [(-1, 1)])
    bracket = uncertain_bracket(UncertainProblem(family, 1.0, 2.0, "factor", ACCURACY))
    assert bracket.proved is not None
    assert bracket.proved > 1e6
    assert bracket.verdict == "undecided"


def test_time_ends_a_search() -> None:
    budget = TimeBudget.from_seconds(0.3)
    bracket = uncertain_bracket(UncertainProblem(oscillator(0.1), 1.0, 3.0, "factor", 1e-6, budget))
    assert bracket.ended["ended_by"] == "time"
    assert bracket.proved is None or bracket.proved < 1.5


def test_harder_numbers_are_harder() -> None:
    for searched in ("shortest", "longest", "factor"):
        problem = UncertainProblem(oscillator(0.1), 1.0, 3.0, searched)
        hard, easy = problem.further(1.5), problem.nearer(1.5)
        assert (hard < 1.5 < easy) if searched == "shortest" else (easy < 1.5 < hard)
    assert np.isinf(UncertainProblem(oscillator(0.1), 1.0, 3.0, "longest").extreme)
