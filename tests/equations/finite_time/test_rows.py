"""Rows of samples and their least-squares gains: laws and exact values."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from obsdesign.equations.finite_time import rows as equations

PERIOD = 0.3


def random_plant(seed: int, n: int = 3, p: int = 2) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n, n)), rng.standard_normal((p, n))


@pytest.mark.parametrize("seed", range(3))
def test_samples_are_rows_times_the_reference_state(seed: int) -> None:
    A, C = random_plant(seed)
    k, x = 4, np.array([1.0, -2.0, 0.5])  # at the window's start, t_i - 4 periods
    samples = [C @ expm(A * PERIOD * j) @ x for j in range(k)]
    last = expm(A * PERIOD * k) @ x
    start, end = (equations.sample_rows(A, C, PERIOD, k, name) for name in ("start", "end"))
    assert start.shape == end.shape == (k, 2, 3)
    np.testing.assert_allclose(start @ x, samples, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(end @ last, samples, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(equations.stacked_rows(C, expm(A * PERIOD), k), start, rtol=1e-10)
    np.testing.assert_allclose(equations.last_state(A, k * PERIOD, "start") @ x, last, rtol=1e-12)
    assert (equations.last_state(A, k * PERIOD, "end") == np.eye(3)).all()


def test_scales_are_those_of_the_states() -> None:
    # y = x1, x1' = x2: over a window T the columns are 1 and T
    A, C = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0]])
    assert equations.state_scales(A, C, 8.0).tolist() == [1.0, 1 / 8]
    assert equations.state_scales(A, C, 1 / 8).tolist() == [1.0, 8.0]
    triple = np.diag([1.0, 1.0], 1)
    assert equations.state_scales(triple, np.eye(3)[:1], 8.0).tolist() == [1.0, 1 / 8, 1 / 32]
    # a state that no output shows has size one; units of powers of two come out
    assert equations.state_scales(0 * A, C, 1.0).tolist() == [1.0, 1.0]
    A, C = random_plant(1)
    units = np.array([4.0, 1.0, 2.0**-7])
    scaled = equations.state_scales(units[:, None] * A / units, C / units, 0.7)
    assert (scaled == units * equations.state_scales(A, C, 0.7)).all()


def test_determinacy_by_hand() -> None:
    scales = np.ones(2)
    value = equations.approx_determinacy
    assert value(np.eye(2), scales) == pytest.approx(1 / math.sqrt(2))
    # rows count by their direction alone; a zero row counts nothing
    assert value(np.diag([5.0, 1e-9]), scales) == pytest.approx(1 / math.sqrt(2))
    assert value(np.array([[1.0, 0], [0, 1], [0, 0]]), scales) == pytest.approx(1 / math.sqrt(2))
    angle = 0.3
    rows = np.array([[1.0, 0.0], [math.cos(angle), math.sin(angle)]])
    least = math.sqrt(1 - math.cos(angle))
    assert value(rows, scales) == pytest.approx(least / math.sqrt(2))
    assert value(rows / [1.0, 1e6], np.array([1.0, 1e6])) == pytest.approx(least / math.sqrt(2))
    for nothing in (np.eye(2)[:1], np.array([[1.0, np.nan], [0, 1]]), np.zeros((2, 2))):
        assert value(nothing, scales) == 0.0
    assert value(np.full((2, 2), 1e308), np.full(2, 1e10)) == 0.0


def test_fewest_samples_that_determine_the_state() -> None:
    chain = np.diag([1.0, 1.0], 1)
    assert equations.approx_observability_index(chain, np.eye(3)[:1], PERIOD) == 3
    assert equations.approx_observability_index(chain, np.eye(3)[[0, 2]], PERIOD) == 2
    assert equations.approx_observability_index(chain, np.eye(3), PERIOD) == 1
    assert equations.approx_observability_index(chain, np.eye(3)[1:], PERIOD) is None


def test_pathological_periods() -> None:
    turn = np.array([[0.0, 2.0], [-2.0, 0.0]])  # +-2i: equal after sampling at pi/2
    ((first, second, turns),) = equations.pathological_pairs(turn, math.pi / 2)
    assert sorted([first.imag, second.imag]) == pytest.approx([-2.0, 2.0])
    assert turns == pytest.approx(1.0)
    assert equations.pathological_pairs(turn, math.pi)[0][2] == pytest.approx(2.0)
    for period in (math.pi / 4, 1.0, math.pi / 2 * (1 + 3e-6)):
        assert equations.pathological_pairs(turn, period) == []
    assert len(equations.pathological_pairs(turn, math.pi / 2 * (1 + 3e-7))) == 1
    # equal real parts are needed, and different imaginary ones
    apart = np.array([[1 + 2j, 0], [0, 1 - 2j]]) + np.diag([1e-3, 0])
    assert equations.pathological_pairs(apart, math.pi / 2) == []
    assert equations.pathological_pairs(np.eye(2), math.pi / 2) == []


@pytest.mark.parametrize("seed", range(3))
def test_a_weighted_least_squares_gain(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, deviations = rng.standard_normal((7, 3)) * [1.0, 1e5, 1e-5], rng.uniform(0.5, 4, 7)
    W = np.diag(deviations**-2)
    expected = np.linalg.solve(rows.T @ W @ rows, rows.T @ W)
    for cut in (0.0, 1e-12):
        gain = equations.least_squares_gain(rows, deviations, cut)
        np.testing.assert_allclose(gain, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())
    # below the cut a direction counts as zero: its part of the estimate is missing
    flat = np.array([[1.0, 1.0], [1.0, 1.0 + 1e-6]])
    exact = equations.least_squares_gain(flat, np.ones(2))
    np.testing.assert_allclose(exact @ flat, np.eye(2), atol=1e-8)
    short = equations.least_squares_gain(flat, np.ones(2), 1e-3)
    np.testing.assert_allclose(short @ flat, np.full((2, 2), 0.5), atol=1e-5)
    singular = np.diag([1.0, 0.0])
    np.testing.assert_allclose(equations.least_squares_gain(singular, np.ones(2)), singular)


def test_a_gain_made_unbiased() -> None:
    rng = np.random.default_rng(0)
    rows, wanted = rng.standard_normal((6, 3)), rng.standard_normal((3, 3))
    unbiased = equations.least_squares_gain(rows, np.ones(6))
    gain = equations.unbiased_gain(rng.standard_normal((3, 6)), rows, unbiased, wanted)
    np.testing.assert_allclose(gain @ rows, wanted, atol=1e-12)
