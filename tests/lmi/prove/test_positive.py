"""Vectors for positive systems: proofs, their twins, and brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.balls import ball, exact, number, precision
from lmi.arithmetic.exponential import expm
from lmi.find.copositive import decide_copositive, propose_vector
from lmi.prove.positive import FORMS, SIDES, _lifted, prove_copositive

W1, N1 = np.array([[-1.0, 0], [1, -3]]), np.array([[2.0, 0], [1, 0.2]])  # example 4.1
W3, N3 = np.array([[-1.0, 0], [4, -1]]), np.array([[3.0, 1], [1, 3]])  # width pair of 4.3
ROUNDING = 1e-9


@pytest.mark.parametrize(("F", "H", "limit"), [(W1, N1, math.log(2)), (W3, N3, 2.8221351564360697)])
def test_limits_of_the_examples(F: np.ndarray, H: np.ndarray, limit: float) -> None:
    assert decide_copositive(F, H, limit * (1 + 1e-5), math.inf).outcome == "proved"
    assert decide_copositive(F, H, limit * (1 - 1e-5), math.inf).outcome == "undecided"


def test_one_exponential_decides_where_the_flow_shrinks_the_vector() -> None:
    v = np.array([1.0, 1e-5])
    verdict = prove_copositive(W1, N1, v, 0.6932, math.inf)
    assert (verdict.outcome, verdict.evidence["steps"]) == ("proved", 1)
    assert prove_copositive(W1, N1, v, 0.6931, math.inf).outcome == "undecided"


def positive_system(seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    F = rng.random((n, n)) * (rng.random((n, n)) < 0.7)
    F -= np.diag(np.diag(F) + rng.uniform(-0.5, 2.0, n))
    H = rng.random((n, n)) * (rng.random((n, n)) < 0.7)
    maps = expm(F * np.linspace(0.1, 2.0, 60)[:, None, None]) @ H
    worst = max(np.abs(np.linalg.eigvals(maps)).max(), 1e-3)
    return F, H * rng.uniform(0.5, 0.99) / worst


def operators(F: np.ndarray, H: np.ndarray, side: str, form: str) -> np.ndarray:
    """X(theta) with the condition X v < v."""
    flows = expm(F * np.linspace(0.1, 2.0, 400)[:, None, None])
    maps = flows @ H if form == "before_jump" else H @ flows
    return np.swapaxes(maps, 1, 2) if side == "left" else maps


@settings(max_examples=16, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), n=st.integers(1, 5),
    side=st.sampled_from(SIDES), form=st.sampled_from(FORMS),
)  # fmt: skip
def test_a_proof_holds_and_spoilt_vectors_are_not_proved(
    seed: int, n: int, side: str, form: str
) -> None:
    F, H = positive_system(seed, n)
    v = propose_vector(F, H, 0.1, 2.0, side=side, form=form)
    if v is None:
        return
    verdict = prove_copositive(F, H, v, 0.1, 2.0, side=side, form=form)
    X = operators(F, H, side, form)
    if verdict.outcome == "proved":
        assert (X @ v / v).max() < 1 + ROUNDING
        # any order of dwell times: the weighted norm never grows, so products vanish
        product = np.eye(n)
        for k in np.random.default_rng(seed).integers(0, 400, 200):
            product = X[k] @ product
        assert np.abs(product).max() <= (v.max() / v.min()) * (1 + ROUNDING)
    for spoilt in (-v, 0 * v, v * np.nan, v[:-1]):
        assert prove_copositive(F, H, spoilt, 0.1, 2.0, side=side, form=form).outcome == "undecided"
    assert (
        prove_copositive(F, 100 * H + 2, v, 0.1, 2.0, side=side, form=form).outcome == "undecided"
    )


def test_what_is_not_positive_is_not_proved() -> None:
    v = np.ones(2)
    assert prove_copositive([[-1, -0.1], [0, -1]], 0.1 * np.eye(2), v, 0, 1).outcome == "undecided"
    assert prove_copositive(-np.eye(2), [[0.1, -0.1], [0, 0.1]], v, 0, 1).outcome == "undecided"
    assert prove_copositive(-np.eye(2), 0.1 * np.eye(2), v, 0, 1).outcome == "proved"


def test_sixteen_states_and_more() -> None:
    rng = np.random.default_rng(0)
    n = 24
    F = rng.random((n, n))
    F -= np.diag(F.sum(axis=1) + 0.5)
    H = 1.6 / n * rng.random((n, n))
    assert decide_copositive(F, H, 0.1, math.inf).outcome == "proved"
    assert decide_copositive(F, 2 * H, 0.1, math.inf).outcome == "undecided"


def test_a_lifted_row_is_above_the_row_and_has_no_zeros() -> None:
    with precision(80):
        row = ball(exact([[0.0, 1e-30, 2.0]]))
        lift = [number(1e-9), number(2e-9), number(3e-9)]
        lifted = _lifted(row, lift).entries()
        for low, more, high in zip(row.entries(), lift, lifted, strict=True):
            assert high > low
            assert high > 0
            assert not high > low + 2 * more
