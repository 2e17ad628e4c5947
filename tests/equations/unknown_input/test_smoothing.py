"""Smoothing to the noise: Morozov's equality, exact polynomials, means and windows."""

from __future__ import annotations

import numpy as np
import pytest

from obsdesign.equations.unknown_input import smoothing


def irregular(rows: int, seed: int = 0) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).uniform(0.5, 1.5, rows))


def test_the_allowance_is_the_mean_and_two_deviations() -> None:
    assert smoothing.allowance(200) == 240.0
    sums = (np.random.default_rng(0).standard_normal((4000, 200)) ** 2).sum(axis=1)
    assert 0.94 < np.mean(sums < smoothing.allowance(200)) < 0.99


@pytest.mark.parametrize("rows", [4, 5, 20])
def test_roughness_is_the_integral_of_the_third_derivative(rows: int) -> None:
    t = irregular(rows)
    A = smoothing.roughness(t)
    assert A.shape == (rows - 3, rows)
    np.testing.assert_allclose(A @ np.column_stack([t**0, t, t**2]), 0, atol=1e-9)
    fine = np.linspace(0, 2, 400)
    rough = smoothing.roughness(fine)
    # the third divided difference of t^3 is 6 / 6 times 3! / (1 2 3)...: its derivative is 6
    assert (rough @ fine**3) ** 2 @ np.ones(397) == pytest.approx(36 * 2, rel=0.02)
    assert (rough @ np.sin(fine)) ** 2 @ np.ones(397) == pytest.approx(1 + np.sin(4) / 4, rel=0.02)


@pytest.mark.parametrize("deviation", [0.01, 0.3])
@pytest.mark.parametrize("rows", [5, 40, 150])
def test_a_window_leaves_just_the_noise(deviation: float, rows: int) -> None:
    rng = np.random.default_rng(rows)
    t = irregular(rows)
    y = np.column_stack([np.sin(6 * t / t[-1]), 5 * np.cos(9 * t / t[-1])])
    y += deviation * rng.standard_normal(y.shape)
    smooth = smoothing.smoothed_window(t, y, np.array([deviation, 2 * deviation]))
    A = smoothing.roughness((t - t[0]) / ((t[-1] - t[0]) / (rows - 1)))
    for column, s in ((0, deviation), (1, 2 * deviation)):
        misfit = ((y - smooth)[:, column] ** 2).sum()
        parabola = y[:, column] - np.polyval(np.polyfit(t, y[:, column], 2), t)
        if (parabola**2).sum() <= smoothing.allowance(rows) * s**2:
            np.testing.assert_allclose(y[:, column] - smooth[:, column], parabola, atol=1e-5)
            continue
        assert misfit == pytest.approx(smoothing.allowance(rows) * s**2, rel=1e-6)
        # stationary: y - f = lam A'A f for one lam
        bent, residual = A.T @ A @ smooth[:, column], (y - smooth)[:, column]
        lam = residual @ bent / (bent @ bent)
        assert lam > 0
        # A'A f is a sixth difference, which loses digits to rounding
        np.testing.assert_allclose(residual, lam * bent, atol=1e-3 * np.abs(residual).max())


def test_a_parabola_and_a_record_without_noise_stay() -> None:
    t = irregular(60)
    parabola = np.column_stack([1 + 2 * t - 0.1 * t**2])
    np.testing.assert_allclose(
        smoothing.smoothed(t, parabola, np.array([1.0])), parabola, atol=1e-4
    )
    wild = np.random.default_rng(0).standard_normal((60, 1))
    np.testing.assert_allclose(smoothing.smoothed(t, wild, np.array([0.0])), wild, atol=1e-9)
    for rows in (1, 2, 3):
        assert (smoothing.smoothed(t[:rows], wild[:rows], np.array([9.0])) == wild[:rows]).all()


def test_ways_to_bend() -> None:
    t, wild = irregular(60), np.random.default_rng(0).standard_normal((60, 1))
    parabola = t[:, None] ** 2
    assert smoothing._window(t, parabola, np.array([1.0]))[1] == pytest.approx(3.0, abs=1e-3)
    assert smoothing._window(t, wild, np.array([0.0]))[1] == pytest.approx(60.0)
    assert smoothing._window(t[:3], wild[:3], np.array([9.0]))[1] == 3.0
    # the trace of y -> smoothed y, by columns of the identity, at the weight of this record
    y, s = 3 * np.sin(t)[:, None] + 0.1 * wild, np.array([0.1])
    A = smoothing.roughness((t - t[0]) / ((t[-1] - t[0]) / 59))
    smooth, bends = smoothing._window(t, y, s)
    lam = np.linalg.norm(y - smooth) / np.linalg.norm(A.T @ (A @ smooth))
    assert bends == pytest.approx(np.trace(np.linalg.inv(np.eye(60) + lam * A.T @ A)), rel=1e-6)


def test_a_cubic_passes_between_nodes() -> None:
    nodes = irregular(9)
    cubic = np.column_stack([nodes**3 - 2 * nodes, 1 - nodes**2])
    t = np.linspace(nodes[0] - 1, nodes[-1] + 1, 50)
    expected = np.column_stack([t**3 - 2 * t, 1 - t**2])
    np.testing.assert_allclose(smoothing._between(nodes, cubic, t), expected, atol=1e-8)


@pytest.mark.parametrize("rows", [450, 1600])
def test_long_records_are_smoothed_to_their_noise(rows: int) -> None:
    rng = np.random.default_rng(rows)
    t, s = np.linspace(0, 10, rows), 0.1
    truth = np.column_stack([np.sin(t), np.exp(-t / 5)])
    y = truth + s * rng.standard_normal(truth.shape)
    smooth = smoothing.smoothed(t, y, np.array([s, s]))
    error = np.sqrt(((smooth - truth) ** 2).mean(axis=0))
    assert np.all(error < 0.35 * s)
    assert np.all(error < 2.2 * s * np.sqrt(12 / rows) + 0.02)
    # the twin: what bends faster than means follow is kept
    fast = np.sin(2 * np.pi * t * rows / 10 / 16)[:, None]
    kept = smoothing.smoothed(t, fast + 0.01 * rng.standard_normal(fast.shape), np.array([0.01]))
    assert np.sqrt(((kept - fast) ** 2).mean()) < 0.02


def test_overlapping_windows_fade_into_each_other() -> None:
    t = np.arange(450.0)
    parabola = np.column_stack([(t / 100) ** 2])
    smooth, bends = smoothing._in_windows(t, parabola, np.array([1.0]))
    np.testing.assert_allclose(smooth, parabola, atol=1e-4)
    assert bends == pytest.approx(3.0, abs=1e-2)
