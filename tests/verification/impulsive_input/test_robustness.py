"""Bounds of the features' change hold for every A in the box, and are nearly reached."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import obsdesign
from lmi.arithmetic.balls import exact
from obsdesign.equations.impulsive_input.features import (
    FeatureWindow,
    feature_scales,
    filtered_system,
)
from obsdesign.verification.impulsive_input.robustness import feature_change
from tests.systems.impulsive_input import CHAIN

A = np.array(CHAIN["flow"]["A"])
C, H = np.array([[0.0, 0, 1]]), np.array([[1.0], [0], [0]])
K = np.array([[0.0002], [0.0048], [0.02]])
LAMS = np.array([-0.65, -0.7, -0.75, -0.8])
TURNING = np.array([[-0.1, 1, 0], [-1, -0.1, 0], [0, 0.5, -0.2]])


def bounds(A: Any, K: Any, C: Any, H: Any, U: Any, lams: Any = LAMS) -> Any:
    D = exact(A) - exact(K) @ exact(C)
    window = FeatureWindow(D, exact(C), exact(H), exponents=lams, tau=20.0, margin=5.0)
    return feature_change(window, exact(A), U)


def changes(A: Any, K: Any, C: Any, start: Any, ages: Any, dA: Any, lams: Any = LAMS) -> Any:
    """Features with A + dA less those with A, and the latter, (ages, mp, r); state `start`."""
    n, F = len(A), filtered_system(A - K @ C, C, lams, feature_scales(lams, 20.0))
    size = len(F)
    both = np.zeros((size + n, size + n))
    both[:size, :size], both[:n, size:], both[size:, size:] = F, dA, A + dA
    nominal = np.vstack([start, np.zeros((size - n, start.shape[1]))])
    b = np.array([(expm(F * s) @ nominal)[n:] for s in ages])
    changed = [(expm(both * s) @ np.vstack([nominal, start]))[n:size] for s in ages]
    return np.array(changed) - b, b


@pytest.mark.parametrize(
    ("flow", "gain", "C", "H", "least"),
    [
        (A, K, C, H, 0.9),
        (TURNING, 0 * K, C, H, 0.4),
        (A, np.zeros((3, 2)), np.array([[0.0, 1, 0], [0, 0, 1]]), np.eye(3)[:, :2], 0.9),
    ],
)
@pytest.mark.parametrize("share", [1e-3, 0.05])
def test_no_change_of_A_in_the_box_exceeds_the_bounds(
    flow: Any, gain: Any, C: Any, H: Any, least: float, share: float
) -> None:
    U = share * (np.abs(flow) + 0.01)
    bound, rng, worst = bounds(flow, gain, C, H, U), np.random.default_rng(4), 0.0
    ages = np.linspace(0.5, 20, 14)
    for k in range(12):
        signs = rng.choice([-1.0, 1.0], (3, 3)) if k > 1 else np.ones((3, 3)) * (-1) ** k
        scale = rng.uniform(0, 1, (3, 3)) if k > 8 else 1.0
        change, b = changes(flow, gain, C, H, ages, U * signs * scale)
        assert (np.abs(change) <= bound.impulse).all()
        old = ages >= 5
        part = np.linalg.norm(change[old], axis=1) / np.linalg.norm(b[old], axis=1)
        assert (part <= bound.relative).all()
        worst = max(worst, float((np.abs(change).max(axis=0) / bound.impulse).max()))
        change, _ = changes(flow, gain, C, np.eye(3), [20.0], U * signs * scale)
        assert (np.abs(change[0]) <= bound.state).all()
    assert worst > least  # the bound is not more than a factor above what occurs


@pytest.mark.parametrize("seed", range(4))
def test_no_change_that_varies_in_time_exceeds_the_bounds(seed: int) -> None:
    """Steps of dA from corner to corner of the box; the twin: a box half as large is too small."""
    U, rng = 0.05 * (np.abs(A) + 0.01), np.random.default_rng(seed)
    F, start = filtered_system(A - K @ C, C, LAMS, feature_scales(LAMS, 20.0)), np.eye(7, 3) @ H
    nominal, changed = start, np.vstack([start, H])
    bound, largest = bounds(A, K, C, H, U), np.zeros(4)
    for _ in range(20):
        both = np.zeros((10, 10))
        # mostly one sign, so that changes add up
        dA = U * np.where(rng.random((3, 3)) < 0.9, 1.0, -1.0)
        both[:7, :7], both[:3, 7:], both[7:, 7:] = F, dA, A + dA
        nominal, changed = expm(F) @ nominal, expm(both) @ changed
        change = np.abs(changed[:7] - nominal)[3:]
        assert (change <= bound.impulse).all()
        largest = np.maximum(largest, change[:, 0])
    assert (largest > bounds(A, K, C, H, U / 2).impulse[:, 0]).any()


def test_a_growing_kernel_counts_as_at_run_time() -> None:
    lams, U = np.array([0.3, -0.65, -0.7, -0.75, -0.8]), 0.01 * np.abs(A)
    bound = bounds(A, K, C, H, U, lams)
    change, b = changes(A, K, C, H, np.linspace(5, 20, 31), U, lams)
    assert (np.abs(change) <= bound.impulse).all()
    assert (np.abs(change).max(axis=0) > 0.9 * bound.impulse).all()
    part = np.linalg.norm(change, axis=1) / np.linalg.norm(b, axis=1)
    assert 0.7 * bound.relative < part.max() <= bound.relative


def investigated(U: Any, **options: Any) -> Any:
    body = copy.deepcopy(CHAIN)
    body["observer"] |= {"uncertainty": np.asarray(U).tolist()} | options
    return obsdesign.investigate(obsdesign.Problem.from_dict(body))


def test_the_claim_is_proved_from_the_file_and_a_guarantee_of_its_own() -> None:
    outcome = investigated(0.01 * np.abs(A))
    assert outcome.verdict == "proved"
    assert obsdesign.verify(outcome.design).verdict == "proved"
    claim = next(claim for claim in outcome.claims if claim.id == "robustness")
    assert 0.01 < claim.evidence["relative"][0] < 0.1
    (sentence,) = [g for g in outcome.design.guarantees if tuple(g.claims) == ("robustness",)]
    assert sentence.given
    assert sentence.statement.startswith("Where entries of flow.A are off by at most")
    assert "robustness" not in outcome.design.guarantees[0].claims


def test_a_change_without_bound_is_not_proved() -> None:
    outcome = investigated(100 * np.ones((3, 3)))
    verdicts = {claim.id: claim.verdict for claim in outcome.claims}
    assert verdicts["robustness"] == "undecided"


def test_an_uncertainty_of_another_size_is_refused() -> None:
    with pytest.raises(obsdesign.InputError, match=r"observer\.uncertainty must have 3 entries"):
        investigated(np.ones((2, 2)))
    with pytest.raises(obsdesign.InputError, match=r"uncertainty, row 1, must have 3 entries"):
        investigated(np.ones((3, 2)))
    with pytest.raises(obsdesign.InputError, match="belongs to operator 'integral'"):
        investigated(np.ones((3, 3)), operator="samples")


ACROSS = np.array([[-0.5, 0], [0, -1.0]])


def across(H: Any) -> Any:
    D = exact(ACROSS) - exact([[0.1], [0.1]]) @ exact([[1, 1]])
    window = FeatureWindow(
        D, exact([[1, 1]]), exact(H), exponents=np.array([-0.3, -0.5, -0.7, -0.9]),
        tau=4.0, margin=1.0,
    )  # fmt: skip
    return feature_change(window, exact(ACROSS), np.array([[0, 0.1], [0, 0]]))


def test_weights_across_columns_are_within_the_bound() -> None:
    """Each column by itself changes by 1.2e-4 at most, their difference by 0.27."""
    H, gain = np.array([[1, 1], [0, 0.001]]), np.array([[0.1], [0.1]])
    bound, lams = across(H), np.array([-0.3, -0.5, -0.7, -0.9])
    dA, C, largest = np.array([[0, 0.1], [0, 0]]), np.ones((1, 2)), 0.0
    near = 3 * np.pi / 4 + np.linspace(-1e-3, 1e-3, 41)
    angles = np.concatenate([np.linspace(0, np.pi, 60), near])
    for angle in angles:
        start = H @ [[np.cos(angle)], [np.sin(angle)]]
        filtered = filtered_system(ACROSS - gain @ C, C, lams, feature_scales(lams, 4.0))
        both = np.zeros((8, 8))
        both[:6, :6], both[:2, 6:], both[6:, 6:] = filtered, dA, ACROSS + dA
        for age in (1.0, 2.0, 4.0):
            b = (expm(filtered * age) @ np.vstack([start, np.zeros((4, 1))]))[2:]
            changed = (expm(both * age) @ np.vstack([start, np.zeros((4, 1)), start]))[2:6]
            largest = max(largest, float(np.linalg.norm(changed - b) / np.linalg.norm(b)))
    assert 0.27 < largest < bound.relative < 1000
    # columns that span the same have the same bound
    assert across(np.eye(2)).relative == pytest.approx(bound.relative, rel=0.01)


@pytest.mark.parametrize("H", [[[1, 2], [0, 0]], [[1, 0], [0, 0]]])
def test_features_that_vanish_for_a_weight_have_no_relative_bound(H: Any) -> None:
    assert across(H).relative == np.inf
