"""Exponents that are left open: the corner, what IPOPT makes of it, margins near the window."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import obsdesign
from lmi.time_budget import UNLIMITED
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.impulsive_input.features import FeatureWindow, filtered_system
from obsdesign.synthesis.impulsive_input.exponent_program import (
    peak_age,
    refined_exponents,
    time_deviation,
)
from obsdesign.synthesis.impulsive_input.exponents import slowest_exponent
from tests.systems.impulsive_input import CHAIN

A, C = np.array(CHAIN["flow"]["A"]), np.array([[0.0, 0, 1]])
H = np.array([[1.0], [0], [0]])
D = flow_error_matrix(A, np.array([[0.0002], [0.0048], [0.02]]), C)
TAU, MARGIN = 20.0, 5.0


def body(**changes: Any) -> dict[str, Any]:
    changed = copy.deepcopy(CHAIN)
    for path, value in changes.items():
        block, key = path.split("__")
        changed[block][key] = value
    return changed


def investigated(**changes: Any) -> Any:
    return obsdesign.investigate(obsdesign.Problem.from_dict(body(**changes)))


def features(exponents: Any) -> FeatureWindow:
    return FeatureWindow(D, C, H, exponents=exponents, tau=TAU, margin=MARGIN)


def deviation(exponents: Any, scale: float = 1.0) -> float:
    lams = np.asarray(exponents)
    return time_deviation(features(lams), np.array([scale]), peak_age(features(lams)))


def test_the_deviation_is_that_of_simulated_noise() -> None:
    h, rng = 0.01, np.random.default_rng(0)
    lams = np.array([-0.65, -0.75, -0.9])
    kernels = np.exp(lams[:, None] * h * np.arange(2000))[:, ::-1]
    age = peak_age(features(lams))
    F = filtered_system(D, C, lams)
    state = expm(F * age)[:, :3] @ H[:, 0]
    J = np.column_stack([(F @ state)[3:], state[3:]])
    noise = rng.standard_normal((4000, 2000)) * np.sqrt(1 / h)  # intensity one
    errors = (noise @ kernels.T * h) @ np.linalg.pinv(J).T
    assert errors[:, 0].std() == pytest.approx(deviation(lams), rel=0.05)
    assert deviation(lams, 3.0) == pytest.approx(3 * deviation(lams), rel=1e-12)


@pytest.mark.parametrize(("ratio", "wanted"), [(1e-7, 0.9956), (0.05, 0.1261), (0.2, 0.0920)])
def test_ipopt_confirms_the_corner(ratio: float, wanted: float) -> None:
    first = slowest_exponent(features(np.zeros(0)), ratio)
    assert first is not None
    for count in (3, 6):
        corner = first - 0.05 * np.arange(count)
        better, size, _ = refined_exponents(features(corner), np.ones(1), None, UNLIMITED)
        assert better is not None
        np.testing.assert_allclose(better, corner, atol=1e-3)
        assert size == pytest.approx(1, abs=1e-4)
        if count == 3:  # variance 10, period 0.01, weight 5
            assert deviation(corner) * np.sqrt(0.1) / 5 == pytest.approx(wanted, abs=1e-4)


def test_ipopt_improves_exponents_that_are_no_corner() -> None:
    # the twin: gaps wider than the least one
    wide = -0.6547542 * np.array([1.0, 1.6, 2.8])
    better, size, _ = refined_exponents(features(wide), np.ones(1), None, UNLIMITED)
    assert better is not None
    assert size < 0.99
    assert size == pytest.approx(deviation(better) / deviation(wide), rel=1e-9)
    np.testing.assert_allclose(better, wide[0] * np.array([1.0, 1.6, 2.2]), atol=1e-3)


def test_check_exponents_says_what_it_found() -> None:
    outcome = investigated(observer__check_exponents=True)
    assert outcome.verdict == "proved"
    assert outcome.result["form"] == "6 exponents, confirmed by IPOPT"
    plain = investigated()
    np.testing.assert_array_equal(
        outcome.design.gains["exponents"], plain.design.gains["exponents"]
    )


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"observer__exponents": [-1.0, -2.0, -3.0]}, "observer.exponents leaves none"),
        ({"observer__operator": "samples"}, "operator = 'samples' leaves none"),
        ({"output__noise_std": [0.1]}, "is about observer.weighting = 'plain'"),
        ({"jump__H": [[1, 0], [0, 1], [0, 0]]}, "one direction of impulses; jump.H has 2"),
    ],
)
def test_check_exponents_where_there_is_nothing_to_check(
    changes: dict[str, Any], line: str
) -> None:
    with pytest.raises(obsdesign.InputError, match=line):
        investigated(observer__check_exponents=True, **changes)


@pytest.mark.parametrize("turning", [False, True])
def test_a_margin_next_to_the_window_is_answered(turning: bool) -> None:
    changes: dict[str, Any] = {}
    if turning:  # a complex spectrum, where uniqueness is decided by looking along the curve
        changes = {
            "flow__A": [[-0.1, 1, 0], [-1, -0.1, 0], [0, 0.5, -0.2]],
            "observer__gains": {"K": [[0], [0], [0]]},
        }
    for margin in (19.0, 19.9, 19.99999):
        outcome = investigated(observer__margin=margin, **changes)
        assert outcome.verdict == "proved", (margin, outcome.claims)
