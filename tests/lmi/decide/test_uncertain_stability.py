"""Families with parameters: thresholds from both sides, and changes that change no verdict."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lmi.arithmetic.balls import exact, inverse
from lmi.decide.uncertain_stability import decide_uncertain
from lmi.parameters import AffineFamily
from lmi.prove.parameter_cells import prove_cells
from lmi.time_budget import TimeBudget
from tests.lmi.parameter_examples import (
    from_ranges,
    growing_or_reset,
    oscillator,
    sampled,
    table_5,
)


def outcome(family: AffineFamily, low: float, high: float) -> str:
    """The verdict; a certificate must prove it again, from the problem."""
    verdict = decide_uncertain(family, low, high)
    if verdict.outcome == "proved":
        assert prove_cells(family, low, high, verdict.evidence).outcome == "proved"
    return verdict.outcome


@pytest.mark.parametrize(
    ("radius", "expected"), [(0.0, "proved"), (0.142, "proved"), (0.21, "refuted")]
)
def test_stiffness_that_varies(radius: float, expected: str) -> None:
    assert outcome(oscillator(radius), 1.0, 3.0) == expected


@pytest.mark.parametrize("radius", [0.3, 0.9])
def test_stiffness_that_is_constant(radius: float) -> None:
    verdict = decide_uncertain(oscillator(radius, is_constant=True), 1.0, 3.0)
    assert verdict.outcome == "proved"
    assert 2 <= verdict.evidence["cells"] <= 12
    # the twin: varying, it is refuted
    assert outcome(oscillator(radius), 1.0, 3.0) == "refuted"


@pytest.mark.parametrize(
    ("radius", "proved", "refuted"),
    [(0.05, 1.6295, 1.6495), (0.5, 1.1267, 1.1467)],
)
def test_sampled_control_with_pole_and_gain_that_vary(
    radius: float, proved: float, refuted: float
) -> None:
    assert outcome(sampled(radius), 0.001, proved) == "proved"
    assert outcome(sampled(radius), 0.001, refuted) == "refuted"


def test_both_ends_of_the_dwell_time() -> None:
    """The exact limits are ln 1.2 and ln 2 / 1.3."""
    family, shortest, longest = growing_or_reset(0.1), math.log(1.2), math.log(2) / 1.3
    assert outcome(family, 1.001 * shortest, 0.999 * longest) == "proved"
    assert outcome(family, 0.999 * shortest, longest * 0.999) == "refuted"
    assert outcome(family, 1.001 * shortest, 1.001 * longest) == "refuted"


def test_a_flow_that_may_last_has_to_decay_under_parameters_that_switch() -> None:
    """Every constant stiffness decays, and one that switches four times a turn makes it grow."""
    effect = ([[0, 0], [-1, 0]], np.zeros((2, 2)))
    flow = [[0, 1], [-1, -0.1]]

    def family(radius: float) -> AffineFamily:
        return from_ranges(flow, 0.5 * np.eye(2), [effect], [(-radius, radius)])

    assert outcome(family(0.05), 0.0, math.inf) == "proved"
    verdict = decide_uncertain(family(0.3), 0.0, math.inf)
    assert verdict.outcome == "refuted"
    assert [stay["jump"] for stay in verdict.witness["stays"]] == [None]
    # the twin: with a jump in time it does decay
    assert outcome(family(0.3), 0.0, 1.0) == "proved"


def test_without_parameters_it_is_the_plant() -> None:
    family = from_ranges([[-1]], [[2.0]], [], [])
    assert outcome(family, math.log(2) + 1e-3, math.inf) == "proved"
    assert outcome(family, math.log(2) - 1e-3, math.inf) == "refuted"


def changed(family: AffineFamily, S: np.ndarray) -> AffineFamily:
    """The family in coordinates z = S^-1 x, exactly."""
    to, back = exact(S), inverse(exact(S))
    assert back is not None
    maps = [[back @ M @ to for M in parts] for parts in (family.A, family.G)]
    return AffineFamily(np.array(maps[0]), np.array(maps[1]), family.is_constant)


CASES = [(sampled(0.2), 0.001, 1.41), (sampled(0.2), 0.001, 1.4372)]


@pytest.mark.parametrize(("family", "low", "high"), CASES, ids=["proved", "refuted"])
class TestLaws:
    """Changes that are none change no verdict."""

    def test_coordinates(self, family: AffineFamily, low: float, high: float) -> None:
        expected = outcome(family, low, high)
        S = np.array([[1.0, 0.5, 0.0], [-0.25, 2.0, 0.125], [0.0, 1.0, 16.0]])
        assert outcome(changed(family, S), low, high) == expected
        units = np.diag([2.0**-20, 3e3, 1e7])
        assert outcome(changed(family, units), low, high) == expected

    @pytest.mark.parametrize("factor", [3600.0, 1e-6])
    def test_the_unit_of_time(
        self, family: AffineFamily, low: float, high: float, factor: float
    ) -> None:
        slower = AffineFamily(family.A / exact(factor), family.G, family.is_constant)
        assert outcome(slower, low * factor, high * factor) == outcome(family, low, high)

    def test_the_order_and_the_sign_of_parameters(
        self, family: AffineFamily, low: float, high: float
    ) -> None:
        expected, order = outcome(family, low, high), [0, 2, 1]
        swapped = AffineFamily(family.A[order], family.G[order], family.is_constant)
        assert outcome(swapped, low, high) == expected
        signs = exact([1, -1, -1])[:, None, None]
        negated = AffineFamily(family.A * signs, family.G * signs, family.is_constant)
        assert outcome(negated, low, high) == expected

    def test_a_parameter_in_two_halves(self, family: AffineFamily, low: float, high: float) -> None:
        parts = [
            np.concatenate([M[:1], M[1:2] / 4, M[1:2] * 3 / 4, M[2:]]) for M in (family.A, family.G)
        ]
        split = AffineFamily(parts[0], parts[1], (*family.is_constant, False))
        assert outcome(split, low, high) == outcome(family, low, high)


def test_a_range_that_is_none_is_refused() -> None:
    for low, high in ((-0.1, 1.0), (2.0, 1.0), (math.inf, math.inf)):
        with pytest.raises(ValueError, match="0 <= low <= high"):
            decide_uncertain(oscillator(0.1), low, high)


def test_undecided_names_the_growth_and_the_budget_that_ended() -> None:
    verdict = decide_uncertain(oscillator(0.17), 1.0, 3.0, budget=TimeBudget.from_seconds(0.2))
    assert verdict.outcome == "undecided"
    assert 0.9 < verdict.evidence["growth_per_jump"] < 1
    cells = decide_uncertain(
        oscillator(0.9, is_constant=True), 1.0, 3.0, budget=TimeBudget.from_seconds(1e-3)
    )
    assert cells.outcome == "undecided"
    assert cells.evidence["ended_by"] == "time"


def test_table_5_is_proved_with_a_gain_of_one_tenth() -> None:
    for row in (0, 3):
        family, longest = table_5(row, gain=0.1)
        assert outcome(family, 0.001, longest) == "proved"
