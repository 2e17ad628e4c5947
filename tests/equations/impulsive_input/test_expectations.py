"""Deviations of time and weight: covariances written out, and a simulated least-squares fit."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from obsdesign.equations.impulsive_input import expectations
from obsdesign.equations.impulsive_input.deviations import NoisyImpulses, peak_age
from obsdesign.equations.impulsive_input.features import FeatureWindow, window_taps

D = np.array([[-0.5, 1.0], [-2.0, -0.8]])
H, EXPONENTS, TAU, PERIOD, AGE = (
    np.array([[0.0], [1.0]]),
    np.array([-3.0, -1.0, 0.5]),
    2.0,
    0.02,
    1.3,
)
STD = np.array([0.01, 0.04])


def window_of(C: np.ndarray) -> FeatureWindow:
    return FeatureWindow(D, C, H, exponents=EXPONENTS, tau=TAU, margin=0.2)


def gains_of(p: int, **changes: Any) -> Any:
    plain = {"period": PERIOD, "noise_std": STD[:p], "window": TAU, "directions": 1}
    gains = SimpleNamespace(**plain | changes)
    gains.in_output_units = lambda: gains
    return gains


def responses(C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(times, d samples / d (impulse earlier, weight)) of all outputs, (p, samples, 2)."""
    times = PERIOD * np.arange(101)
    age = times - (TAU - AGE)
    flows = [expm(D * max(a, 0.0)) @ H * (a >= -1e-12) for a in age]
    return times, np.stack([
        np.array([[(c @ D @ E).item(), (c @ E).item()] for E in flows]) for c in C
    ])  # fmt: skip


@pytest.mark.parametrize("p", [1, 2])
def test_deviations_by_their_covariances(p: int) -> None:
    C = np.array([[1.0, 0.5], [0.0, 1.0]])[:p]
    values = expectations._deviations(window_of(C), gains_of(p), AGE)
    times, samples = responses(C)
    taps = window_taps(EXPONENTS, times)
    J = np.vstack([taps.T @ one for one in samples])
    N = np.zeros((3 * p, 3 * p))
    for j in range(p):
        N[3 * j : 3 * j + 3, 3 * j : 3 * j + 3] = STD[j] ** 2 * taps.T @ taps
    gls = np.linalg.inv(J.T @ np.linalg.solve(N, J))
    back = np.linalg.pinv(J)
    plain = back @ N @ back.T
    bound = np.linalg.inv(sum(one.T @ one / STD[j] ** 2 for j, one in enumerate(samples)))
    for label, covariance in (("gls", gls), ("plain", plain), ("bound", bound)):
        for k, name in enumerate(("time", "weight")):
            value = values[f"{name}_std_{label}"]
            assert value == pytest.approx(math.sqrt(covariance[k, k]), rel=1e-6)
    assert values["time_std_bound"] <= values["time_std_gls"] <= values["time_std_plain"]
    assert len(values) == 6


def test_a_least_squares_fit_of_noise_deviates_as_expected() -> None:
    C = np.array([[1.0, 0.5]])
    values = expectations._deviations(window_of(C), gains_of(1), AGE)
    _, (samples,) = responses(C)
    noise = STD[0] * np.random.default_rng(0).standard_normal((4000, 101))
    fits = noise @ np.linalg.pinv(samples).T
    assert fits.std(axis=0) == pytest.approx(
        [values["time_std_bound"], values["weight_std_bound"]], rel=0.05
    )


@pytest.mark.parametrize(
    "changes",
    [{"period": None}, {"noise_std": np.zeros(1)}, {"directions": 2}, {"period": TAU / 20_001}],
)
def test_none_without_noise_or_samples(changes: dict[str, Any]) -> None:
    C = np.array([[1.0, 0.5]])
    assert expectations._deviations(window_of(C), gains_of(1, **changes), AGE) == {}


@pytest.mark.parametrize("rule", ["peak", "threshold", "position"])
def test_peaks_and_weights_of_a_design(rule: str) -> None:
    # |b| = s e^{-s}, of which the peak is 1/e at 1
    gains = gains_of(
        1, C=np.eye(1), H=np.eye(1), n=1, exponents=np.array([-1.0]), window=3.0, margin=0.5,
        rule=rule, threshold=0.1 if rule == "threshold" else None, period=None,
        noise_std=np.zeros(1),
    )  # fmt: skip
    expected = expectations.expectations(-np.eye(1), gains)
    assert expected.peak == pytest.approx(1 / math.e, rel=1e-4)
    assert expected.peak_age == pytest.approx(1.0, abs=0.02)
    assert expected.latency == 3.0
    age = 1.0 if rule == "peak" else 0.7 * 3.0
    assert expected.evaluated_at_age == pytest.approx(age, abs=0.02)
    if rule == "threshold":
        assert expected.smallest_weight == pytest.approx(0.1 * math.e, rel=1e-4)
        # the largest whose features stay below the threshold up to the margin .5
        assert expected.largest_weight == pytest.approx(0.1 / (0.5 * math.exp(-0.5)), rel=0.02)
    else:
        assert expected.smallest_weight is None
        assert expected.largest_weight is None
    evidence = expected.to_evidence()
    assert set(evidence) - {"smallest_weight", "largest_weight"} == {
        "peak", "peak_age", "evaluated_at_age", "latency", "neglected_ratio",
    }  # fmt: skip


@pytest.mark.parametrize("speed", [-0.5, 0.0, 0.5])
def test_deviations_are_foreseen_where_errors_decay(speed: float) -> None:
    gains = gains_of(
        1, C=np.eye(1), H=np.eye(1), K=np.zeros((1, 1)), exponents=np.array([-1.0]), margin=0.5,
        shortest_dwell=5.0, weighting="gls", state_correction=False,
    )  # fmt: skip
    impulses = NoisyImpulses.from_gains(np.array([[speed]]), gains)
    assert (impulses is None) is (speed >= 0)
    gains.noise_std = np.zeros(1)
    assert NoisyImpulses.from_gains(np.array([[speed]]), gains) is None


@pytest.mark.parametrize("top", [0.3, 1.2, 7.6, 18.8])
def test_a_peak_between_two_points_of_a_grid(top: float) -> None:
    size = 5.0 - 0.01 * (np.arange(20) - top) ** 2
    states = np.stack([np.zeros(20), size], axis=1)[:, :, None]
    curve = SimpleNamespace(states=states, n=1, step=0.5)
    assert peak_age(curve) == pytest.approx(0.5 * top)
