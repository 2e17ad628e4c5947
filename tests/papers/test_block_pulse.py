"""Block-pulse operators: their laws, the pole at -1, and what excites it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from docs.figures import block_pulse as bpf
from obsdesign.equations.unknown_input.smoothing import WINDOW, allowance, roughness, smoothed

M, H = 100, 0.1
T = H * np.arange(M + 1)

samples = st.lists(st.floats(-10, 10), min_size=2, max_size=40).map(np.array)


@given(samples, st.floats(0.01, 10))
@settings(deadline=None)
def test_three_forms_of_the_derivative_are_one(f: np.ndarray, h: float) -> None:
    F = bpf.coefficients(f)
    t = h * np.arange(len(f))
    expected = np.diff(f) / h
    size = (1 + np.abs(f).max()) / h * len(f)
    np.testing.assert_allclose(bpf.derivative(F, f[0], h), expected, atol=1e-12 * size)
    np.testing.assert_allclose(bpf.derivative_sum(F, f[0], h), expected, atol=1e-12 * size)
    np.testing.assert_allclose(bpf.cell_derivative(f, t), expected, atol=1e-12 * size)


@given(samples, st.floats(0.01, 10), st.floats(-5, 5))
@settings(deadline=None)
def test_the_derivative_inverts_the_integral(g: np.ndarray, h: float, f0: float) -> None:
    F = f0 + bpf.integration_matrix(len(g), h) @ g
    np.testing.assert_allclose(bpf.derivative(F, f0, h), g, atol=1e-9 * len(g) ** 2)
    np.testing.assert_allclose(bpf.derivative_sum(F, f0, h), g, atol=1e-9 * len(g) ** 2)


def test_the_forms_agree_to_ten_digits_on_a_record() -> None:
    f = np.sin(T) + T**2
    F = bpf.coefficients(f)
    np.testing.assert_allclose(bpf.derivative(F, f[0], H), np.diff(f) / H, atol=1e-10)
    np.testing.assert_allclose(bpf.derivative_sum(F, f[0], H), np.diff(f) / H, atol=1e-10)


def test_an_error_of_the_first_value_never_dies_out() -> None:
    f = np.sin(T)
    wrong = bpf.derivative(bpf.coefficients(f), f[0] + 0.01, H) - np.diff(f) / H
    np.testing.assert_allclose(wrong, 0.2 * (-1.0) ** np.arange(1, M + 1), atol=1e-10)


def test_exact_averages_leave_an_alternating_error() -> None:
    F = bpf.exact_coefficients(T**3 / 6, H)  # of t^2/2
    wrong = bpf.derivative(F, 0.0, H) - bpf.exact_coefficients(T**2 / 2, H)
    np.testing.assert_allclose(wrong, H / 6 * (-1.0) ** np.arange(1, M + 1), atol=1e-10)
    F = bpf.exact_coefficients(-np.cos(T), H)
    wrong = bpf.derivative(F, 0.0, H) - bpf.exact_coefficients(np.sin(T), H)
    assert 6e-4 < np.abs(wrong[-20:]).max() < 9e-4
    # the remedy for averages without samples: at the nodes, second order, nothing left over
    node = bpf.node_derivative(bpf.exact_coefficients(T**3 / 6, H), H)
    np.testing.assert_allclose(node, T[1:-1], atol=1e-10)


@pytest.mark.parametrize("damping", [0.0, 0.5, 0.8])
def test_damped_is_exact_for_ramps_and_late_by_the_formula(damping: float) -> None:
    F = bpf.coefficients(T)
    slopes = bpf.damped_derivative(F, 0.0, H, damping)
    np.testing.assert_allclose(slopes, 1.0, atol=1e-12)
    F = bpf.coefficients(T**2 / 2)
    middle = (T[1:] + T[:-1]) / 2
    delay = H * (1 - damping) / (2 * (1 + damping))
    slopes = bpf.damped_derivative(F, 0.0, H, damping)
    np.testing.assert_allclose(slopes[60:], middle[60:] - delay, atol=1e-5)


def test_noise_of_the_forms() -> None:
    rng, runs, sigma = np.random.default_rng(0), 4000, 0.01
    noise = sigma * rng.standard_normal((M + 1, runs))
    F = bpf.coefficients(noise)
    same = bpf.derivative(F, noise[0], H)
    assert same[-1].std() == pytest.approx(np.sqrt(2) * sigma / H, rel=0.05)
    clean_start = bpf.derivative(F, np.zeros(runs), H)
    assert clean_start[-1].var() == pytest.approx(6 * sigma**2 / H**2, rel=0.1)
    cells = sigma * rng.standard_normal((M, runs))
    slopes = bpf.derivative(cells, np.zeros(runs), H)
    for i in (1, 2, 10, 100):  # without bound
        assert slopes[i - 1].var() == pytest.approx((2 / H) ** 2 * sigma**2 * (4 * i - 3), rel=0.1)
    for r in (0.0, 0.5, 0.9):
        damped = bpf.damped_derivative(cells, np.zeros(runs), H, r)[-1]
        formula = 2 * (1 + r) ** 2 * sigma**2 / (H**2 * (1 - r))
        assert damped.var() == pytest.approx(formula, rel=0.12)


def test_irregular_cells() -> None:
    t = np.cumsum(np.random.default_rng(0).uniform(0.01, 0.3, 50))
    np.testing.assert_allclose(bpf.cell_derivative(t**2, t), t[1:] + t[:-1], atol=1e-10)


# --- smoothing ----------------------------------------------------------------------------------


def test_smoothing_solves_the_quadratic_program() -> None:
    import cvxpy as cp

    rng = np.random.default_rng(0)
    for t in (T[:41], np.cumsum(rng.uniform(0.05, 0.2, 41))):
        y = np.sin(t) + 0.05 * rng.standard_normal(41)
        ours = smoothed(t, y[:, None], np.array([0.05]))[:, 0]
        f = cp.Variable(41)
        rough = roughness(t)
        ball = [cp.norm(f - y) <= 0.05 * np.sqrt(allowance(41))]
        best = cp.Problem(cp.Minimize(cp.sum_squares(rough @ f)), ball)
        best.solve(solver=cp.CLARABEL)
        np.testing.assert_allclose(ours, f.value, atol=1e-4)
        assert np.sum((rough @ ours) ** 2) == pytest.approx(best.value, rel=1e-4)


def test_on_equal_cells_it_is_the_program_for_the_cells() -> None:
    """min |D2 g|^2 in g, the averages of the derivative."""
    g = np.diff(np.sin(T)) / H
    second = np.diff(g, 2)
    np.testing.assert_allclose(roughness(T) @ np.sin(T), second / H**2 * np.sqrt(H), rtol=1e-6)


def test_smoothing_laws() -> None:
    rng = np.random.default_rng(1)
    y = np.column_stack([np.sin(T), T**2]) + 0.05 * rng.standard_normal((M + 1, 2))
    s = np.array([0.05, 0.05])
    once = smoothed(T, y, s)
    np.testing.assert_allclose(
        np.linalg.norm(once[:, 0] - y[:, 0]), 0.05 * np.sqrt(allowance(M + 1)), rtol=1e-6
    )
    # units of time and of y, and a parabola added, change nothing else
    np.testing.assert_allclose(smoothed(60 * T + 7, y, s), once, atol=1e-7)
    np.testing.assert_allclose(smoothed(T, 1e3 * y, 1e3 * s), 1e3 * once, atol=1e-4)
    curve = (3 - 2 * T + T**2)[:, None]
    np.testing.assert_allclose(smoothed(T, y + curve, s), once + curve, atol=1e-6)
    backwards = smoothed(T, y[::-1], s)[::-1]
    np.testing.assert_allclose(backwards, once, atol=1e-6)
    # samples of a parabola are left alone; without noise so is everything
    np.testing.assert_allclose(smoothed(T, curve, s[:1]), curve, atol=1e-8)
    np.testing.assert_allclose(smoothed(T, y, 1e-9 * s), y, atol=1e-8)
    for rows in (1, 2, 3):
        np.testing.assert_array_equal(smoothed(T[:rows], y[:rows], s), y[:rows])


def test_long_records_are_smoothed_in_windows() -> None:
    t = H * np.arange(3 * WINDOW + 17)
    rng = np.random.default_rng(2)
    y = np.sin(t)[:, None] + 0.05 * rng.standard_normal((len(t), 1))
    smooth = smoothed(t, y, np.array([0.05]))
    off = np.abs(smooth[:, 0] - np.sin(t))
    assert off[5:-5].max() < 0.06  # the ends are held from one side only
    assert np.sqrt(np.mean(off[5:-5] ** 2)) < 0.5 * 0.05
    slope = np.diff(smooth[:, 0]) / H
    assert np.sqrt(np.mean((slope - np.cos(t[1:] - H / 2)) ** 2)) < 0.1  # 0.7 unsmoothed


def test_a_finer_sampling_does_not_shorten_what_is_averaged() -> None:
    """Windows are as long in time as the signal allows: more samples never mean a worse slope."""
    off = []
    for h in (0.02, 0.002, 0.0005):
        t = h * np.arange(round(10 / h) + 1)
        y = np.sin(t)[:, None] + 0.01 * np.random.default_rng(3).standard_normal((len(t), 1))
        slope = np.diff(smoothed(t, y, np.array([0.01]))[:, 0]) / h
        off.append(np.sqrt(np.mean((slope - np.cos(t[1:] - h / 2))[t[1:] > 1] ** 2)))
    assert off[1] < 0.8 * off[0]
    assert off[2] < 0.8 * off[1]
    assert off[2] < 0.01  # the difference quotient is off by 28


def test_what_means_would_swallow_is_kept() -> None:
    """A fast oscillation far above the noise, in a record that has 50 samples per window node."""
    t = 0.001 * np.arange(10001)
    y = (t + np.sin(40 * t))[:, None]
    y += 0.01 * np.random.default_rng(4).standard_normal(y.shape)
    smooth = smoothed(t, y, np.array([0.01]))[:, 0]
    assert np.sqrt(np.mean((smooth - t - np.sin(40 * t)) ** 2)) < 0.005
    # the twin: an oscillation that neighbours cannot tell from noise is noise
    y = t[:, None] + 0.01 * np.cos(np.pi * np.arange(len(t)))[:, None]
    assert np.abs(smoothed(t, y, np.array([0.01]))[:, 0] - t).max() < 0.002


def test_long_records_of_parabolas_are_left_alone() -> None:
    for t in (
        0.01 * np.arange(3001),
        np.cumsum(np.random.default_rng(5).uniform(0.005, 0.015, 3001)),
    ):
        y = (3 - 2 * t + t**2)[:, None]
        np.testing.assert_allclose(smoothed(t, y, np.array([0.05])), y, atol=2e-5)
