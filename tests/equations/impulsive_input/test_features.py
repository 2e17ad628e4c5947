"""Features of a window, their taps and periods: integrals by their definition."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad, quad_vec
from scipy.linalg import expm

from obsdesign.equations.impulsive_input import evaluation_rule, features, sampling

TAU, EXPONENTS = 1.5, np.array([-2.0, 0.0, 0.7])
D = np.array([[-0.5, 1.0], [-2.0, -0.8]])
C, H = np.array([[1.0, 0.5], [0.0, 1.0]]), np.array([[0.0], [1.0]])


def feature(age: float, tau: float = TAU) -> np.ndarray:
    """V(age) by the integral: row (output j, exponent i) is int_0^age e^{l_i (age - s)} C_j e^{D s} ds."""
    rows = [
        quad_vec(lambda s, c=c, lam=lam: math.exp(lam * (age - s)) * (c @ expm(D * s)), 0, age)[0]
        for c in C
        for lam in EXPONENTS
    ]
    return np.array(rows)


def test_a_window_is_its_integral() -> None:
    np.testing.assert_allclose(
        features.window_matrix(D, C, EXPONENTS, TAU), feature(TAU), rtol=1e-8
    )
    scales = features.feature_scales(EXPONENTS, TAU)
    assert scales.tolist() == [1.0, 1.0, pytest.approx(math.exp(-0.7 * TAU))]
    scaled = features.window_matrix(D, C, EXPONENTS, TAU, scales)
    np.testing.assert_allclose(scaled, np.tile(scales, 2)[:, None] * feature(TAU), rtol=1e-8)
    F = features.filtered_system(D, C, EXPONENTS)
    responses = features.impulse_responses(F, H, 0.25, 4)
    assert responses.shape == (4, 8, 1)
    for k in range(4):
        np.testing.assert_allclose(responses[k, :2], expm(D * 0.25 * k) @ H, atol=1e-12)
        np.testing.assert_allclose(responses[k, 2:], feature(0.25 * k) @ H, atol=1e-9)


def test_units_are_powers_of_two_about_the_size_of_features() -> None:
    F = features.filtered_system(
        np.diag([-1.0, -2.0]), np.array([[8.0, 0.0]]), np.array([0.0, 1.0])
    )
    units = features.feature_units(F, 2, 0.5)
    assert units.tolist() == [1.0, 1.0, 4.0, 4.0]
    assert features.feature_units(0 * F, 2, 0.5).tolist() == [1.0] * 4
    assert features.feature_units(F * np.nan, 2, 0.5).tolist() == [1.0] * 4


@pytest.mark.parametrize("margin", [0.3, 0.9])
@pytest.mark.parametrize("H", [H, np.array([[0.0, 0.1], [1.0, 1.0]])])
def test_what_is_neglected_by_its_definition(margin: float, H: np.ndarray) -> None:
    window = features.FeatureWindow(D, C[:1], H, exponents=EXPONENTS, tau=TAU, margin=margin)
    worst, at = features.neglected_ratio(window, 7)
    ages, ratios = np.linspace(margin, TAU, 7), []
    for age in ages:
        b = feature(age)[:3] @ H
        E = [
            quad_vec(lambda u, lam=lam, age=age: math.exp(lam * age)
                     * (C[0] @ expm((lam * np.eye(2) - D) * u) @ H), 0, TAU - age)[0]
            for lam in EXPONENTS
        ]  # fmt: skip
        ratios.append(np.abs(np.array(E) / b).max())
    assert worst == pytest.approx(max(ratios), rel=1e-6)
    assert at == pytest.approx(ages[int(np.argmax(ratios))])


def test_a_feature_that_changes_its_sign_has_no_ratio() -> None:
    turn = np.array([[0.0, 1.0], [-9.0, 0.0]])  # b = (1 - cos 3 s) / 9 and, below, sin 3 s / 3
    for output, infinite in (([[1.0, 0.0]], False), ([[0.0, 1.0]], True)):
        window = features.FeatureWindow(
            turn, np.array(output), H, exponents=np.zeros(1), tau=1.8, margin=0.5
        )
        worst, at = features.neglected_ratio(window)
        assert math.isinf(worst) is infinite
        if infinite:
            assert at == pytest.approx(math.pi / 3, abs=0.01)


@pytest.mark.parametrize("lam", [-40.0, -1.0, -1e-3, 0.0, 1e-9, 0.25, 0.4, 3.0])
def test_weights_of_a_kernel_are_their_integrals(lam: float) -> None:
    h = 0.9
    newer, older = features.kernel_weights(np.array([lam]), h)
    first = quad(lambda v: math.exp(lam * (h - v)) * v / h, 0, h, epsabs=1e-14)[0]
    second = quad(lambda v: math.exp(lam * (h - v)) * (1 - v / h), 0, h, epsabs=1e-14)[0]
    assert newer == pytest.approx(first, rel=1e-10)
    assert older == pytest.approx(second, rel=1e-10)


def test_taps_integrate_lines_between_samples() -> None:
    times = np.array([0.2, 0.5, 0.9, 1.0, 1.7])
    values = np.array([1.0, -2.0, 0.5, 4.0, 1.0])
    taps = features.window_taps(EXPONENTS, times)
    assert taps.shape == (5, 3)
    for i, lam in enumerate(EXPONENTS):
        truth = quad(lambda t, lam=lam: math.exp(lam * (1.7 - t)) * np.interp(t, times, values), 0.2, 1.7,
                     points=times[1:-1])[0]  # fmt: skip
        assert taps[:, i] @ values == pytest.approx(truth, rel=1e-9)


def test_longest_periods() -> None:
    slow = np.diag([-1.0, -4.0])
    assert sampling.longest_period(slow, None, 6.9) == pytest.approx(0.7 / 4)
    assert sampling.longest_period(slow, None, 7.1) == pytest.approx(0.4 / 4)
    assert sampling.longest_period(slow, np.array([-200.0, 1.0]), 6.9) == pytest.approx(12 / 200)
    assert sampling.longest_period(slow, np.zeros(2), 6.9) == pytest.approx(0.7 / 4)
    assert sampling.longest_period(np.zeros((1, 1)), None, 6.9) == math.inf
    assert sampling.longest_period(np.array([[0.0, 5.0], [-5.0, 0.0]]), None, 1.0) == pytest.approx(
        0.14
    )


@pytest.mark.parametrize(
    ("value", "down"),
    [
        (1.0, 1.0), (0.3, 0.3), (0.123456, 0.123), (98765.0, 98700.0), (5.005e-7, 5e-7),
        (math.nextafter(1.0, 0.0), 0.999), (math.nextafter(0.02, 0.0), 0.0199),
    ],
)  # fmt: skip
def test_three_digits_downwards(value: float, down: float) -> None:
    assert sampling.rounded_down(value) == down


@given(st.floats(1e-300, 1e300))
def test_what_is_rounded_down_has_three_digits_and_stays(value: float) -> None:
    down = sampling.rounded_down(value)
    assert value * (1 - 0.0101) < down <= value
    assert down == float(f"{down:.3g}")
    assert sampling.rounded_down(down) == down


def test_exponents_that_binary64_cannot_execute() -> None:
    reason = evaluation_rule.reason_against_exponents
    assert reason(np.array([-1.0, 1.0]), 2, 1, 2.0) is None
    assert reason(np.array([-1.0, 3.0]), 2, 1, 2.0) is None
    assert "got 1. Kernels that grow faster" in reason(np.array([-1.0, 3.001]), 2, 1, 2.0)
    assert "must hold 2 that are at most 6 / window = 3; got 1." in reason(
        np.array([-1.0, 4.0]), 2, 1, 2.0
    )
    assert reason(np.array([-1.0, 4.0]), 2, 2, 2.0) is None  # two outputs need half of them
    assert reason(np.array([4.0]), 2, 1, 2.0) is None  # too few anyway: refused elsewhere
    most = evaluation_rule.MAX_GROWTH_EXPONENT
    assert reason(np.array([0.0, 0.0, most / 2]), 2, 1, 2.0) is None
    assert f"must be at most {most:g}; got" in reason(np.array([0.0, 0.0, most / 1.99]), 2, 1, 2.0)
    assert evaluation_rule.reason_against_margin(1.0, 3.0, 0.99) is None
    assert "observer.margin must be below 1," in evaluation_rule.reason_against_margin(
        1.0, 3.0, 1.0
    )


def test_one_peak_in_the_window() -> None:
    # b = s e^{-s}: one peak at 1
    F = np.array([[-1.0, 0.0], [1.0, -1.0]])
    one = np.array([[1.0]])
    assert evaluation_rule.has_peak(F, one, 3.0, 0.5)
    assert not evaluation_rule.has_peak(F, one, 3.0, 1.0)  # not beyond the margin
    assert not evaluation_rule.has_peak(F, one, 1.1, 0.5)  # too close to the end: 1 > .9 * 1.1
    assert evaluation_rule.has_peak(F, one, 1.3, 0.5)
    assert not evaluation_rule.has_peak(F, one, 1.12, 0.5)  # has not fallen to .98 of it
    assert not evaluation_rule.has_peak(F, np.eye(1, 2), 3.0, 0.5)  # two directions
    # sin 4 s, of which the size peaks twice
    turn = np.array([[0.0, 4.0, 0], [-4.0, 0.0, 0], [4.0, 0, 0]])
    assert not evaluation_rule.has_peak(turn, np.array([[1.0], [0.0]]), 2.0, 0.1)


def test_a_threshold_is_a_share_of_the_peak() -> None:
    window = features.FeatureWindow(
        np.array([[-1.0]]), np.array([[1.0]]), np.array([[1.0]]), exponents=np.array([-1.0]),
        tau=3.0, margin=0.5,
    )  # fmt: skip
    threshold = evaluation_rule.threshold_for(window, 2.0)  # |b| = s e^{-s}
    assert threshold == pytest.approx(2 / math.e, rel=1e-4)
    assert threshold < 2 / math.e
    rule = evaluation_rule.evaluation_rule(window, noisy=True)
    assert rule == ("peak", pytest.approx(3.0))


def test_several_outputs_in_noise_have_no_peak() -> None:
    window = features.FeatureWindow(
        np.array([[-1.0]]), np.array([[1.0], [2.0]]), np.array([[1.0]]),
        exponents=np.array([-1.0]), tau=3.0, margin=0.5,
    )  # fmt: skip
    assert evaluation_rule.evaluation_rule(window, noisy=False)[0] == "peak"
    assert evaluation_rule.evaluation_rule(window, noisy=True)[0] == "position"
