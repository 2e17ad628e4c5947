"""Norms over a range of theta: above every value of a fine grid, and close to the largest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from lmi.arithmetic.balls import exact, precision
from lmi.bounds.largest_norm import inverse_norm_over, norm_of, norm_over


@pytest.mark.parametrize("seed", range(6))
def test_norms_over_a_range_are_enclosed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 1 + seed % 3
    left, F, right = rng.standard_normal((3, n, n)) + 2 * np.eye(n)
    F *= 10.0 ** rng.uniform(-1, 0.5)
    low, high = sorted(rng.uniform(0, 2, 2))
    flows = [left @ expm(F * theta) @ right for theta in np.linspace(low, high, 200)]
    largest = max(np.linalg.norm(X, 2) for X in flows)
    inverse = max(np.linalg.norm(np.linalg.inv(X), 2) for X in flows)
    with precision(128):
        parts = exact(left), exact(F), exact(right)
        above, back = norm_over(*parts, low, high), inverse_norm_over(*parts, low, high)
        assert back is not None
    slack = n ** (1 / 8)  # of norm_bound
    assert largest * (1 - 1e-12) <= float(above.upper()) <= 1.5 * slack * largest
    assert inverse * (1 - 1e-12) <= float(back.upper()) <= 1.5 * slack * inverse


def test_numbers_by_hand() -> None:
    with precision(128):
        one = (exact([[2.0]]), exact([[1.0]]), exact([[3.0]]))
        assert float(norm_over(*one, 0.0, 1.0).upper()) == pytest.approx(6 * math.e, rel=0.11)
        assert float(inverse_norm_over(*one, 0.0, 1.0).upper()) == pytest.approx(1 / 6, rel=0.03)
        # cos vanishes in the range: no inverse is certain; the twin stops before it
        turn, C = exact([[0.0, 1.0], [-1.0, 0.0]]), exact([[1.0, 0.0]])
        assert inverse_norm_over(C, turn, C.T, 0.0, 2.0) is None
        assert inverse_norm_over(C, turn, C.T, 0.0, 1.0) is not None


def test_norm_of_an_exact_matrix() -> None:
    assert norm_of(exact(np.zeros((2, 2)))) == 0
    assert norm_of(exact(np.zeros((0, 2)))) == 0
    assert 5 <= float(norm_of(exact([[3.0, 4.0]])).upper()) < 5 + 1e-9
    assert 2 <= float(norm_of(exact(np.diag([2.0, -1.0]))).upper()) < 2.01
