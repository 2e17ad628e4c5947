"""Lemmas 1 and 2 of Mazenc and Ahmed, on random matrices; and what the printed hypotheses need."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from obsdesign.equations.finite_time import condition_13

SEEDS = st.integers(0, 2**31)
ROUNDING = 1 + 1e-9


def norm(X: np.ndarray) -> float:
    return float(np.linalg.norm(X, 2))


@settings(deadline=None, max_examples=60)
@given(seed=SEEDS, n=st.integers(1, 5), share=st.floats(0.01, 0.99), slack=st.floats(1, 1.5))
def test_lemma_1(seed: int, n: int, share: float, slack: float) -> None:
    """(3) implies that M + N is regular and (4), for any bounds m >= |M^-1| and n >= |N|."""
    rng = np.random.default_rng(seed)
    M, N = rng.standard_normal((2, n, n))
    m = slack * norm(np.linalg.inv(M))
    assume(m < 1e6)
    size = share / m
    N *= size / slack / norm(N)
    error = norm(np.linalg.inv(M + N) - np.linalg.inv(M))
    assert error <= m**2 * size / (1 - m * size) * ROUNDING + 1e-12 * m


def test_lemma_1_is_attained_and_needs_3() -> None:
    # scalars: M = 1, N = -n gives 1/(1 - n) - 1 = n/(1 - n); at n = 1 nothing is left of M + N
    for size in (0.1, 0.9):
        assert abs(1 / (1 - size) - 1) == pytest.approx(size / (1 - size))
    assert np.linalg.matrix_rank(np.eye(2) - np.diag([1.0, 0.5])) == 1


def solution(A: np.ndarray, pieces: np.ndarray, h: float) -> np.ndarray:
    """phi(t, 0) of z' = (A + E) z where E is constant on pieces of length h."""
    phi = np.eye(len(A))
    for E in pieces:
        phi = expm((A + E) * h) @ phi
    return phi


@settings(deadline=None, max_examples=40)
@given(seed=SEEDS, n=st.integers(1, 4), count=st.integers(1, 6), t=st.floats(0.01, 3),
       size=st.floats(1e-3, 2))  # fmt: skip
def test_lemma_2(seed: int, n: int, count: int, t: float, size: float) -> None:
    """|phi - e^(A t)| is at most e^(|A| t) (e^(s t) - 1) (Dyson), and that at most G(t, s)."""
    rng = np.random.default_rng(seed)
    A, pieces = rng.standard_normal((n, n)), rng.standard_normal((count, n, n))
    pieces *= size / np.array([norm(E) for E in pieces])[:, None, None]
    error = norm(solution(A, pieces, t / count) - expm(A * t))
    dyson = np.exp(norm(A) * t) * np.expm1(size * t)
    assert error <= dyson * ROUNDING + 1e-12 * np.exp(norm(A) * t)
    assert np.log(dyson) <= condition_13.log_sigma(t, norm(A), size) + 1e-9


def test_lemma_2_without_a_flow_is_the_limit() -> None:
    # A = 0: (e^(2 a t) - 1) / (2 a) becomes t, and G = s t e^(s t) is above e^(s t) - 1
    for s, t in ((0.5, 1.0), (2.0, 3.0)):
        assert condition_13.sigma(t, 0.0, s) == pytest.approx(s * t * np.exp(s * t))
        error = norm(solution(np.zeros((2, 2)), s * np.eye(2)[None], t) - np.eye(2))
        assert error == pytest.approx(np.expm1(s * t))
        assert error <= condition_13.sigma(t, 0.0, s)
