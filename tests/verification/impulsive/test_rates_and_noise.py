"""Windows, weights, rates and noise targets of impulsive observers."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.analysis.impulsive_noise import simulated
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from tests.systems.impulsive import (
    DOUBLE,
    SPLINE,
    chain,
    claim,
    first,
    impulsive_problem,
    investigate,
    verdicts,
)


def test_windows_are_the_shortest_or_as_asked() -> None:
    assert investigate(DOUBLE, [0.5, 1.5]).design.gains["window"] == 2
    two = (chain(3) + np.diag([-0.1, 0.2, 0.3]), np.eye(3), np.eye(3)[[0, 2]])
    assert investigate(two, [0.2, 1.0]).design.gains["window"] == 2
    long = investigate(DOUBLE, [0.5, 1.5], window=64)
    assert (long.verdict, long.design.gains["window"]) == ("proved", 64)
    assert claim(long, "strongly_observable").evidence["blocks"] == 2


@pytest.mark.parametrize("strategy", ["full", "compressed", "subspace", "quadratic"])
def test_a_decay_rate_is_reached_and_claimed(strategy: str) -> None:
    plant = DOUBLE if strategy == "full" else SPLINE
    outcome = investigate(plant, [0.4, 0.5], strategy=strategy, decay_rate=0.6)
    assert verdicts(outcome)["decay_rate"] == "proved"
    rate = claim(outcome, "rate").evidence
    assert rate["in_time"] >= 0.6 * (1 - 1e-6)
    assert rate["per_impulse"] <= math.exp(-0.6 * 0.5) * (1 + 1e-9)
    assert obsdesign.verify(outcome.design).verdict == "proved"


def test_an_alpha_too_small_for_the_rate_is_said() -> None:
    outcome = investigate(DOUBLE, [0.5, 1.5], decay_rate=1.0, alpha=1.2, strategy="full")
    assert verdicts(outcome)["decay_rate"] == "undecided"
    assert "alpha must be at least" in claim(outcome, "decay_rate").evidence["reason"]


@pytest.mark.parametrize(
    ("plant", "dwell", "options"),
    [
        (DOUBLE, [0.5, 1.5], {"window": 3}),
        ((chain(3), np.eye(3), first(3)), [0.1, 0.8], {}),
        (SPLINE, [0.1, 0.8], {}),
        (SPLINE, [0.4, 0.5], {"strategy": "subspace"}),
        (SPLINE, [0.4, 0.5], {"strategy": "quadratic"}),
        (([[0, 0], [1, -1]], [[1, 0], [1, 1]], first(2)), [0.2, 1.0], {}),
    ],
)  # fmt: skip
def test_brute_force_never_contradicts_the_rate(plant: Any, dwell: Any, options: Any) -> None:
    design = obsdesign.design(impulsive_problem(plant, dwell, **options))
    rate = next(c for c in design.claims if c.id == "rate").evidence
    for seed in range(3):
        for growth, steps in growths(design, dwell, seed):
            assert growth <= rate["constant"] * rate["per_impulse"] ** steps * (1 + 1e-9)


def growths(design: Any, dwell: Any, seed: int) -> list[tuple[float, int]]:
    """(norm of the product of N error maps just before impulses, N), from the runtime's gains."""
    from lmi.arithmetic.exponential import expm
    from obsdesign.runtime import Sample, from_design

    rng = np.random.default_rng(seed)
    observer: Any = from_design(design)
    A, G, C = (design.gains[name] for name in "AGC")
    spacings = rng.choice([*dwell, sum(dwell) / 2], 12) if seed else rng.uniform(*dwell, 12)
    state = observer.init(t=0.0)
    product, growths, t = np.eye(len(A)), [], 0.1
    for count, spacing in enumerate([*spacings, 0.0]):
        state, _ = observer.step(state, Sample(t, y=np.zeros(len(C)), jump=True))
        L, _ = observer._gain(state)
        growths.append((float(np.linalg.norm(product, 2)), count))
        product = expm(A * spacing) @ (G + L @ C) @ product
        t += spacing
    return growths


def test_noise_targets_choose_window_and_alpha() -> None:
    outcome = investigate(DOUBLE, [0.5, 1.5], noise_target=[0.9, 0.5])
    gains = ImpulsiveGains.from_document(outcome.design.gains)
    assert gains.window is not None
    assert gains.alpha is not None
    assert (simulated(gains, np.ones(1)).std <= [0.9, 0.5]).all()
    # neither a shorter window nor a faster memory would do
    shorter = replace(gains, window=gains.window - 1, alpha=1.02)
    assert not (simulated(shorter, np.ones(1)).std <= [0.9, 0.5]).all()
    faster = replace(gains, alpha=gains.alpha * 1.02)
    assert not (simulated(faster, np.ones(1)).std <= [0.9, 0.5]).all()
    halved = investigate(DOUBLE, [0.5, 1.5], noise_target=[0.45, 0.25], output={"noise_std": [0.5]})
    assert halved.design.gains["alpha"] == pytest.approx(gains.alpha, rel=1e-3)


def test_a_noise_target_out_of_reach_is_undecided() -> None:
    outcome = investigate(DOUBLE, [0.5, 1.5], noise_target=[0.3, 0.1], window=3)
    assert outcome.verdict == "undecided"
    reason = claim(outcome, "noise_target").evidence["reason"]
    assert reason.startswith("with a window of 3 and alpha 1.02 the estimated standard deviations")


def test_the_estimate_is_that_of_simulated_noise() -> None:
    from obsdesign.runtime import Sample, from_design

    design = obsdesign.design(impulsive_problem(DOUBLE, [0.5, 1.5], window=4, alpha=1.3))
    observer: Any = from_design(design)
    rng = np.random.default_rng(8)
    state, errors, t = observer.init(t=0.0), [], 0.0
    for _ in range(3000):
        t += rng.uniform(0.5, 1.5)
        state, estimate = observer.step(state, Sample(t, y=rng.standard_normal(1), jump=True))
        errors.append(estimate.x)
    measured = np.std(errors[20:], axis=0)
    gains = ImpulsiveGains.from_document(design.gains)
    assert measured == pytest.approx(simulated(gains, np.ones(1)).std, rel=0.08)
