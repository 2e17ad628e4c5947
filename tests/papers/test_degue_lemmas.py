"""Degue, Efimov, Richard (NOLCOS 2016): lemmas, hypotheses and unnumbered statements."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import linprog

import obsdesign
from lmi.prove.common_matrix import prove_common
from lmi.prove.hurwitz import prove_hurwitz
from lmi.prove.positive import prove_copositive
from obsdesign.equations.interval.splits import metzler_split, nonnegative_split, positive_part
from tests.papers.test_degue import (
    A1,
    G1,
    L1,
    M1,
    PRINTED_S1,
    PRINTED_S2,
    C,
    investigate,
    investigate_with,
)

# --- Section 2: bounds of a product, positive systems, Lyapunov functions -----------------------


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4), m=st.integers(1, 4))
def test_lemma_1_holds_is_attained_and_is_a_midpoint_with_a_radius(
    seed: int, n: int, m: int
) -> None:
    rng = np.random.default_rng(seed)
    A, lower = rng.standard_normal((m, n)), rng.standard_normal(n)
    upper = lower + rng.random(n)
    plus, minus = positive_part(A), positive_part(-A)
    low, high = plus @ lower - minus @ upper, plus @ upper - minus @ lower
    corners = np.array(list(itertools.product(*zip(lower, upper, strict=True))))
    np.testing.assert_allclose((corners @ A.T).min(axis=0), low, atol=1e-12)
    np.testing.assert_allclose((corners @ A.T).max(axis=0), high, atol=1e-12)
    middle, radius = A @ (lower + upper) / 2, np.abs(A) @ (upper - lower) / 2
    np.testing.assert_allclose([middle - radius, middle + radius], [low, high], atol=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
def test_positive_systems_stay_nonnegative(sign: int) -> None:
    """Sections 2.3 and 2.4, states and outputs; the twin has one entry of the wrong sign."""
    rng = np.random.default_rng(3)
    A, B, C, D = (rng.random(shape) for shape in ((3, 3), (3, 2), (2, 3), (2, 2)))
    A[0, 1] *= sign
    flow = A - 2 * np.eye(3)
    assert (metzler_split(flow)[1] == 0).all() == (sign > 0)
    assert (nonnegative_split(A)[1] == 0).all() == (sign > 0)
    step, smallest = expm(np.block([[flow, B], [np.zeros((2, 5))]]) * 0.05)[:3], []
    for start in np.eye(3):
        x, z = start, start
        for _ in range(40):
            omega = rng.random(2) * 0.1
            x, z = step @ [*x, *omega], A @ z + B @ omega
            smallest += [x.min(), z.min(), *(C @ x + D @ omega), *(C @ z + D @ omega)]
    assert (min(smallest) >= 0) == (sign > 0)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_a_metzler_matrix_decays_where_the_linear_program_has_a_solution(n: int) -> None:
    """Section 2.3; strict as A' lambda <= -1, which scales."""
    rng, answers = np.random.default_rng(n), []
    for _ in range(20):
        F = rng.random((n, n)) - np.diag(rng.uniform(0, n + 0.5, n))
        F[~np.eye(n, dtype=bool)] *= rng.random() < 0.8
        solution = linprog(np.ones(n), A_ub=F.T, b_ub=-np.ones(n), bounds=(0, None))
        verdict = prove_hurwitz(F).outcome
        assert verdict == ("proved" if solution.status == 0 else "refuted")
        answers.append(verdict)
    assert set(answers) == {"proved", "refuted"}


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 5))
def test_lemma_2_by_a_positive_vector_on_either_side(seed: int, n: int) -> None:
    """P = diag(u_i / v_i) from A v < v and A' u < u: what the product proves with one vector."""
    A = np.random.default_rng(seed).random((n, n))
    A *= 0.95 / max(abs(np.linalg.eigvals(A)))
    v, u = (np.linalg.solve(np.eye(n) - X, np.ones(n)) for X in (A, A.T))
    P = np.diag(u / v)
    assert (v > 0).all()
    assert (u > 0).all()
    assert np.linalg.eigvalsh(A.T @ P @ A - P).max() < 0
    for side, vector in (("right", v), ("left", u)):
        still = np.zeros((n, n))
        assert prove_copositive(still, A, vector, 0, 0, side=side).outcome == "proved"
        # the twin is not Schur: neither the vector nor P holds
        assert prove_copositive(still, A / 0.94, vector, 0, 0, side=side).outcome != "proved"
    assert np.linalg.eigvalsh(A.T @ P @ A / 0.94**2 - P).max() > 0


def test_W_decreases_before_jumps_and_not_after_them() -> None:
    """After Theorem 3: at the instants t_i just before a jump; just after one it may grow."""
    F, H, P = np.diag([-1.0, -0.1]), np.array([[0.0, 2.0], [0.0, 0.0]]), np.eye(2)
    assert prove_common(F, H, P, 1.0, 1.0).outcome == "proved"
    after = [np.array([0.0, 1.0])]
    before = [expm(F) @ after[0]]
    after.append(H @ before[0])
    before.append(expm(F) @ after[1])
    assert before[1] @ P @ before[1] < before[0] @ P @ before[0]
    assert after[1] @ P @ after[1] > after[0] @ P @ after[0]


# --- Section 3: hypotheses --------------------------------------------------------------------


def test_bounds_of_a_state_that_grows_without_end_stay_narrow() -> None:
    """Assumption 1 asks for a bounded state; the width does not know the state."""
    plant = {
        "flow": {"A": [[1.0]], "disturbance": {"lower": [-0.1], "upper": [0.1]}},
        "jump": {"G": [[1.0]], "dwell_time": [1.0, "inf"]},
        "output": {"C": [[1.0]], "noise_bound": [0.01]},
        "observer": {"kind": "interval", "gains": {"L": [[3.0]], "M": [[0.5]]}},
    }
    design = obsdesign.design(obsdesign.Problem.from_dict(plant))
    assert {c.id: c.verdict for c in design.claims}["hurwitz"] == "proved"  # T_max is infinite
    t = np.round(np.arange(0, 12, 0.01), 2)
    x = np.exp(t)[:, None]
    jump = np.isin(t, [2.0, 5.0])
    batch = obsdesign.runtime.from_design(design).run_batch(t, x, jump=jump, lower=[0], upper=[2])
    assert set(batch.status) == {"ok"}
    assert (batch.lower <= x).all()
    assert (x <= batch.upper).all()
    assert x[-1] > 1e5
    assert (batch.upper - batch.lower)[-1] < 0.021  # the strip: 2 V


def test_V_may_be_zero_and_not_infinite() -> None:
    assert investigate("degue_4_1", output__noise_bound=[0.0]).verdict == "proved"
    with pytest.raises(obsdesign.InputError, match="noise_bound must hold finite numbers; got inf"):
        investigate("degue_4_1", output__noise_bound=[math.inf])


def test_the_minimal_split_of_a_positive_error_is_assumption_2() -> None:
    """Where F is Metzler and H >= 0, (10) is (5) twice: no stronger condition."""
    F, H = A1 - L1 @ C, G1 - M1 @ C
    for minus in (metzler_split(F)[1], nonnegative_split(H)[1]):
        np.testing.assert_array_equal(minus, np.zeros((2, 2)))
    gains = {"L": L1.tolist(), "M": M1.tolist()}
    for shortest, verdict in ((0.6932, "proved"), (0.6931, "refuted")):
        for form in ("cooperative", "split"):
            observer = {"kind": "interval", "form": form, "gains": gains}
            outcome = investigate_with(observer, "degue_4_1", jump__dwell_time=[shortest, "inf"])
            assert outcome.verdict == verdict, form


def test_the_second_plus_of_9_loses_a_state_that_is_known() -> None:
    """(S^-1)+ where (S^-1)- belongs: from z2 known exactly the print makes z1 = 0."""
    inverse = np.linalg.inv(np.linalg.solve(PRINTED_S2, PRINTED_S1))
    plus, minus = positive_part(inverse), positive_part(-inverse)
    z2 = np.array([1.0, 2.0])
    np.testing.assert_allclose(plus @ z2 - minus @ z2, inverse @ z2)
    np.testing.assert_array_equal(plus @ z2 - plus @ z2, [0.0, 0.0])
    assert (np.abs(inverse @ z2) > 0.1).all()
