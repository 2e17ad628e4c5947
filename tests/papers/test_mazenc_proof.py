"""Mazenc, Ahmed: the steps of Section 3 and of the proof of Theorem 1, against exact flows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm
from scipy.signal import place_poles

import obsdesign
from lmi.arithmetic.balls import precision
from lmi.arithmetic.norms import float_above, middles
from obsdesign.analysis.finite_time.enclosed_gains import Sampled, injection
from obsdesign.equations.finite_time import condition_13
from obsdesign.workflow import NotProved
from tests.papers.test_mazenc import PERIOD, A, C, K, L, T, problem, theorem_norms

F = A + L @ C


def norm(X: Any) -> float:
    return float(np.linalg.norm(X, 2))


def one_period(gain: Any, period: float = PERIOD) -> tuple[Any, Any]:
    """P and K_d: the flow of F + mu over a period is P = A_d + K_d C."""
    with precision(160):
        sampled = Sampled.from_plant(A, C, period, 2)
        K_d = sampled.forward @ injection(sampled, gain)
        return middles(sampled.forward + K_d @ sampled.C), middles(K_d)


# --- (6) to (9) ---------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_6_with_the_integral_from_t_back_to_the_sample(share: float) -> None:
    """x' of a motion under delta(t) = (sin 3t, cos t), in the middle of a long period."""
    nu, i, start = 2.0, 3, np.array([0.0, 2.0])

    def delta(t: float) -> Any:
        return np.array([np.sin(3 * t), np.cos(t)])

    def x(t: float) -> Any:
        return expm(A * t) @ start + quad_vec(lambda m: expm(A * (t - m)) @ delta(m), 0, t)[0]

    sample = i * nu
    t = sample + share * nu
    mu = L @ C @ (expm(A * (sample - t)) - np.eye(2))
    integral = quad_vec(lambda m: expm(A * (sample - m)) @ delta(m), t, sample)[0]
    right = (F + mu) @ x(t) + delta(t) - L @ C @ x(sample) + L @ C @ integral
    np.testing.assert_allclose(right, A @ x(t) + delta(t), atol=1e-10)
    if share:
        forwards = right - 2 * L @ C @ integral
        assert norm(forwards - A @ x(t) - delta(t)) > 1e-5


def test_9_does_not_tell_two_states_apart_that_its_window_does_not() -> None:
    """T = nu, delta = 0, y = 0 over the window: x(t) is one of two that are 4 apart."""
    flow = expm(A * PERIOD)
    states = np.array([[0.0, 2.0], [0.0, -2.0]])
    np.testing.assert_array_equal(states @ C.T, 0)
    assert norm(flow @ (states[0] - states[1])) == pytest.approx(4.0)


def test_9_keeps_an_error_of_the_state_that_it_starts_from() -> None:
    """With x(t - T) taken as 0 it is off by P^k x(t - T) after T = 6: 1.08 times at most."""
    P, K_d = one_period(L)
    flow = expm(A * PERIOD)
    x, from_truth, from_zero = (np.array(s) for s in ([0.0, 2.0], [0.0, 2.0], [0.0, 0.0]))
    for _ in range(K):
        y = C @ x
        from_truth, from_zero = P @ from_truth - K_d @ y, P @ from_zero - K_d @ y
        x = flow @ x
    np.testing.assert_allclose(from_truth, x, atol=1e-12)
    total = np.linalg.matrix_power(P, K)
    np.testing.assert_allclose(x - from_zero, total @ [0.0, 2.0], atol=1e-12)
    assert norm(x - from_zero) == pytest.approx(2.124819, abs=1e-6)
    assert norm(total) == pytest.approx(1.08347, abs=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_no_gain_makes_9_forget_its_start(seed: int) -> None:
    """P is a flow, det P > 0 whatever L: no power of it is zero."""
    gain = np.random.default_rng(seed).normal(0, 10, (2, 1))
    assert np.linalg.det(one_period(gain, 0.5)[0]) > 0


# --- Assumption 1 and what it is said to give -----------------------------------------------------


@pytest.mark.parametrize("method", ["least_squares", "exact"])
def test_observable_is_not_enough_at_a_pathological_period(method: str) -> None:
    """nu = pi/0.15: e^(A nu) = -I, so that (0, 1) is in no sample; 20 is a good period."""
    nu = np.pi / 0.15
    motion = [C @ expm(A * nu * i) @ [0.0, 1.0] for i in range(5)]
    np.testing.assert_allclose(motion, 0, atol=1e-14)
    with pytest.raises(NotProved, match="pathological sampling"):
        obsdesign.design(problem(method, period=nu, window=2 * nu))
    claims = {c.id: c for c in obsdesign.design(problem(method, period=20.0, window=40.0)).claims}
    assert claims["sampled_observable"].verdict == "proved"


@pytest.mark.parametrize("seed", range(10))
def test_some_T_and_L_make_M_regular(seed: int) -> None:
    """F further left than A: e^(FT) e^(-AT) falls below 1 in norm, M_T = e^(-FT) (that - I)."""
    rng = np.random.default_rng(seed)
    n, nu = int(rng.integers(2, 5)), float(rng.uniform(0.1, 1))
    random_A, random_C = rng.standard_normal((n, n)), rng.standard_normal((1, n))
    left = np.linalg.eigvals(random_A).real.min()
    poles = left - 1 - 0.5 * np.arange(n)
    gain = -place_poles(random_A.T, random_C.T, poles).gain_matrix.T
    closed = random_A + gain @ random_C
    products = (expm(closed * nu * k) @ expm(-random_A * nu * k) for k in range(1, 200))
    assert any(norm(product) < 1 for product in products)


# --- the proof of Theorem 1 -----------------------------------------------------------------------

TRUE = {"kappa": 6.418412e-4, "G": 6.422181e-4, "alpha": 0.3223168, "beta": 0.3223168,
        "gamma": 86.993323}  # fmt: skip


def true_norms(period: float, k: int) -> dict[str, float]:
    """kappa of (17), G of (22) and alpha, beta, gamma of (25) for a period."""
    with precision(160):
        sampled = Sampled.from_plant(A, C, period, k)
        P = sampled.forward + sampled.forward @ injection(sampled, L) @ sampled.C
        power = np.linalg.matrix_power(middles(P), k)
    back, M = expm(-F * T), expm(-A * T) - expm(-F * T)
    G = back - np.linalg.inv(power)
    inverse, disturbed = np.linalg.inv(M), np.linalg.inv(M + G)
    return {
        "kappa": norm(power - expm(F * T)), "G": norm(G), "alpha": norm(disturbed - inverse),
        "beta": norm(inverse @ back - disturbed @ np.linalg.inv(power)),
        "gamma": norm(disturbed @ np.linalg.inv(power)),
    }  # fmt: skip


@pytest.mark.parametrize("k", [117, 120, 240, 1200])
def test_the_matrices_of_the_proof_are_below_their_bounds(k: int) -> None:
    """|kappa| <= Sigma (20), |G| <= G_bar (23), alpha (26), beta, gamma, wherever (13) holds."""
    period = T / k
    values = true_norms(period, k)
    with precision(160):
        norms = theorem_norms(period, k)
        c = norms.constants(period)
        assert norms.condition(period) == "proved"
        tight = float_above(norms.constants(period, tighter=True).sigma)
        bounds = [float_above(x) for x in (c.sigma, c.gbar, c.alpha, c.beta, c.gamma)]
    for (name, value), bound in zip(values.items(), bounds, strict=True):
        assert value < bound, name
    assert values["kappa"] < tight
    if k == K:
        assert values == pytest.approx(TRUE, rel=1e-6)
        assert bounds[0] / values["kappa"] == pytest.approx(14.6231, rel=1e-4)


def test_18_and_19_bound_kappa_and_mu() -> None:
    """sup |mu| = 2.2500e-4 over a period, the bound 2.2585e-4; (18) is (20) with the former."""
    ages = np.linspace(0, PERIOD, 101)
    largest = max(norm(L @ C @ (expm(-A * age) - np.eye(2))) for age in ages)
    bound = norm(L @ C) * np.expm1(PERIOD * norm(A))
    assert largest == pytest.approx(2.249995e-4, rel=1e-6)
    assert largest < bound == pytest.approx(2.258459e-4, rel=1e-6)
    assert TRUE["kappa"] < condition_13.sigma(T, norm(F), largest)
    assert condition_13.sigma(T, norm(F), bound) == pytest.approx(0.0093857274, rel=1e-8)
