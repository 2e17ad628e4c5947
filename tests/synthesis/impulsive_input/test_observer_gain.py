"""K with given poles, by weights, or as given: which, and what is refused."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.synthesis.impulsive_input.observer_gain import observer_gain
from obsdesign.synthesis.placement import riccati_gain
from tests.systems.impulsive_input import CHAIN

A = np.array(CHAIN["flow"]["A"])
BOTH = [[1.0, 0, 0], [0, 0, 1.0]]


def investigated(outputs: Any = None, **options: Any) -> Any:
    body = copy.deepcopy(CHAIN)
    body["output"]["C"] = outputs or body["output"]["C"]
    body["observer"] |= options
    return obsdesign.investigate(obsdesign.Problem.from_dict(body))


def poles_of(gains: Any) -> Any:
    D = np.array(gains["A"]) - np.array(gains["K"]) @ np.array(gains["C"])
    return np.sort_complex(np.linalg.eigvals(D))


@pytest.mark.parametrize("outputs", [None, BOTH])
def test_the_observer_has_the_poles_of_the_file(outputs: Any) -> None:
    for poles, values in (
        ([-0.1, -0.15, -0.2], [-0.2, -0.15, -0.1]),
        ([[-0.1, 0.05], -0.2], [-0.2, -0.1 - 0.05j, -0.1 + 0.05j]),
    ):
        outcome = investigated(outputs, poles=poles)
        assert outcome.verdict == "proved"
        gains = outcome.design.gains
        np.testing.assert_allclose(poles_of(gains), values, atol=1e-9)
        if outputs is None and values[1] == -0.15:  # Section IV
            np.testing.assert_allclose(gains["K"], [[0.000168], [0.0048], [0.02]], atol=1e-9)
        assert obsdesign.verify(outcome.design).verdict == "proved"


@pytest.mark.parametrize("outputs", [None, BOTH])
def test_weights_give_the_gain_of_a_kalman_filter(outputs: Any) -> None:
    C = np.array(outputs or CHAIN["output"]["C"], float)
    weights = {"state": [1e-4, 1e-5, 1e-5], "output": [10.0] * len(C)}
    outcome = investigated(outputs, weights=weights)
    assert outcome.verdict == "proved"
    K = np.array(outcome.design.gains["K"])
    np.testing.assert_array_equal(K, riccati_gain(A, C, weights))
    # S A' + A S - S C' R^-1 C S + Q = 0 with S C' = K R
    R, Q = np.diag(weights["output"]), np.diag(weights["state"])
    flow = np.kron(np.eye(3), A) + np.kron(A, np.eye(3))
    S = np.linalg.solve(flow, (K @ R @ K.T - Q).ravel()).reshape(3, 3)
    np.testing.assert_allclose(S @ C.T, K @ R, atol=1e-9)


def test_without_poles_none_is_refused() -> None:
    """By default zero where floats hold no gain; its twin has one."""
    C = np.ones((1, 6))
    for distance, has_gain in ((1e-3, False), (0.5, True)):
        A = np.diag(1 + distance * np.arange(6)) / 100
        body = {
            "flow": {"A": A.tolist()},
            "jump": {"H": np.eye(6)[:, -1:].tolist(), "dwell_time": [200.0, "inf"]},
            "output": {"C": C.tolist()},
            "observer": {"kind": "impulsive_input"},
        }
        K = observer_gain(obsdesign.Problem.from_dict(body), 200.0)
        assert K.any() == has_gain


def test_a_pole_that_does_not_decay_is_refuted() -> None:
    claims = {claim.id: claim.verdict for claim in investigated(poles=[0.1, -0.15, -0.2]).claims}
    assert claims["hurwitz"] == claims["poles"] == "refuted"
    outcome = investigated(BOTH, poles=[0.1, -0.15, -0.2])
    assert outcome.verdict == "refuted"
    witness = next(claim for claim in outcome.claims if claim.id == "poles").evidence["witness"]
    assert witness["pole"] == {"real": 0.1, "imag": 0.0}


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"poles": [-1.0, -2, -3], "gains": {"K": [[0], [0], [0]]}}, "poles chooses K, but K is given"),
        ({"weights": {"output": [1]}, "gains": {"K": [[0], [0], [0]]}}, "weights chooses K, but K is"),
        ({"poles": [-1.0, -2, -3], "weights": {"output": [1]}}, "both choose K; drop one"),
        ({"poles": [-1.0, -2]}, "must give 3 poles"),
        ({"weights": {"output": [1, 1]}}, "weights.output must have 1 entry"),
        ({"poles": [-1.0, -2, -3], "operator": "samples"}, "poles belongs to operator 'integral'"),
        ({"threshold": 1.0, "smallest_weight": 1.0}, "threshold and observer.smallest_weight both"),
    ],
)  # fmt: skip
def test_one_choice_of_gain_and_of_threshold(options: dict[str, Any], line: str) -> None:
    with pytest.raises(obsdesign.InputError, match=line):
        investigated(**options)


def test_a_smallest_weight_takes_one_direction() -> None:
    body = copy.deepcopy(CHAIN)
    body["jump"]["H"] = [[1, 0], [0, 1], [0, 0]]
    body["observer"]["smallest_weight"] = 1.0
    with pytest.raises(obsdesign.InputError, match=r"one direction of impulses; jump\.H has 2"):
        obsdesign.investigate(obsdesign.Problem.from_dict(body))
