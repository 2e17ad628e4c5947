"""The threshold of a smallest weight: proved from the file, and it separates weights."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import obsdesign
from lmi.arithmetic.balls import exact
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.impulsive_input.features import FeatureWindow, filtered_system
from obsdesign.runtime import from_design
from obsdesign.verification.impulsive_input.smallest_weight import smallest_weight
from tests.systems.impulsive_input import CHAIN, record

SLOW = [-0.65, -0.7, -0.75, -0.8]
TWO_OUTPUTS = [[0, 1, 0], [0, 0, 1]]


def design_of(weight: float, outputs: Any = None, **options: Any) -> Any:
    body = copy.deepcopy(CHAIN)
    body["output"]["C"] = outputs or body["output"]["C"]
    body["observer"] |= {"smallest_weight": weight} | options
    return obsdesign.design(obsdesign.Problem.from_dict(body))


def claim_of(claims: Any, name: str) -> Any:
    return next(claim for claim in claims if claim.id == name)


@pytest.mark.parametrize("outputs", [None, TWO_OUTPUTS])
@pytest.mark.parametrize("weight", [1e-3, 2.5])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_weight_just_above_is_evaluated_and_one_below_is_not(
    outputs: Any, weight: float, sign: float
) -> None:
    design = design_of(weight, outputs, exponents=SLOW)
    assert design.gains["rule"] == "threshold"
    assert claim_of(design.claims, "smallest_weight").verdict == "proved"
    observer = from_design(design)
    t = np.round(0.05 * np.arange(1201), 10)
    for share, count in ((0.98, 0), (1.02, 1)):
        train = ((12.34567, sign * share * weight),)
        x = record(CHAIN["flow"]["A"], CHAIN["jump"]["H"], train, t, [4, 20, 60])
        events = observer.run_batch(t, x @ np.array(design.gains["C"]).T, x=[4, 20, 60]).events
        assert len(events) == count
        assert all(event.t == pytest.approx(12.34567, abs=1e-4) for event in events)


def test_the_threshold_is_the_weight_times_the_largest_feature() -> None:
    design = design_of(2.0)
    gains = design.gains
    D = np.array(gains["A"]) - np.array(gains["K"]) @ np.array(gains["C"])
    F = filtered_system(D, np.array(gains["C"]), np.array(gains["exponents"]))
    sizes = [np.linalg.norm(expm(F * s)[3:, 0]) for s in np.linspace(0, 20, 801)]
    assert gains["threshold"] == pytest.approx(2 * max(sizes), rel=1e-4)
    assert "of weight 2.0 or more and with features that first exceed the threshold at" in (
        design.guarantees[0].statement
    )


def test_another_threshold_in_the_file_is_refuted() -> None:
    design = design_of(2.0)
    assert obsdesign.verify(design).verdict == "proved"
    for factor in (0.99, 1.01):
        gains = {**design.gains, "threshold": factor * design.gains["threshold"]}
        outcome = obsdesign.verify(replace(design, gains=gains))
        assert claim_of(outcome.claims, "consistent").verdict == "refuted"
        assert "threshold" in str(claim_of(outcome.claims, "consistent").evidence)
    # the twin: within what rounding may do, but above the largest feature
    gains = {**design.gains, "threshold": (1 + 1e-7) * design.gains["threshold"]}
    outcome = obsdesign.verify(replace(design, gains=gains))
    assert claim_of(outcome.claims, "consistent").verdict == "proved"
    assert claim_of(outcome.claims, "smallest_weight").verdict == "undecided"


def test_features_that_are_largest_before_the_margin_do_not_count() -> None:
    # fast exponents and an output that jumps: |b| is largest soon after the impulse
    D, C, H = (exact(v) for v in ([[-1.0]], [[1.0]], [[1.0]]))
    window = FeatureWindow(D, C, H, exponents=np.array([-2.0, -3.0]), tau=5.0, margin=2.0)
    F = filtered_system(np.array([[-1.0]]), np.array([[1.0]]), window.exponents)
    early, late = (max(np.linalg.norm(expm(F * s)[1:, 0]) for s in ages)
                   for ages in (np.linspace(0, 2, 401), np.linspace(2, 5, 401)))  # fmt: skip
    assert late < 0.9 * early
    assert smallest_weight(window, 1.0, 0.99 * late).verdict == "proved"
    assert smallest_weight(window, 1.0, 0.99 * early).verdict == "undecided"


def test_the_largest_feature_in_balls_is_that_of_exact_numbers() -> None:
    A, C, H = (
        np.array(CHAIN[a][b], float) for a, b in (("flow", "A"), ("output", "C"), ("jump", "H"))
    )
    D = flow_error_matrix(exact(A), exact(np.zeros((3, 1))), exact(C))
    window = FeatureWindow(D, exact(C), exact(H), exponents=np.array(SLOW), tau=20.0, margin=5.0)
    F = filtered_system(A, C, np.array(SLOW))
    claim = smallest_weight(window, 3.0, 1.0)
    top = 3 * np.linalg.norm(expm(F * claim.evidence["approx_age"])[3:, 0])
    assert smallest_weight(window, 3.0, top * (1 - 1e-9)).verdict == "proved"
    assert smallest_weight(window, 3.0, top * (1 + 1e-9)).verdict == "undecided"
