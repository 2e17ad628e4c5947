"""Widths that no observer can guarantee less than."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign import Problem, load_problem
from obsdesign.studies.least_width import least_widths
from obsdesign.studies.typical import with_typical


def tanks(**output: Any) -> dict[str, Any]:
    """Two tanks in a row: level 2 is measured, an inflow of 0 to 1 to the first is not."""
    return {
        "flow": {"A": [[-0.5, 0], [0.5, -0.25]], "disturbance": {"lower": [0, 0], "upper": [1, 0]}},
        "output": {"C": [[0, 1]], "noise_bound": 0.2} | output,
        "observer": {"kind": "interval"},
    }


def widths(body: dict[str, Any]) -> list[float | None]:
    return least_widths(Problem.from_dict(body).plant)


def test_a_constant_inflow_hides_behind_the_noise() -> None:
    """e2 = .4 by the noise, e1 = e2 / 2 by the second row; the inflow .1 that it takes is allowed."""
    assert widths(tanks()) == pytest.approx([0.2, 0.4])


def test_without_noise_the_disturbance_is_what_cannot_be_hidden() -> None:
    assert widths(tanks(noise_bound=0.0)) == [None, None]
    assert widths(tanks(noise_bound=10.0)) == pytest.approx([2.0, 4.0])  # all of the inflow


@pytest.mark.parametrize("factor", [2.0, 1e-6, 1e6])
def test_units_of_states_are_those_of_the_widths(factor: float) -> None:
    body = tanks()
    body["flow"] = {"A": [[-0.5, 0], [0.5 * factor, -0.25]],
                    "disturbance": {"lower": [0, 0], "upper": [1, 0]}}  # fmt: skip
    body["output"]["C"] = [[0, 1 / factor]]
    assert widths(body) == pytest.approx([0.2, 0.4 * factor])


def test_asymmetric_noise_counts_with_its_width() -> None:
    assert widths(tanks(noise_bound=[[-0.1, 0.3]])) == pytest.approx([0.2, 0.4])


def test_events_that_must_happen_must_keep_the_difference() -> None:
    """An event that halves level 1 ends any constant difference; one that may never come does not."""
    body = tanks() | {"jump": {"G": [[0.5, 0], [0, 1]], "dwell_time": [1, "inf"]}}
    assert widths(body) == pytest.approx([0.2, 0.4])
    body["jump"]["dwell_time"] = [1, 2]
    assert widths(body) == [None, None]
    body["jump"]["disturbance"] = {"lower": [0, 0], "upper": [0.05, 0]}
    assert widths(body) == pytest.approx([0.1, 0.2])


def test_discrete_time_counts_steps() -> None:
    body = tanks()
    body["flow"] = {"A": [[0.5]], "dt": 1.0, "disturbance": {"lower": [-1], "upper": [1]}}
    body["output"] = {"C": [[1.0]], "noise_bound": 100.0}
    assert widths(body) == pytest.approx([4.0])


@pytest.mark.parametrize(
    "change",
    [
        {"state": {"lower": [0, 0], "upper": [1, 1]}},
        {"output": {"C": [[0, 1]]}},
        {"flow": {"A": [[-0.5, 0], [0.5, -0.25]], "D": [[1.0], [0.0]]}},
    ],
    ids=["box", "no bound of the noise", "unknown input"],
)
def test_nothing_is_said_where_a_constant_difference_may_not_be_allowed(change: Any) -> None:
    assert widths(copy.deepcopy(tanks()) | change) == [None, None]


@pytest.mark.parametrize("name", ["degue_4_1", "degue_4_3", "thermometer", "odometer_gps"])
def test_no_proved_width_is_below(name: str) -> None:
    outcome = with_typical(obsdesign.investigate(load_problem(Path("examples", f"{name}.toml"))))
    rows = outcome.result["states"]
    assert any(row["best"] for row in rows)
    assert all(row["best"] is None or row["width"] >= row["best"] for row in rows)


def test_no_proved_error_is_below_half_of_it() -> None:
    body = tanks() | {"observer": {"kind": "luenberger"}}
    body["parameter"] = [{"name": "leak", "range": [-0.01, 0.01], "A": [[0, 0], [0, 1]]}]
    outcome = with_typical(obsdesign.investigate(Problem.from_dict(body)))
    rows = outcome.result["states"]
    assert [row["best"] for row in rows] == pytest.approx([0.1, 0.2])
    assert all(row["error"] >= row["best"] for row in rows)


@pytest.mark.parametrize("seed", range(20))
def test_two_states_that_rest_apart_measure_the_same(seed: int) -> None:
    """Random plants: the difference that is stated solves the equations within the bounds."""
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(1, 6)), int(rng.integers(1, 3))
    A, C = rng.normal(size=(n, n)), rng.normal(size=(p, n))
    width, noise = rng.uniform(0, 1, n) * (rng.random(n) < 0.7), rng.uniform(0.1, 1, p)
    body = {
        "flow": {
            "A": A.tolist(),
            "disturbance": {"lower": (-width).tolist(), "upper": width.tolist()},
        },
        "output": {"C": C.tolist(), "noise_bound": noise.tolist()},
    }
    least = widths(body)
    V = np.linalg.inv(np.vstack([A]))  # e = -A^-1 w: every constant difference
    for i, value in enumerate(least):
        if value is None:
            continue
        e = rng.uniform(-1, 1, (2000, n)) * 2 * width @ V.T
        inside = (np.abs(e @ C.T) <= 2 * noise).all(axis=1)
        assert np.abs(e[inside, i]).max(initial=0.0) <= value * (1 + 1e-9)
