"""Fitting one impulse: exact features give its age and weight; derivatives are those of the cost."""

from __future__ import annotations

import math

import numpy as np
import pytest

from obsdesign.equations.impulsive_input import fit
from obsdesign.equations.impulsive_input.curve import ImpulseCurve

TAU = 2.0


def curve_of(seed: int, q: int = 1, points: int = 160) -> ImpulseCurve:
    rng = np.random.default_rng(seed)
    F = np.zeros((6, 6))
    F[:2, :2] = [[-1.0, 2.0], [-2.0, -1.0]]
    F[2:, :2] = rng.standard_normal((4, 2))
    F[2:, 2:] = -np.diag([0.5, 1.0, 2.0, 3.0])
    return ImpulseCurve.from_system(F, rng.standard_normal((2, q)), TAU, points)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("q", [1, 2])
@pytest.mark.parametrize("points", [160, 5])
def test_exact_features_give_age_and_weights(seed: int, q: int, points: int) -> None:
    curve = curve_of(seed, q, points)
    weights = np.array([1.7, -0.6])[:q]
    for age in (0.3, 0.777, 1.5):
        R = curve.value(age)[2:] @ weights
        impulse = fit.fit_impulse(R, curve, 0.1, 1.9)
        assert impulse is not None
        assert impulse.age == pytest.approx(age, abs=1e-8)
        np.testing.assert_allclose(impulse.weights, weights, rtol=1e-7)
        assert impulse.cost <= 1e-12 * (R @ R)
        assert impulse.gain == pytest.approx(R @ R)
        assert impulse.inside
        np.testing.assert_allclose(impulse.b, curve.value(age)[2:], rtol=1e-6)
        np.testing.assert_allclose(
            impulse.b_dot, (curve.F @ curve.value(age))[2:], rtol=1e-6, atol=1e-7
        )
        # weighted features of the same impulse
        weighting = np.random.default_rng(9).standard_normal((4, 4)) + 3 * np.eye(4)
        again = fit.fit_impulse(weighting @ R, curve, 0.1, 1.9, weighting=weighting)
        assert again is not None
        assert again.age == pytest.approx(age, abs=1e-7)
        np.testing.assert_allclose(again.weights, weights, rtol=1e-6)


def test_the_best_age_of_noisy_features_is_that_of_a_fine_grid() -> None:
    rng = np.random.default_rng(1)
    for seed in range(6):
        curve = curve_of(seed % 3)
        R = curve.value(1.0)[2:, 0] + 0.3 * rng.standard_normal(4)
        impulse = fit.fit_impulse(R, curve, 0.2, 1.8)
        assert impulse is not None
        ages = np.linspace(0.2, 1.8, 4001)
        b = np.array([curve.value(age)[2:, 0] for age in ages])
        costs = R @ R - (b @ R) ** 2 / (b**2).sum(axis=1)
        assert impulse.cost <= costs.min() + 1e-12
        assert impulse.age == pytest.approx(ages[np.argmin(costs)], abs=1e-3)
        assert impulse.inside is (0.2 < impulse.age < 1.8)


def test_ends_signs_and_nothing() -> None:
    curve = curve_of(0)
    R = curve.value(1.0)[2:, 0]
    # an older impulse than is searched: the end of the range, which is no minimum inside
    limited = fit.fit_impulse(R, curve, 0.2, 0.9)
    assert limited is not None
    assert limited.age == pytest.approx(0.9)
    assert not limited.inside
    assert fit.fit_impulse(R, curve, 0.2, 1.8, nonnegative=True).age == pytest.approx(1.0)
    negative = fit.fit_impulse(-R, curve, 0.95, 1.05, nonnegative=True)
    assert negative is None
    assert fit.fit_impulse(-R, curve, 0.95, 1.05).weights[0] == pytest.approx(-1.0)
    assert fit.fit_impulse(0 * R, curve, 0.2, 1.8) is None
    # a range between two grid points has its nearest one
    narrow = fit.fit_impulse(R, curve, 1.0 + 0.3 * curve.step, 1.0 + 0.4 * curve.step)
    assert narrow is not None
    assert narrow.age == pytest.approx(1.0 + 0.3 * curve.step)


@pytest.mark.parametrize("q", [1, 2])
def test_slopes_are_the_derivatives_of_half_the_cost(q: int) -> None:
    rng = np.random.default_rng(q)
    curve, R = curve_of(1, q), np.random.default_rng(5).standard_normal(4)

    def parts(age: float) -> list[np.ndarray]:
        whole = curve.value(age)
        return [whole[2:], (curve.F @ whole)[2:], (curve.F @ curve.F @ whole)[2:]]

    def cost(age: float) -> float:
        return fit._solve(R, parts(age)[0])[1]

    for age in rng.uniform(0.2, 1.8, 4):
        d = 1e-4
        slope, bend = fit._slope(R, *parts(age))
        assert slope == pytest.approx((cost(age + d) - cost(age - d)) / (4 * d), rel=1e-4, abs=1e-6)
        ends = [fit._slope(R, *parts(age + e))[0] for e in (-d, d)]
        assert bend == pytest.approx((ends[1] - ends[0]) / (2 * d), rel=1e-4, abs=1e-6)


def test_a_root_by_newton_and_by_bisection() -> None:
    def root(function: object, start: float, bracket: tuple[float, float]) -> float:
        return fit._root(function, start, bracket, 1.0)

    assert root(lambda s: (s**3 - 0.2, 3 * s**2), 0.9, (0.0, 1.0)) == pytest.approx(
        0.2 ** (1 / 3), abs=1e-15
    )
    # no slope, and slopes that lead out of the bracket: halved
    assert root(lambda s: (math.copysign(1.0, s - 0.3), 0.0), 0.5, (0.0, 1.0)) == pytest.approx(
        0.3, abs=1e-6
    )
    assert root(lambda s: (math.atan(50 * (s - 0.7)), 1e-3), 0.1, (0.0, 1.0)) == pytest.approx(
        0.7, abs=1e-6
    )
    steps = []

    def counted(s: float) -> tuple[float, float]:
        steps.append(s)
        return s - 0.25, 1.0

    assert root(counted, 0.9, (0.0, 1.0)) == 0.25
    assert len(steps) <= 3


def test_peaks_and_what_is_explained() -> None:
    assert fit.peaks(np.array([1.0, 3.0, 2.0, 2.9, 0.0, 2.0, 0.0])) == [1, 3]
    assert fit.peaks(np.array([3.0, 2.0, 2.8, 2.0, 2.9, 2.0, 2.75])) == [0, 4, 2]
    assert fit.peaks(np.array([0.0, 1.0])) == [1]
    rng = np.random.default_rng(0)
    b, R = rng.standard_normal((5, 4, 2)), rng.standard_normal(4)
    for columns in (b, b[:, :, :1]):
        least = [np.linalg.lstsq(one, R, rcond=None)[1][0] for one in columns]
        np.testing.assert_allclose(fit.explained(columns, R, False), R @ R - least, rtol=1e-10)
    one = b[:, :, :1]
    signs = one[:, :, 0] @ R > 0
    np.testing.assert_allclose(
        fit.explained(one, R, True), np.where(signs, fit.explained(one, R, False), 0.0)
    )
    assert fit.explained(0 * one, R, False).tolist() == [0.0] * 5


def test_a_left_inverse_in_any_units() -> None:
    J = np.random.default_rng(0).standard_normal((5, 2))
    units = np.array([1e-9, 1e12])
    scaled = fit.left_inverse(J * units) * units[:, None]
    np.testing.assert_allclose(scaled @ J, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(fit.left_inverse(J), np.linalg.pinv(J), rtol=1e-9)
    assert (fit.left_inverse(np.zeros((3, 1))) == 0).all()
