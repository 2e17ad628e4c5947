"""Constants of Theorem 1 and the longest period of condition (13), by their definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

from obsdesign.equations.finite_time import condition_13 as equations


@pytest.mark.parametrize("log_z", [-800.0, -40.0, -1.0, 0.0, 0.3, 1.0, 5.0, 300.0])
def test_the_lambert_function_in_logarithms(log_z: float) -> None:
    w = equations.log_lambert(log_z)
    assert w + math.exp(w) == pytest.approx(log_z, rel=1e-14, abs=1e-14)


@pytest.mark.parametrize("f", [0.0, 0.4, 1.5])
def test_growth_is_the_integral(f: float) -> None:
    growth = equations.flow_growth(f, 1.7)
    assert growth == pytest.approx(quad(lambda t: math.exp(2 * f * t), 0, 1.7)[0])
    s = 0.6
    sigma = s * math.exp(1.7 * f) * growth * math.exp(s * growth)
    assert equations.sigma(1.7, f, s) == pytest.approx(sigma)
    assert equations.log_sigma(1.7, f, s) == pytest.approx(math.log(sigma))
    tighter = math.exp(f * 1.7) * (math.exp(s * 1.7) - 1)
    assert equations.tighter_sigma(1.7, f, s) == pytest.approx(tighter)
    assert equations.log_tighter_sigma(1.7, f, s) == pytest.approx(math.log(tighter))
    assert tighter <= sigma


def test_constants_by_hand() -> None:
    # a = 2, m = 1/2, Sigma = 1/8: first 1/4, Gbar 2/3, second 1/3, alpha 1/4
    values = equations.constants(2.0, 0.5, 0.125)
    assert values.first == 0.25
    assert values.gbar == pytest.approx(2 / 3)
    assert values.second == pytest.approx(1 / 3)
    assert values.alpha == pytest.approx(1 / 4)
    assert values.beta == pytest.approx(2 / 4 + 0.75 * 2 / 3)
    assert values.gamma == pytest.approx(0.75 * (2 + 2 / 3))
    assert values.sigma == 0.125


@pytest.mark.parametrize(("a", "m"), [(1.5, 0.2), (0.3, 4.0), (5.0, 5.0)])
def test_the_largest_sigma_is_where_condition_13_ends(a: float, m: float) -> None:
    largest = equations.largest_sigma(a, m)
    inside, beyond = (equations.constants(a, m, largest * (1 + d)) for d in (-1e-9, 1e-9))
    assert max(inside.first, inside.second) < 1
    assert max(beyond.first, beyond.second) > 1


def sizes_of(A: np.ndarray, C: np.ndarray, L: np.ndarray, T: float) -> tuple[float, ...]:
    """a, m, f, |A|, |L C| from their definitions."""
    F = A + L @ C
    M = expm(-A * T) - expm(-F * T)
    norm = lambda X: float(np.linalg.norm(X, 2))  # noqa: E731
    return norm(expm(-F * T)), norm(np.linalg.inv(M)), norm(F), norm(A), norm(L @ C)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("tighter", [True, False])
def test_condition_13_holds_up_to_the_longest_period(seed: int, tighter: bool) -> None:
    rng = np.random.default_rng(seed)
    A, C, L, T = rng.standard_normal((2, 2)), np.eye(2), -2 * np.eye(2), 0.7
    L = L + 0.3 * rng.standard_normal((2, 2))
    a, m, f, size_A, size_LC = sizes_of(A, C, L, T)
    longest = math.exp(equations.approx_log_longest_period(A, C, L, T, tighter=tighter))
    bound = equations.tighter_sigma if tighter else equations.sigma
    for share, holds in ((0.999, True), (1.001, False)):
        s = size_LC * math.expm1(share * longest * size_A)
        values = equations.constants(a, m, bound(T, f, s))
        assert bool(0 <= values.first < 1 and 0 <= values.second < 1) is holds
    # in coordinates S x it is the period of the transformed plant
    S = rng.standard_normal((2, 2))
    in_S = equations.approx_log_longest_period(A, C, L, T, S, tighter=tighter)
    back = np.linalg.inv(S)
    own = equations.approx_log_longest_period(S @ A @ back, C @ back, S @ L, T, tighter=tighter)
    assert in_S == pytest.approx(own)


def test_plants_without_a_longest_period() -> None:
    A, C, L = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0]]), np.array([[-1.0], [-1.0]])
    period = equations.approx_log_longest_period
    assert period(0 * A, C, L, 1.0) == math.inf
    assert period(A, C, 0 * L, 1.0) == -math.inf
    assert period(A, C, L, 0.0) == -math.inf
    assert period(A, C, L, 1.0, np.zeros((2, 2))) == -math.inf
    assert period(A * np.nan, C, L, 1.0) == -math.inf
    assert period(1e6 * A - 1e6 * np.eye(2), C, L, 1e3) == -math.inf
    assert math.isfinite(period(A, C, L, 1.0))
    # F = 0: growth is T itself
    assert math.isfinite(period(-np.eye(2), np.eye(2), np.eye(2), 1.0))
    a, m, f, size_A, size_LC = sizes_of(-np.eye(2), np.eye(2), np.eye(2), 1.0)
    assert f == 0
    longest = math.exp(period(-np.eye(2), np.eye(2), np.eye(2), 1.0))
    s = size_LC * math.expm1(longest * size_A)
    assert equations.sigma(1.0, f, s) == pytest.approx(equations.largest_sigma(a, m))


def test_short_periods_in_logarithms() -> None:
    # log(log(1 + r) / |A|) for tiny and for moderate r
    for log_ratio in (-800.0, -37.0, -35.0, -1.0, 3.0):
        truth = (
            log_ratio - math.log(2)
            if log_ratio < -30
            else math.log(math.log1p(math.exp(log_ratio)) / 2)
        )
        assert equations._log_of_period(log_ratio, 2.0) == pytest.approx(truth, rel=1e-12)
