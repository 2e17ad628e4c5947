"""Second answers to (17): every witness holds when evaluated anew, and none contradicts a theorem."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lmi.balls import exact
from lmi.exponential import expm
from obsdesign.equations.impulsive_input import filtered_system
from obsdesign.verification.uniqueness import decide_uniqueness

TWO_MODES = (np.diag([-0.5, -1.0]), np.array([[1.0, 1.0]]), np.array([[2.0], [-3.0]]))


def features(D: Any, C: Any, H: Any, exponents: Any, age: float) -> Any:
    n = len(D)
    return expm(filtered_system(D, C, np.asarray(exponents)) * age)[n:, :n] @ H[:, 0]


def decided(D: Any, C: Any, H: Any, exponents: Any, window: float, margin: float) -> Any:
    return decide_uniqueness(exact(D), exact(C), exact(H), list(exponents), window, margin)


def middle(age: Any) -> float:
    return float(np.mean(age))


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_three_features_of_random_plants(seed: int) -> None:
    rng = np.random.default_rng(seed)
    refuted = 0
    for _ in range(4):
        n = int(rng.integers(2, 4))
        D = np.diag(-rng.uniform(0.2, 2, n))
        if n == 3:  # a pair of complex modes
            D[:2, :2] = [[-0.2, 2.0], [-2.0, -0.2]]
        C, H = rng.standard_normal((1, n)), rng.standard_normal((n, 1))
        exponents, window, margin = -np.cumsum(rng.uniform(0.3, 1.0, 3)), 5.0, 0.2
        found = decided(D, C, H, exponents, window, margin)
        if found.outcome != "refuted":
            continue
        refuted += 1
        witness = found.evidence["witness"]
        first, second = map(middle, witness["ages"])
        assert margin <= first < second <= window
        b1, b2 = (features(D, C, H, exponents, age) for age in (first, second))
        g1, g2 = witness["weights"]
        np.testing.assert_allclose(g1 * b1, g2 * b2, atol=1e-6 * np.abs(b1).max())
    assert refuted


def test_three_outputs_may_share_a_second_answer_too() -> None:
    D, C, H = TWO_MODES
    again = np.vstack([C, 2 * C, C])  # the same output: three features of one exponent each
    assert decided(D, again, H, [-2.0], 5.0, 0.1).outcome != "proved"


def test_outside_the_ages_that_are_searched_a_second_answer_does_not_count() -> None:
    D, C, H = TWO_MODES
    for margin, window, outcome in ((0.1, 5.0, "refuted"), (0.6, 5.0, "undecided"),
                                    (0.1, 2.1, "undecided"), (0.5, 2.2, "refuted")):  # fmt: skip
        found = decided(D, C, H, [-2.0, -3.0, -4.0], window, margin)
        # elsewhere it may be proved: the plane curve may turn one way
        assert found.outcome == outcome or (found.outcome, outcome) == ("proved", "undecided")


def test_a_plant_without_zeros_has_none() -> None:
    D = np.array([[-0.5, 0.0], [1.0, -1.0]])
    found = decided(D, np.array([[0.0, 1.0]]), np.array([[1.0], [0.0]]), [-2, -3, -4], 5.0, 0.1)
    assert found.outcome == "proved"
