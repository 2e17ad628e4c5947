"""Which theorem proves that features determine an impulse, and where none does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lmi.arithmetic.balls import exact
from obsdesign.equations.impulsive_input.features import FeatureWindow
from obsdesign.verification.impulsive_input.uniqueness import (
    _by_theorem,
    _one_feature,
    _opposite,
    decide_uniqueness,
)


def method_of(D: list, C: list, H: list, count: int, tau: float = 3.0) -> str | None:
    window = FeatureWindow(
        exact(np.array(D, dtype=float)), exact(np.array(C, dtype=float)), exact(np.array(H, dtype=float)),
        exponents=-1.0 - np.arange(count), tau=tau, margin=0.1,
    )  # fmt: skip
    verdict = _by_theorem(window)
    if verdict is not None:
        assert verdict.outcome == "proved"
    return None if verdict is None else verdict.evidence["method"]


CHAIN = [[-1.0, 1.0], [0.0, -3.0]]
DIAGONAL = [[-1.0, 0.0], [0.0, -3.0]]


@pytest.mark.parametrize(
    ("D", "C", "H", "count", "method"),
    [
        (CHAIN, [[1, 0]], [[0], [1]], 2, "no zeros: b_i/b_j is strictly monotone"),
        (CHAIN, [[1, 0]], [[0], [1]], 1, None),
        # h = e^-s + e^-3s has no zero; e^-s - 2 e^-3s has one at log(2)/2
        (DIAGONAL, [[1, 1]], [[1], [1]], 3, "real spectrum, h without zero, 3 >= n + 1"),
        (DIAGONAL, [[1, 1]], [[-1], [-1]], 3, "real spectrum, h without zero, 3 >= n + 1"),
        (DIAGONAL, [[1, 1]], [[1], [1]], 2, None),
        (DIAGONAL, [[1, -2]], [[1], [1]], 3, None),
        (DIAGONAL, [[1, -2]], [[1], [1]], 4, "real spectrum and 4 >= 2 n exponents"),
        # an output that shows nothing; two directions need 2 n exponents and every state shown
        (DIAGONAL, [[1, 0]], [[0], [1]], 9, None),
        (DIAGONAL, [[1, 1]], [[1, 0], [0, 1]], 3, None),
        (DIAGONAL, [[1, 1]], [[1, 0], [0, 1]], 4, "real spectrum and 4 >= 2 n exponents"),
        (DIAGONAL, [[1, 0]], [[1, 0], [0, 1]], 9, None),
        (DIAGONAL, [[1, 1]], [[1, 2], [1, 2]], 9, None),
    ],
)
def test_the_theorem_that_decides(
    D: list, C: list, H: list, count: int, method: str | None
) -> None:
    assert method_of(D, C, H, count) == method


def test_a_zero_beyond_the_window_does_not_matter() -> None:
    # e^-s - 2 e^-3s vanishes at .3466
    short = "real spectrum, h without zero, 3 >= n + 1"
    assert method_of(DIAGONAL, [[1, -2]], [[1], [1]], 3, tau=0.25) == short
    assert method_of(DIAGONAL, [[1, -2]], [[1], [1]], 3, tau=0.35) is None
    # s e^-s vanishes at 0 alone, where it is divided by s
    assert method_of([[-1, 1], [0, -1]], [[1, 0.5]], [[0], [1]], 3) == short


def test_the_output_that_proves_it_is_named() -> None:
    window = FeatureWindow(
        exact(np.array(DIAGONAL)), exact(np.array([[1.0, -2.0], [1.0, 1.0]])), exact(np.ones((2, 1))),
        exponents=-1.0 - np.arange(3), tau=3.0, margin=0.1,
    )  # fmt: skip
    verdict = _by_theorem(window)
    assert verdict is not None
    assert verdict.evidence["output"] == 2


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_feature_takes_two_ages_of_one_sign(sign: float) -> None:
    # the feature of e^-s - 2 e^-3s changes its sign between the ages .45 and .8
    window = FeatureWindow(
        exact(np.array(DIAGONAL)), exact(np.array([[1.0, -2.0]])), exact(sign * np.ones((2, 1))),
        exponents=np.array([-9.0]), tau=0.8, margin=0.1,
    )  # fmt: skip
    verdict = _one_feature(window)
    assert verdict.outcome == "refuted"
    reason = verdict.evidence["witness"]["reason"]
    assert "weight -" not in reason


@pytest.mark.parametrize("growth", [-1.0, 0.5, 2.0])
@pytest.mark.parametrize("phase", [0.4, 1.0, 2.0, 4.0])
def test_opposite_features_are_half_a_turn_apart(growth: float, phase: float) -> None:
    speed, margin, step = 1.1, 0.5, 0.1
    angle, size = speed * step * np.arange(60) + phase, np.exp(growth * step * np.arange(60))
    b = size[:, None] * np.column_stack([np.cos(angle), np.zeros(60), np.sin(angle)])
    age = _opposite(b, 0, 2, margin, step)
    assert age == pytest.approx(margin + math.pi / speed, abs=step / 2)
    # a turn that ends before that, and features that do not turn
    assert _opposite(b[:28], 0, 2, margin, step) is None
    assert _opposite(b, 0, 1, margin, step) is None


@pytest.mark.parametrize("unit", [-30, 0, 30])
@pytest.mark.parametrize(("speed", "outcome"), [(0.8, "proved"), (8.0, "refuted")])
def test_units_of_time_do_not_decide(unit: int, speed: float, outcome: str) -> None:
    time = 2.0**unit
    D = np.array([[-0.3, speed], [-speed, -0.3]]) / time
    window = FeatureWindow(
        exact(D), exact([[0.0, 1.0]]), exact([[1.0], [0.0]]),
        exponents=-np.array([1.0, 2.0]) / time, tau=3.0 * time, margin=0.1 * time,
    )  # fmt: skip
    verdict = decide_uniqueness(window)
    assert verdict.outcome == outcome
