"""Dwell times published with C. Briat, Automatica 49 (2013), and what is true of them.

With both gains zero, kind `luenberger` answers whether the plant itself is stable.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import obsdesign


def plant_verdict(A: object, J: object, dwell: list[object]) -> str:
    n = len(np.asarray(A))
    zeros = np.zeros((n, 1)).tolist()
    return obsdesign.investigate(
        obsdesign.Problem(
            flow={"A": A}, jump={"G": J, "dwell_time": dwell}, output={"C": np.eye(1, n)},
            observer={"kind": "luenberger", "gains": {"L": zeros, "M": zeros}},
        )
    ).verdict  # fmt: skip


def test_shortest_dwell_time_of_the_academic_plant() -> None:
    A, J = [[-1, 0], [1, -2]], [[2, 1], [1, 3]]
    assert plant_verdict(A, J, [1.1406, "inf"]) == "proved"
    assert plant_verdict(A, J, [1.1405, "inf"]) == "refuted"


@pytest.mark.parametrize("excess", [1e-4])
def test_range_of_dwell_times(excess: float) -> None:
    A, J = [[-1, 0.1], [0, 1.2]], [[1.2, 0], [0, 0.5]]
    low, high = math.log(1.2), math.log(2) / 1.2
    assert low == pytest.approx(0.182321556794, abs=1e-12)
    assert high == pytest.approx(0.577622650467, abs=1e-12)
    assert plant_verdict(A, J, [low + excess, high - excess]) == "proved"
    assert plant_verdict(A, J, [low - excess, high - excess]) == "refuted"
    assert plant_verdict(A, J, [low + excess, high + excess]) == "refuted"


def test_longest_dwell_time() -> None:
    A, J = [[1, 3], [-1, 2]], [[0.5, 0], [0, 0.5]]
    longest = math.log(2) / 1.5
    assert longest == pytest.approx(0.462098120373, abs=1e-12)
    assert plant_verdict(A, J, [0, longest - 1e-4]) == "proved"
    assert plant_verdict(A, J, [0, longest + 1e-4]) == "refuted"
