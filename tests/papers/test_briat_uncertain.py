"""Briat, Automatica 49 (2013), 3449: uncertain impulsive and sampled systems, by exact certificates.

Dwell times of example (51), and Table 5.
"""

from __future__ import annotations

import math

import pytest

from lmi.decide.uncertain_stability import decide_uncertain
from lmi.find.bang_bang import followed, worst_switching
from lmi.find.clock_matrix import find_clock_matrix
from lmi.prove.parameter_cells import prove_cells
from lmi.refute.parameter_words import read_stays, refute_parameters
from tests.lmi.parameter_examples import alternating, sampled, table_5


# published: sums of squares of degree 6, the best of the methods that are compared there
@pytest.mark.parametrize(
    ("kappa", "shortest", "published"),
    [
        (0.5, 0.7961, 0.7972), (0.7, 0.8750, 0.8769), (0.9, 0.9977, 1.0004),
        (1.1, 1.1758, 1.1835), (1.3, 1.7150, 1.7174),
    ],
)  # fmt: skip
def test_minimum_dwell_time_of_51(kappa: float, shortest: float, published: float) -> None:
    """Stiffness 2 and 9, each +- kappa and varying: shorter dwell times than published."""
    low = 1.001 * shortest
    assert low < published * 1.001
    verdict = find_clock_matrix(alternating(kappa), low, math.inf, segments=(12,))
    assert verdict.outcome == "proved"
    assert prove_cells(alternating(kappa), low, math.inf, verdict.evidence).outcome == "proved"
    # the twin: the same numbers prove nothing for wider ranges, or shorter dwell times
    for family, least in ((alternating(1.2 * kappa), low), (alternating(kappa), 0.9 * low)):
        assert prove_cells(family, least, math.inf, verdict.evidence).outcome == "undecided"


def test_minimum_dwell_time_of_51_is_almost_exact_for_small_kappa() -> None:
    """kappa = 0.1: two dwell times in turn refute what is one part in a thousand shorter."""
    verdict = decide_uncertain(alternating(0.1), 0.999 * 0.6783, math.inf)
    assert verdict.outcome == "refuted"
    word = read_stays(verdict.witness["stays"])
    assert refute_parameters(alternating(0.1), 0.999 * 0.6783, math.inf, word).outcome == "refuted"


@pytest.mark.parametrize(("kappa", "limit"), [(0.5, 0.7781), (0.7, 0.8121), (0.9, 0.8465)])
def test_words_reach_the_limit_of_51(kappa: float, limit: float) -> None:
    """What is open between words and certificates is what quadratic forms leave open.

    The limits are those of value iteration over directions of x (floats: .778, .812, .847; .882 for
    kappa = 1.1), to some 1e-3; certificates end 2.3, 7.7, 18 and 33 per cent above them.
    """
    family, low = alternating(kappa), 0.999 * limit
    course = worst_switching(family, low, math.inf)
    assert course is not None
    assert refute_parameters(family, low, math.inf, course.word).outcome == "refuted"
    # beyond it the same word refutes nothing
    longer = followed(family, 1.002 * limit, math.inf, course.word)
    verdict = refute_parameters(family, 1.002 * limit, math.inf, longer.word)
    assert verdict.outcome == "undecided"


@pytest.mark.parametrize("row", range(4))
def test_table_5_as_printed_is_false(row: int) -> None:
    """B = [0; 1]: the end of the range with the faster plant alone diverges at the longest time."""
    family, longest = table_5(row, gain=1.0)
    verdict = decide_uncertain(family, 0.001, longest)
    assert verdict.outcome == "refuted"
    assert verdict.witness["p"] == [1.0]
    assert verdict.witness["spectral_radius"] > 4.7


@pytest.mark.parametrize(
    ("row", "proved", "refuted"),
    [(0, 26.3, 26.59), (1, 48.3, 48.87), (2, 29.9, 34.60), (3, 57.3, 58.98)],
)
def test_table_5_with_the_gain_of_system_60(row: int, proved: float, refuted: float) -> None:
    """B = [0; 0.1]: all rows hold, with more than twice the printed dwell times."""
    family, longest = table_5(row, gain=0.1)
    assert proved > 2 * longest
    verdict = find_clock_matrix(family, 0.001, proved)
    assert verdict.outcome == "proved"
    # and so does the printed range, which is shorter
    shorter = decide_uncertain(family, 0.001, longest)
    assert prove_cells(family, 0.001, longest, shorter.evidence).outcome == "proved"
    assert decide_uncertain(family, 0.001, refuted).outcome == "refuted"


def test_sampled_control_of_example_s4_leaves_little_open() -> None:
    """Pole and input gain +- 10 %: proved up to 1.56, refuted from 1.568 on."""
    assert decide_uncertain(sampled(0.1), 0.001, 1.56).outcome == "proved"
    assert decide_uncertain(sampled(0.1), 0.001, 1.568).outcome == "refuted"
