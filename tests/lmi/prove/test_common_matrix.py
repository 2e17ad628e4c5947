from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.balls import ball, exact, number, precision
from lmi.arithmetic.exponential import expm
from lmi.find.cutting_plane import propose
from lmi.prove.bernstein import _Series
from lmi.prove.common_matrix import prove_common
from tests.systems.pairs import BALL, MINIMAL_43, PAPER_41, WIDTH_43, random_pair


def prove(pair: tuple, P: np.ndarray, low: float, high: float, **options: object) -> str:
    return prove_common(*pair, P, low, high, **options).outcome


def common_matrix(pair: tuple, low: float, high: float) -> np.ndarray:
    P = propose(*pair, low, high).P
    assert P is not None
    return P


@pytest.mark.parametrize(
    ("pair", "low", "too_low"),
    [
        (PAPER_41, 0.70, 0.6931),
        (PAPER_41, 0.6932, 0.6580),
        (WIDTH_43, 2.823, 2.7579),
        (MINIMAL_43, 1.885, 1.884),
    ],
)
def test_the_published_ranges(pair: tuple, low: float, too_low: float) -> None:
    P = common_matrix(pair, low, math.inf)
    assert prove(pair, P, low, math.inf) == "proved"
    # twins: a range beyond the threshold, P with a sign flipped, P visibly perturbed
    assert prove(pair, P, too_low, math.inf) == "undecided"
    assert prove(pair, -P, low, math.inf) == "undecided"
    assert prove(pair, P[::-1, ::-1].copy(), low, math.inf) == "undecided"


def test_a_bounded_range_needs_no_decay() -> None:
    P = common_matrix(BALL, 0.0, 5.0)
    assert prove(BALL, P, 0.0, 5.0) == "proved"
    # twin: without a longest dwell time the flow itself must decay
    verdict = prove_common(*BALL, P, 0.0, math.inf)
    assert verdict.outcome == "undecided"
    assert verdict.evidence["reason"] == "the flow is not proved to be Hurwitz"


def test_a_failed_proof_says_where() -> None:
    # M(theta) = e^{-theta} 1.5 in one dimension: below 1 from ln 1.5 = 0.405 on
    pair = (np.array([[-1.0]]), np.array([[1.5]]))
    verdict = prove_common(*pair, [[1.0]], 0.3, 2.0)
    theta = verdict.evidence["theta"]
    assert verdict.outcome == "undecided"
    assert 0.3 <= theta <= 0.405466
    assert 1.5 * math.exp(-theta) >= 1
    assert prove(pair, np.array([[1.0]]), 0.4055, 2.0) == "proved"
    assert prove(pair, np.array([[1.0]]), 0.4054, 2.0) == "undecided"


def test_strictness_is_exact() -> None:
    # theta = 0: M = H, and H'PH = P is not H'PH < P
    assert prove(([[-1.0]], [[1.0]]), np.array([[1.0]]), 0.0, 0.0) == "undecided"
    assert prove(([[-1.0]], [[1.0 - 1e-11]]), np.array([[1.0]]), 0.0, 0.0) == "proved"


@pytest.mark.parametrize("P", [[[np.nan]], [[np.inf]], [[0.0]], [[-1.0]]])
def test_P_must_be_positive_definite(P: list) -> None:
    assert prove(([[-1.0]], [[0.5]]), np.array(P), 0.0, 1.0) == "undecided"


def test_P_must_be_symmetric() -> None:
    P = np.array([[1.0, 0.1], [0.0, 1.0]])
    assert prove((-np.eye(2), 0.1 * np.eye(2)), P, 0.0, 1.0) == "undecided"
    assert prove((-np.eye(2), 0.1 * np.eye(2)), P + P.T, 0.0, 1.0) == "proved"


def test_overflow_is_not_a_proof() -> None:
    P = np.eye(2)
    rotation = 1e160 * np.array([[0.0, 1], [-1, 0]])
    assert prove((rotation, 2 * np.eye(2)), P, 0.0, 1.0) == "undecided"
    assert prove((1e308 * np.eye(2), 0.5 * np.eye(2)), P, 0.0, 1.0) == "undecided"
    assert prove((-np.eye(2), 1e308 * np.ones((2, 2))), P, 0.0, 1.0) == "undecided"
    assert prove((np.eye(2), 0.5 * np.eye(2)), P, 0.0, 1e308) == "undecided"


def test_degenerate_is_ordinary() -> None:
    F = np.array([[0.0, 1], [-1, -0.1]])
    assert prove((F, np.zeros((2, 2))), np.eye(2), 0.0, math.inf) == "proved"
    assert prove((F, np.diag([0.5, 0.0])), np.eye(2), 0.0, 3.0) == "proved"  # singular H
    assert prove((F, 0.5 * np.eye(2)), np.eye(2), 0.7, 0.7) == "proved"
    assert prove((0 * F, 0.5 * np.eye(2)), np.eye(2), 0.0, 1e6) == "proved"


def test_a_range_must_be_one() -> None:
    with pytest.raises(ValueError, match=r"0 <= low <= high is required; got \[2.0, 1.0\]"):
        prove_common([[-1.0]], [[0.5]], [[1.0]], 2.0, 1.0)


@settings(max_examples=12, deadline=None)
@given(st.integers(1, 5), st.integers(0, 100_000))
def test_random_dwell_times_never_contradict_a_proof(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    F, H = random_pair(rng, n, rng.uniform(0.3, 1.2))
    low, high = 0.1, 2.0
    proposal = propose(F, H, low, high)
    if proposal.P is None or prove((F, H), proposal.P, low, high) != "proved":
        return
    thetas = rng.uniform(low, high, 200)
    M = expm(F * thetas[:, None, None]) @ H
    remainder = proposal.P - np.swapaxes(M, 1, 2) @ proposal.P @ M
    assert np.linalg.eigvalsh(remainder).min() > 0


@settings(max_examples=15, deadline=None)
@given(st.integers(1, 4), st.integers(0, 100_000))
def test_a_smaller_range_never_hurts(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    F, H = random_pair(rng, n, 0.7)
    P = propose(F, H, 0.1, 2.0).P
    if P is None or prove((F, H), P, 0.1, 2.0) != "proved":
        return
    low, high = np.sort(rng.uniform(0.1, 2.0, 2))
    assert prove((F, H), P, low, high) == "proved"
    # and neither a smaller jump
    assert prove((F, 0.9 * H), P, 0.1, 2.0) == "proved"


@pytest.mark.parametrize("rate", [0.0, 1e-21, -1e-3])
def test_ranges_whose_powers_overflow(rate: float) -> None:
    assert prove_common([[rate]], [[0.5]], [[1.0]], 1.0, 1e20).outcome == "proved"
    # e^{1e-20 1e20} = e exceeds what the jump takes away
    assert prove_common([[1e-20]], [[0.5]], [[1.0]], 1.0, 1e20).outcome == "undecided"


@pytest.mark.parametrize(("f", "h"), [(1.0, 0.5), (5.0, 1.0), (2000.0, 1e-3), (1e-3, 2000.0)])
def test_the_remainder_of_a_box_is_above_the_series_and_close_to_it(f: float, h: float) -> None:
    # N(u) = e^(f u): the terms of e^(2 f u) of degree above 8, all signs positive
    with precision(256):
        one: Any = SimpleNamespace(left=ball(exact([[1.0]])), F=ball(exact([[f]])))
        series = _Series.from_family(one)
        remainder = series.remainder(number(1.0), number(h))
        assert remainder is not None
        z = 2 * number(f) * number(h)
        truth = z.exp() - sum((z**k / math.factorial(k) for k in range(1, 9)), number(1.0))
        assert remainder > truth
        assert remainder < truth * (1 + 1e-3)
        assert series.remainder(number(1.0), number(40.0 / f)) is None
