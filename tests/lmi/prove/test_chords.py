"""Chords against 50-digit truth, on stiff flows: what holds is proved, its twin never is.

The truth is the largest norm over many theta, from exponentials with 200 bits. A bound that is a
little above it is to be proved; one that is a little below it is false.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lmi.arithmetic.balls import (
    ball,
    certify_positive_definite,
    exact,
    exp_times,
    middle,
    precision,
)
from lmi.arithmetic.exponential import expm
from lmi.prove.common_matrix import prove, prove_common
from lmi.prove.condition import Condition
from lmi.prove.tails import falling_forms

POINTS = 300


def stiff_flow(rng: np.random.Generator, n: int, fast: float, slowest: float) -> np.ndarray:
    """Modes near `slowest` and, from the last state back, near -fast; mixed coordinates."""
    D = np.diag([slowest, *-rng.uniform(0.2, 1.0, n - 1)])
    first = int(rng.integers(1, n))
    D[first:, first:] *= fast
    if n - first >= 2 and rng.random() < 0.5:  # a fast mode that oscillates
        D[-2:, -2:] = fast * np.array([[-0.5, 1.0], [-1.0, -0.5]])
    T = np.eye(n) + 0.4 * rng.standard_normal((n, n))
    return np.asarray(T @ D @ np.linalg.inv(T))


def positive(rng: np.random.Generator, n: int) -> np.ndarray:
    X = rng.standard_normal((n, n))
    return X @ X.T + 0.3 * np.eye(n)


def stiff_condition(seed: int) -> Condition:
    """Any shape that a proof may have: one P before or after jumps, or windows, reduced or not."""
    rng = np.random.default_rng(seed)
    n, fast = int(rng.integers(2, 6)), 10.0 ** rng.uniform(1, 6)
    low = float(rng.choice([0.0, 1e-5, 0.3]))
    high = low + float(rng.choice([0.0, 1e-3, 0.5, 3.0]))
    slowest = float(rng.choice([-0.5, 0.0, 0.4]))
    if slowest < 0 and rng.random() < 0.4:
        high = math.inf
    F, H, r = stiff_flow(rng, n, fast, slowest), rng.standard_normal((n, n)), n - 1
    flow, jump, one = exact(F), exact(H), positive(rng, n)
    shape = rng.choice(["before", "after", "windows", "reduced"])
    if shape == "before":
        return Condition(flow, jump, one, one, low, high)
    if shape == "after":
        return Condition(flow, exact(np.eye(n)), one, one, low, high, left=jump)
    if shape == "windows":
        return Condition(flow, jump, positive(rng, n), one, low, high)
    small = positive(rng, r), positive(rng, r)
    return Condition(flow, exact(H[:, :r]), *small, low, high, left=exact(H.T[:r]))


def true_gamma(condition: Condition) -> float:
    """The largest norm of the family, sought on a grid that is refined where it is largest."""
    end = condition.high if math.isfinite(condition.high) else condition.low + 40.0
    length = end - condition.low
    early = condition.low + length * np.geomspace(1e-12, 1.0, POINTS)
    thetas = np.unique([condition.low, *early, *np.linspace(condition.low, end, POINTS)])
    largest = 0.0
    for _ in range(4):
        thetas = np.minimum(thetas, end)
        norms = [norm_at(condition, float(theta)) for theta in thetas]
        k = int(np.argmax(norms))
        largest = max(largest, norms[k])
        thetas = np.linspace(thetas[max(k - 1, 0)], thetas[min(k + 1, len(thetas) - 1)], 30)
    return largest


def norm_at(condition: Condition, theta: float) -> float:
    """Norm of the family at one theta: e^{F theta} with 200 bits, the rest in floats."""
    source, target = (np.linalg.cholesky(P) for P in (condition.P_source, condition.P_target))
    with precision(200):
        M = exp_times(condition.F, theta) * ball(condition.right)
        M = M if condition.left is None else ball(condition.left) * M
        turned = target.T @ middle(M) @ np.linalg.inv(source).T
    return float(np.linalg.norm(turned, 2))


# 39: balls that are too wide with 80 bits; 298: a mode that rests
@pytest.mark.parametrize("seed", [*range(6), 20, 39, 298, 509])
def test_random_stiff_families_are_proved_and_their_twins_are_not(seed: int) -> None:
    condition = stiff_condition(seed)
    gamma = true_gamma(condition)
    proof = prove(replace(condition, gamma=1.001 * gamma), method="chords")
    assert proof.outcome == "proved"
    assert proof.evidence["steps"] < 100
    twin = prove(replace(condition, gamma=(1 - 1e-6) * gamma), method="chords")
    assert twin.outcome == "undecided"


def actuator(fast: float, slow: float) -> tuple[np.ndarray, np.ndarray]:
    """x' = slow x + z, z' = -fast z: a fast actuator before a slow state."""
    return np.array([[slow, 1.0], [0.0, -fast]]), np.array([[0.5, 0.0], [0.2, 0.3]])


@pytest.mark.parametrize("fast", [1e2, 1e4, 1e8])
@pytest.mark.parametrize(
    ("slow", "high"), [(-0.5, 1e3), (-0.5, math.inf), (0.0, 100.0), (0.1, 5.0)]
)
def test_a_fast_actuator_costs_a_few_steps(fast: float, slow: float, high: float) -> None:
    F, H = actuator(fast, slow)
    P = np.diag([1.0, 0.5])
    proof = prove_common(F, H, P, 0.1, high, method="chords")
    assert proof.outcome == "proved"
    assert proof.evidence["steps"] <= 20
    # twins: a jump that is too large, and P with the wrong sign
    assert prove_common(F, 40 * H, P, 0.1, high, method="chords").outcome == "undecided"
    assert prove_common(F, H, -P, 0.1, high, method="chords").outcome == "undecided"


def test_an_endless_range_needs_a_flow_that_decays() -> None:
    F, H = actuator(1e4, -1e-3)
    P = np.diag([1.0, 0.5])
    assert prove_common(F, H, P, 0.1, math.inf, method="chords").outcome == "proved"
    for slow in (0.0, 1e-3):
        F, H = actuator(1e4, slow)
        assert prove_common(F, H, P, 0.1, 10.0, method="chords").outcome == "proved"
        assert prove_common(F, H, P, 0.1, math.inf, method="chords").outcome == "undecided"


def test_a_short_excursion_of_fast_modes_is_not_stepped_over() -> None:
    """|N| is largest at theta near 1e-6 and falls for ever after: the tail alone would miss it."""
    F = np.array([[-1.0, 2e6], [0.0, -1e6]])
    H = np.array([[0.2, 0.0], [0.0, 0.9]])
    P = np.eye(2)
    peak = max(np.linalg.norm(expm(F * t) @ H, 2) for t in np.geomspace(1e-8, 1e-4, 2000))
    assert peak > 1
    assert prove_common(F, H, P, 0.0, 1.0, method="chords", gamma=1.01 * peak).outcome == "proved"
    for gamma in (1.0, 0.999 * peak):
        for high in (1.0, math.inf):
            proof = prove_common(F, H, P, 0.0, high, method="chords", gamma=gamma)
            assert proof.outcome == "undecided"
            assert proof.evidence["theta"] < 1e-4


@pytest.mark.parametrize("fast", [1e3, 1e6])
def test_forms_that_fall_are_certified_only_where_they_do(fast: float) -> None:
    F = np.array([[-1.0, 3.0], [0.0, -fast]])
    with precision(160):
        bound = ball(exact(np.diag([1.0, 0.5])))
        for Q in falling_forms(ball(exact(F)), bound):
            assert certify_positive_definite(Q - bound) or Q is bound
            for theta in (1e-6, 1e-3, 1.0):
                E = exp_times(exact(F), theta)
                assert certify_positive_definite(Q - E.transpose() * Q * E)
        assert falling_forms(ball(exact(F)), bound)
        assert not falling_forms(ball(exact(F + 1.01 * np.eye(2))), bound)
        assert not falling_forms(ball(exact(F + np.eye(2))), bound)


@pytest.mark.parametrize("speed", [1.0, 100.0])
def test_a_flow_that_turns_costs_a_few_chords(speed: float) -> None:
    """A chord leaves its arc by an eighth of the square of its length, and by no more."""
    F, H = np.array([[0.2, 3.0], [-1.0, 0.2]]), np.array([[0.2, 0.1], [0.0, 0.3]])
    proof = prove_common(speed * F, H, np.eye(2), 0.1 / speed, 2.0 / speed, method="chords")
    assert proof.outcome == "proved"
    assert proof.evidence["steps"] <= 6
    wild = prove_common(speed * F, 4 * H, np.eye(2), 0.1 / speed, 2.0 / speed, method="chords")
    assert wild.outcome == "undecided"
