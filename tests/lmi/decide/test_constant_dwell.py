"""A range that is one dwell time: decided on both sides of spectral radius 1, however close."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lmi.arithmetic.balls import ball, exact, precision
from lmi.decide.stability import decide
from lmi.prove.hurwitz import schur
from lmi.refute.spectral import decide_constant
from obsdesign.verification.dwell import Dwell, dwell_stability

# M(1) = T B T^-1 with integer entries, F nilpotent: the spectral radius is known exactly
NILPOTENT = np.array([[0.0, 1, 0], [0, 0, 1], [0, 0, 0]])
UNDONE = np.array([[1.0, -1, 0.5], [0, 1, -1], [0, 0, 1]])  # e^{-F}
T, T_INVERSE = np.array([[1.0, 2, 0], [0, 1, 3], [0, 0, 1]]), np.array([[1.0, -2, 6], [0, 1, -3], [0, 0, 1]])  # fmt: skip
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0.5]])  # eigenvalues +-i, 0.5
FLIP = np.diag([-1.0, 0.25, 0.5])
JORDAN = np.array([[1.0, 64, 0], [0, 1, 64], [0, 0, 1]])


def jump(shape: np.ndarray, factor: float) -> np.ndarray:
    """H, exact, with e^F H = factor T shape T^-1."""
    return exact(np.array([[factor]])) * (exact(UNDONE) @ exact(T) @ exact(shape) @ exact(T_INVERSE))  # fmt: skip


@pytest.mark.parametrize("shape", [TURN, FLIP, JORDAN], ids=["turn", "flip", "jordan"])
@pytest.mark.parametrize("away", [1e-3, 1e-9, 1e-12, 2.0**-52])
def test_both_sides_of_the_limit_are_decided(shape: np.ndarray, away: float) -> None:
    F = exact(NILPOTENT)
    for factor, outcome in ((1 - away, "proved"), (1 + away, "refuted")):
        H = jump(shape, factor)
        assert decide(F, H, 1.0, 1.0).outcome == outcome
        # what a verifier finds without any certificate
        assert dwell_stability(F, H, Dwell(1.0, 1.0), {}, False).outcome == outcome


def test_the_limit_itself_is_never_proved() -> None:
    verdict = decide(exact(NILPOTENT), jump(TURN, 1.0), 1.0, 1.0)
    assert verdict.outcome == "undecided"
    assert "the spectral radius at dwell time 1.0 is 1" in verdict.evidence["reason"]
    assert decide([[0.0]], [[1.0]], 1.0, 1.0).outcome == "refuted"  # a state that stays, exactly
    assert decide([[-1.0]], [[1.0]], 0.0, 0.0).outcome == "refuted"


@pytest.mark.parametrize("away", [1e-6, 1e-12])
def test_transcendental_maps_and_units(away: float) -> None:
    # a rotation by 1 in ellipses, whose radius e^{-theta} gain is 1 at theta = ln gain
    D = np.array([3e7, 2e-8])
    F = D[:, None] * np.array([[-1.0, 1], [-1, -1]]) / D
    H, limit = 2 * np.eye(2), math.log(2)
    assert decide(F, H, limit * (1 + away), limit * (1 + away)).outcome == "proved"
    assert decide(F, H, limit * (1 - away), limit * (1 - away)).outcome == "refuted"
    # a range is more than its ends: the same numbers, not one dwell time
    assert decide(F, H, limit * (1 - away), 1.0).outcome == "refuted"


@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_the_schur_cohn_test_agrees_with_eigenvalues(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(10):
        M = rng.standard_normal((n, n))
        M /= np.abs(np.linalg.eigvals(M)).max()
        with precision(320):
            assert schur(ball(exact(0.999 * M))) is True
            assert schur(ball(exact(1.001 * M))) is False
    with precision(80):  # balls that hold both kinds: no answer
        wide = ball(exact(np.array([[1.0]]))) * ball(exact(np.array([[1 / 3]]))) * 3
        assert schur(wide) in (None, False, True)
        assert decide_constant([[0.0]], [[1 - 2.0**-53]], 1.0).outcome == "proved"
