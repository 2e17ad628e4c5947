"""Forms that flow and jumps leave alone, and multipliers against a common P; twins."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from lmi.arithmetic.balls import exact
from lmi.refute.infeasible import prove_no_common
from lmi.refute.invariant_form import LARGEST, invariant_form

TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("n", [2, 4])
def test_a_form_is_left_alone_and_its_twin_is_not(sign: int, n: int) -> None:
    rng = np.random.default_rng(n)
    S = np.triu(rng.integers(1, 3, (n, n)).astype(float))
    S_inverse = np.round(np.linalg.inv(S) * 2**n) / 2**n  # exact: the entries of S are 1 and 2
    assert (S @ S_inverse == np.eye(n)).all()
    F = np.kron(np.diag(np.arange(1.0, n // 2 + 1)), TURN)
    # the twin: what grows at jumps
    H = np.kron(np.eye(n // 2), np.diag([1.0, -1.0])) if sign == 1 else 2 * np.eye(n)
    F, H = S @ F @ S_inverse, S @ H @ S_inverse
    Q = invariant_form(exact(F), exact(H))
    if sign == -1:
        assert Q is None
        return
    assert Q is not None
    assert (Q == Q.T).all()
    assert np.abs(Q).max() == 1.0
    np.testing.assert_allclose(F.T @ Q + Q @ F, 0, atol=1e-9)
    np.testing.assert_allclose(np.abs(H.T @ Q @ H), np.abs(Q), atol=1e-9)


def test_a_form_that_jumps_turn_round() -> None:
    # x1 x2: the flow keeps it, the jump (x2, -x1) takes it to its negative
    F, H = np.diag([1.0, -1.0]), np.array([[0.0, 1.0], [-1.0, 0.0]])
    Q = invariant_form(exact(F), exact(H))
    assert Q is not None
    assert np.abs(Q).tolist() == [[0.0, 1.0], [1.0, 0.0]]
    assert invariant_form(exact(F), exact(0.999 * H)) is None
    assert invariant_form(exact(F - 1e-6 * np.eye(2)), exact(H)) is None


def test_more_states_than_are_looked_at() -> None:
    for n in (4, LARGEST + 1):
        F, H = np.zeros((n, n)), np.eye(n)
        assert (invariant_form(exact(F), exact(H)) is None) is (n > LARGEST)


# --- multipliers ------------------------------------------------------------------------------


def test_multipliers_rule_out_a_common_matrix() -> None:
    # M = 1.1 e^{-theta}: no P at theta = 0, as 1.21 Z - Z > 0; one at theta = 1
    F, H = [[-1.0]], [[1.1]]
    verdict = prove_no_common(F, H, [0.0], [[[2.0]]])
    assert verdict.outcome == "proved"
    assert verdict.evidence["thetas"] == [0.0]
    assert verdict.evidence["multipliers"] == [[[2.0]]]
    assert prove_no_common(F, H, [1.0], [[[2.0]]]).outcome == "undecided"
    # up to theta = log 1.1 = .0953, and not from there on
    assert prove_no_common(F, H, [0.0953], [[[1.0]]]).outcome == "proved"
    assert prove_no_common(F, H, [0.0954], [[[1.0]]]).outcome == "undecided"
    # a weight on a theta that shrinks counts against it
    assert prove_no_common(F, H, [0.0, 1.0], [[[9.0]], [[0.1]]]).outcome == "proved"
    assert prove_no_common(F, H, [0.0, 1.0], [[[0.1]], [[9.0]]]).outcome == "undecided"


@pytest.mark.parametrize("seed", range(4))
def test_multipliers_of_two_states(seed: int) -> None:
    rng = np.random.default_rng(seed)
    F, H = rng.standard_normal((2, 2, 2))
    M = expm(F * 0.5) @ H
    # M Z M' - Z > 0 for Z = sum_k M^-k M^-k', where all modes of M grow
    H = H * (1.2 / np.abs(np.linalg.eigvals(M)).min())
    M = expm(F * 0.5) @ H
    back = np.linalg.inv(M)
    Z = sum(
        np.linalg.matrix_power(back, k) @ np.linalg.matrix_power(back, k).T for k in range(1, 200)
    )
    Z = (Z + Z.T) / 2
    assert prove_no_common(F, H, [0.5], [Z]).outcome == "proved"
    assert prove_no_common(F, 0.1 * H, [0.5], [Z]).outcome == "undecided"
    assert prove_no_common(F, H, [0.5], [-Z]).outcome == "undecided"


@pytest.mark.parametrize(
    "multipliers",
    [
        [],
        [[[1.0]], [[1.0]]],
        [[1.0]],
        [[[math.nan]]],
        [[[math.inf]]],
        [[[1.0, 0.0], [0.0, 1.0]]],
        [[[0.0]]],
    ],
)
def test_what_is_no_multiplier(multipliers: list) -> None:
    assert prove_no_common([[-1.0]], [[1.1]], [0.0], [[[1.0]]]).outcome == "proved"
    assert prove_no_common([[-1.0]], [[1.1]], [0.0], multipliers).outcome == "undecided"


def test_multipliers_are_symmetric() -> None:
    H = 1.5 * np.eye(2)
    assert prove_no_common(np.zeros((2, 2)), H, [0.0], [np.eye(2)]).outcome == "proved"
    skew = np.array([[1.0, 0.1], [-0.1, 1.0]])
    assert prove_no_common(np.zeros((2, 2)), H, [0.0], [skew]).outcome == "undecided"
