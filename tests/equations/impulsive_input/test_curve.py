"""Features of a window as a function of age: the grid, Taylor series and units."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from obsdesign.equations.impulsive_input.curve import ImpulseCurve, balanced_size, power_sum


def triangular(seed: int, n: int = 2, m: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    F = rng.standard_normal((n + m, n + m))
    F[:n, n:] = 0.0
    return F, rng.standard_normal((n, 2))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("tau", [0.1, 3.0])
def test_a_curve_is_the_exponential_at_every_age(seed: int, tau: float) -> None:
    F, H = triangular(seed)
    curve = ImpulseCurve.from_system(F, H, tau)
    assert curve.ages[0] == 0.0
    assert curve.ages[-1] == pytest.approx(tau)
    assert len(curve.ages) >= 161
    assert curve.n == 2
    start = np.vstack([H, np.zeros((3, 2))])
    for age in (0.0, 0.37 * tau, 0.5 * curve.step, tau, tau + 0.4 * curve.step):
        truth = expm(F * age) @ start
        np.testing.assert_allclose(
            curve.value(age), truth, rtol=1e-9, atol=1e-11 * np.abs(truth).max()
        )
    k = len(curve.ages) // 2
    series = curve.series(k)
    assert len(series) == curve.terms
    np.testing.assert_allclose(series[1], F @ curve.states[k], rtol=1e-12)
    np.testing.assert_allclose(series[3], F @ F @ F @ curve.states[k] / 6, rtol=1e-11)


def test_terms_are_enough_and_not_many_more() -> None:
    for tau in (0.01, 1.0, 100.0):
        curve = ImpulseCurve.from_system(*triangular(1), tau)
        reach = balanced_size(curve.F) * curve.step
        last = math.exp(reach + curve.terms * math.log(reach) - math.lgamma(curve.terms + 1))
        one_less = math.exp(reach + (curve.terms - 1) * math.log(reach) - math.lgamma(curve.terms))
        assert last <= 1e-15
        assert curve.terms == 5 or one_less > 1e-22


def test_a_flow_too_fast_for_its_window_is_refused() -> None:
    F, H = triangular(0)
    with pytest.raises(ValueError, match="too large for the window"):
        ImpulseCurve.from_system(1e9 * F, H, 1.0)


def test_ages_that_leave_nothing_are_not_searched() -> None:
    # b = (e^{-s} - e^{-9 s}) / 8: its peak at log(9)/8 is 1/(9^{9/8}); a thousandth is left at 6.97
    F, H = np.array([[-9.0, 0.0], [1.0, -1.0]]), np.array([[1.0]])
    curve = ImpulseCurve.from_system(F, H, 20.0, 4000)
    peak = 9 ** (-9 / 8)
    assert curve.oldest == pytest.approx(-math.log(8e-3 * peak), abs=0.01)
    assert ImpulseCurve.from_system(F, H, 2.0).oldest == pytest.approx(2.0)


def test_a_balanced_size_is_in_no_units() -> None:
    rng = np.random.default_rng(0)
    F = rng.standard_normal((4, 4))
    units = 10.0 ** rng.uniform(-6, 6, 4)
    plain, scaled = balanced_size(F), balanced_size(units[:, None] * F / units)
    assert scaled == pytest.approx(plain, rel=0.6)
    assert np.abs(np.linalg.eigvals(F)).max() <= plain <= np.abs(F).sum(axis=1).max()
    # the diagonal counts too
    assert balanced_size(np.diag([3.0, -7.0])) == 7.0
    assert balanced_size(np.array([[0.0, 100.0], [0.0, 0.0]])) <= 100.0
    assert balanced_size(np.array([[5.0, 1e6], [0.0, 5.0]])) <= 15.0
    assert balanced_size(np.array([[2.0, 1.0], [1.0, 2.0]])) == 3.0


def test_power_sums() -> None:
    series = np.arange(12.0).reshape(3, 2, 2)
    expected = series[0] + 0.5 * series[1] + 0.25 * series[2]
    np.testing.assert_allclose(power_sum(series, 0.5), expected)
    assert (power_sum(series, 0.0) == series[0]).all()
