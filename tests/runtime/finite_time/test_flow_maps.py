"""One step of a window, enclosed: against balls, and close to what they hold."""

from __future__ import annotations

import math
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from obsdesign.runtime.finite_time import error_radius
from obsdesign.runtime.finite_time.flow_maps import FlowMaps, flow_maps

UNIT = 2.0**-53


def gains_of(seed: int, n: int = 3, **more: Any) -> Any:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n)) * 10.0 ** rng.uniform(-1, 1)
    upper = rng.random(n)
    return SimpleNamespace(A=A, n=n, m=0, flow_lower=-upper, flow_upper=upper, **more)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("h", [1e-3, 0.4])
def test_a_step_and_how_a_radius_grows(seed: int, h: float) -> None:
    gains = gains_of(seed)
    maps = flow_maps(gains, h, 0.0)
    A, n, radius = gains.A, 3, np.array([1.0, 0.1, 0.01])
    Z = np.zeros((2 * n, 2 * n))
    Z[:n, :n], Z[:n, n:] = A, np.eye(n)
    whole = expm(Z * h)
    np.testing.assert_allclose(maps.flow, whole[:n, :n], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(maps.once, whole[:n, n:], rtol=1e-10, atol=1e-12)
    for error in (maps.flow_error, maps.once_error):
        assert np.all(error < 1e-12 * np.abs(whole).max())
    times = h * (np.arange(2000) + 0.5) / 2000
    reach = np.abs(expm(A * times[:, None, None])).mean(axis=0) * h @ gains.flow_upper
    least = np.abs(whole[:n, :n]) @ radius + reach
    spread = maps.spread(radius)
    assert np.all(least <= spread * (1 + 1e-6))
    # no wider than the comparison system
    metzler = np.where(np.eye(n, dtype=bool), A, np.abs(A))
    M = np.zeros((n + 1, n + 1))
    M[:n, :n], M[:n, n] = metzler, gains.flow_upper
    most = expm(M * h)
    assert np.all(maps.inflow <= most[:n, n] * (1 + 1e-9))
    assert np.all(maps.growth <= np.abs(whole[:n, :n]) * (1 + 1e-9) + 1e-12)
    assert np.all(maps.spread(np.full(n, np.inf)) == np.inf)


def test_errors_of_the_length_are_covered() -> None:
    gains = gains_of(0)
    wide = flow_maps(gains, 0.4, 1e-3)
    for h in (0.399, 0.4, 0.401):
        assert np.all(np.abs(expm(gains.A * h) - wide.flow) <= wide.flow_error)
        assert np.all(np.abs(expm(gains.A * h)) <= wide.growth)
    assert not np.all(np.abs(expm(gains.A * 0.403) - wide.flow) <= wide.flow_error)


@pytest.mark.parametrize("seed", range(5))
def test_the_rounding_of_a_step_is_enclosed_by_few_units(seed: int) -> None:
    rng = np.random.default_rng(seed)
    flow, once = rng.standard_normal((2, 4, 4))
    x, forced = rng.standard_normal((2, 4))
    zero = np.zeros((4, 4))
    maps = FlowMaps(flow, once, zero, zero, zero, np.zeros(4))
    bound = maps.error(x, np.abs(forced))
    size = np.abs(flow) @ np.abs(x) + np.abs(once) @ np.abs(forced)
    value = flow @ x + once @ forced
    for i in range(4):
        exact = sum(
            Fraction(float(a)) * Fraction(float(b)) for a, b in zip(flow[i], x, strict=True)
        )
        exact += sum(
            Fraction(float(a)) * Fraction(float(b)) for a, b in zip(once[i], forced, strict=True)
        )
        assert abs(Fraction(float(value[i])) - exact) <= Fraction(float(bound[i]))
    # 2 n + 4 roundings, each of one unit
    np.testing.assert_allclose(bound, 12 * UNIT * size, rtol=1e-9)
    # errors of the matrices count as they are
    with_errors = FlowMaps(flow, once, zero + 1e-3, zero + 1e-2, zero, np.zeros(4))
    expected = 1e-3 * np.abs(x).sum() + 1e-2 * np.abs(forced).sum()
    np.testing.assert_allclose(with_errors.error(x, np.abs(forced)), expected, rtol=1e-9)


@pytest.mark.parametrize("size", [1.0, 1e-200, 1e200, 0.0])
def test_a_length_is_bounded_where_squares_are_not_numbers(size: float) -> None:
    window = size * np.array([3.0, -4.0])
    with np.errstate(over="ignore"):
        length = error_radius.window_length(window)
    assert length >= 5 * size * (1 - 1e-15)
    assert length <= (7 if size > 1e100 else 5) * size * (1 + 1e-12) + 2e-153
    if size == 0.0:
        assert length > 0.0


def test_lengths_of_rows() -> None:
    gain = np.array([[3.0, 4.0, 0.0], [1.0, 1.0, 1.0], [3e-200, 4e-200, 0.0], [3e200, 4e200, 0.0]])
    lengths = error_radius._row_lengths(gain)
    truth = np.array([5.0, math.sqrt(3), 5e-200, 5e200])
    assert np.all(lengths >= truth)
    np.testing.assert_allclose(lengths[:2], 1.001 * truth[:2], rtol=1e-12)
    assert np.all(lengths <= 1.4 * truth * 1.001)


@pytest.mark.parametrize("from_start", [True, False])
def test_rows_and_kicks_are_those_of_the_samples(from_start: bool) -> None:
    rng = np.random.default_rng(5)
    k, p, n, period = 4, 2, 3, 0.3
    gains = gains_of(
        1, C=rng.standard_normal((p, n)), samples=k, period=period, p=p,
        is_relative_to_start=from_start, window_gain=rng.standard_normal((n, k * p)),
    )  # fmt: skip
    rows = error_radius._rows(gains)
    powers = range(k) if from_start else range(-k, 0)
    expected = np.vstack([gains.C @ expm(gains.A * period * j) for j in powers])
    np.testing.assert_allclose(rows.mid, expected, rtol=1e-9, atol=1e-11)
    assert np.all(rows.rad < 1e-10 * np.abs(expected).max())
    # a kick of the state just before sample j + 1: what it leaves, and the sample that shows it
    kicks, G = np.zeros((n, n)), gains.window_gain
    terms = [G[:, j * p : (j + 1) * p] for j in range(k)]
    for j in range(k):
        kicks += np.abs(terms[j]) @ np.abs(gains.C)
        if from_start:  # x(t_i) = A_d^(k-1-j) kick - what samples j + 1, ... make of it
            left = expm(gains.A * period * (k - 1 - j)) - sum(
                terms[i] @ gains.C @ expm(gains.A * period * (i - j - 1)) for i in range(j + 1, k)
            )
        else:
            left = sum(
                terms[i] @ gains.C @ expm(gains.A * period * (i - j - 1)) for i in range(j + 1)
            )
        kicks += np.abs(left)
    np.testing.assert_allclose(error_radius._kicks(gains), kicks, rtol=1e-9)


def test_the_largest_effect_of_errors_that_move_through_a_window() -> None:
    gain, error = np.array([[1.0, 2.0, 4.0]]), np.array([3.0, 0.0, 5.0])
    # errors enter at the end and move to the front: sums of gain_j error_(j + shift)
    effects = [1 * 3 + 2 * 0 + 4 * 5, 1 * 0 + 2 * 5, 1 * 5]
    assert error_radius._largest_while_inside(gain, error, 1).tolist() == [max(effects)]
    two = error_radius._largest_while_inside(np.ones((1, 4)), np.array([1.0, 2.0, 4.0, 8.0]), 2)
    assert two.tolist() == [15.0]
