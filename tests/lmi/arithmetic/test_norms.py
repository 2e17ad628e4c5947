"""Norms and ranks in balls: enclosed within a few bits, decided on both sides of the threshold."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lmi.arithmetic.balls import ball, entries, exact, precision, scalar
from lmi.arithmetic.norms import (
    float_above,
    float_below,
    middles,
    nonnegative_inverse,
    spectral_norm,
    well_ranked,
)


@pytest.mark.parametrize("shape", [(1, 1), (2, 2), (3, 2), (2, 4), (5, 5)])
@pytest.mark.parametrize("unit", [1.0, 1e-200, 1e200])
def test_spectral_norms_are_enclosed_closely(shape: tuple[int, int], unit: float) -> None:
    X = np.random.default_rng(shape[0]).standard_normal(shape)
    with precision(256):
        norm = spectral_norm(entries(ball(exact(X))) * scalar(exact(unit).item()))
        low, high = (
            float((end / scalar(exact(unit).item())).mid()) for end in (norm.lower(), norm.upper())
        )
    truth = np.linalg.norm(X, 2)
    assert low <= truth * (1 + 1e-14)
    assert truth * (1 - 1e-14) <= high
    assert high - low < 1e-12 * truth


def test_norms_without_a_middle() -> None:
    with precision(128):
        assert spectral_norm(entries(ball(exact(np.zeros((2, 3)))))) == 0
        endless = scalar(1) / scalar(0)
        assert not spectral_norm(np.array([[endless]], dtype=object)).is_finite()
        # zero within a ball: its norm is zero or what the ball allows
        around = scalar(-2).union(scalar(2))
        norm = spectral_norm(np.array([[around]], dtype=object))
        assert norm.contains(0)
        assert norm.contains(2)


def test_a_rank_is_decided_on_both_sides_of_its_threshold() -> None:
    # least singular value 1, |X|_F = sqrt(1 + 9) whatever the basis
    turn = np.array([[3.0, -4.0], [4.0, 3.0]]) / 5
    X = np.vstack([turn @ np.diag([1.0, 3.0]) @ turn.T, np.zeros((1, 2))])
    ratio = 1 / math.sqrt(10)
    with precision(128):
        balls = entries(ball(exact(X)))
        above, below = (well_ranked(balls, ratio * (1 + room)) for room in (1e-9, -1e-9))
        wide = well_ranked(balls[:1], 1e-3)
        zero, close = well_ranked(0 * balls, 0.1), well_ranked(balls, ratio)
    assert below.outcome == "proved"
    assert above.outcome == "refuted"
    for verdict in (above, below, close):
        assert verdict.evidence["approx_ratio"] == pytest.approx(ratio)
    v = np.array(above.evidence["witness"]["vector"])
    assert np.linalg.norm(X @ v) < ratio * (1 + 1e-9) * np.linalg.norm(X) * np.linalg.norm(v)
    assert wide.outcome == "refuted"  # fewer rows than columns
    assert wide.evidence["approx_ratio"] == 0.0
    assert zero.outcome == "refuted"
    assert zero.evidence["approx_ratio"] == 0.0


@pytest.mark.parametrize("n", [1, 2, 4])
def test_inverses_of_small_gains(n: int) -> None:
    rng = np.random.default_rng(n)
    M = rng.random((n, n))
    M /= np.abs(np.linalg.eigvals(M)).max()
    with precision(128):
        balls = [[scalar(exact(0.99 * x).item()) for x in row] for row in M.tolist()]
        bound = nonnegative_inverse(balls)
        assert bound is not None
        truth = np.linalg.inv(np.eye(n) - 0.99 * M)
        np.testing.assert_allclose([[float(x) for x in row] for row in bound], truth, rtol=1e-9)
        # the twin: a gain of one and more
        for size in (1.0 + 1e-9, 2.0):
            assert nonnegative_inverse([[x * (size / 0.99) for x in row] for row in balls]) is None
        assert nonnegative_inverse([[scalar(1)]]) is None


def test_floats_beside_a_ball() -> None:
    with precision(200):
        third = scalar(1) / 3
        assert (
            scalar(exact(float_below(third)).item())
            < third
            < scalar(exact(float_above(third)).item())
        )
        assert float_above(third) - float_below(third) <= 2 * math.ulp(1 / 3)
        assert middles(np.array([[third, scalar(2)]], dtype=object)).tolist() == [[1 / 3, 2.0]]
