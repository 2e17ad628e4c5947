"""Gains of interval observers do not depend on the unit of time: t := tau t."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import obsdesign
from lmi.time_budget import UNLIMITED
from obsdesign.synthesis.interval.descent import OBJECTIVES, quick_gains
from obsdesign.synthesis.interval.task import Task
from obsdesign.synthesis.interval.units import balanced_units

# units in which all of a search is the same to the last bit, and units in which it is rounded
BINARY, DECIMAL = (2.0**30, 2.0**-30), (1e9, 1e-9)

# four states whose width contracts only with the right gains at flow and jumps
FOUR_STATES: dict[str, Any] = {
    "A": [[-.512, -.734, -.818, .561], [.099, -1.135, .06, -.137], [-.564, .333, -.589, -.52], [-.305, -.271, -.179, .246]],
    "b": [.17829671496026472, .1603921061060906, .0004477912644989424, .14873311724278665],
    "C": [[-1.07, .61, -.16, .23]], "v": [.05],
    "G": [[.67, -.41, .21, .43], [.08, 1.01, -.35, -.07], [-.27, .19, 1.11, -.06], [.24, -.01, .09, .76]],
    "c": [.03358656673001222, .05530414920406917, .06823893850098313, .04330584142241886],
    "dwell": [1.0, math.inf],
}  # fmt: skip
DOUBLE_INTEGRATOR: dict[str, Any] = {
    "A": [[0.0, 1.0], [0.0, 0.0]], "b": [0.0, 0.1], "C": [[1.0, 0.0]], "v": [0.05],
}  # fmt: skip
TWO_STATES: dict[str, Any] = {
    "A": [[-0.4, 1.1], [-0.3, 0.2]], "b": [0.1, 0.2], "C": [[1.0, 0.3]], "v": [0.05],
    "G": [[0.9, 0.1], [0.2, 0.8]], "c": [0.02, 0.01], "dwell": [0.3, 0.5],
}  # fmt: skip


def in_time(plant: dict[str, Any], tau: float, **observer: Any) -> obsdesign.Problem:
    """The problem of a plant in units of time tau times smaller."""
    b, output = np.array(plant["b"]) / tau, {"C": plant["C"], "noise_bound": plant["v"]}
    output |= {"measured": plant.get("measured", "continuous")}
    if "period" in plant:
        output["period"] = plant["period"] * tau
    blocks: dict[str, Any] = {}
    if "G" in plant:
        c = np.array(plant["c"])
        dwell = [time * tau for time in plant["dwell"]]
        blocks["jump"] = {"G": plant["G"], "disturbance": {"lower": -c, "upper": c}, "dwell_time": dwell}  # fmt: skip
    return obsdesign.Problem(
        flow={"A": np.array(plant["A"]) / tau, "disturbance": {"lower": -b, "upper": b}},
        output=output, observer={"kind": "interval", **observer}, **blocks,
    )  # fmt: skip


def random_plant(rng: np.random.Generator, n: int) -> dict[str, Any]:
    """A chain in one of four, jumps in two of three, and a longest dwell time in half of these."""
    p, low = int(rng.integers(1, max(2, n))), float(rng.uniform(0.3, 1.0))
    A = rng.standard_normal((n, n)) - np.eye(n) * rng.choice([0.0, 1.5])
    plant = {
        "A": np.triu(A, 1) if rng.random() < 0.25 else A, "b": 0.2 * rng.random(n),
        "C": rng.standard_normal((p, n)), "v": np.full(p, 0.05),
    }  # fmt: skip
    if rng.random() < 2 / 3:
        G, c = np.eye(n) + 0.3 * rng.standard_normal((n, n)), 0.1 * rng.random(n)
        plant |= {"G": G, "c": c, "dwell": [low, float(rng.choice([2 * low, math.inf]))]}
        plant["measured"] = str(rng.choice(["continuous", "at_jumps"]))
    return plant


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4), objective=st.sampled_from([*OBJECTIVES])
)
def test_a_search_is_the_same_to_the_last_bit_in_binary_units(
    seed: int, n: int, objective: str
) -> None:
    plant = random_plant(np.random.default_rng(seed), n)
    assume("G" in plant or objective != "shortest_dwell")
    value, gains = math.nan, list[np.ndarray]()
    for tau in (1.0, *BINARY):
        task = Task.from_problem(in_time(plant, tau, objective=objective), False, None, {})
        again, L, M = quick_gains(task, objective, UNLIMITED)
        outward = [task.gains(L, M)[0] * tau, task.gains(L, M)[1]]
        if tau == 1.0:
            value, gains = again, outward
        assert again == value
        for one, other in zip(gains, outward, strict=True):  # they have 15 digits in the file
            np.testing.assert_allclose(other, one, rtol=1e-14)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4), tau=st.floats(1e-12, 1e12))
def test_a_task_is_the_same_in_all_units(seed: int, n: int, tau: float) -> None:
    plant = random_plant(np.random.default_rng(seed), n)
    one, other = (Task.from_problem(in_time(plant, each), False, None, {}) for each in (1.0, tau))
    assert other.pace * tau == pytest.approx(one.pace, rel=1e-9)
    assert (other.low, other.high) == pytest.approx((one.low, one.high), rel=1e-9)
    for name in ("A", "f0", "V", "limit_L", "limit_M"):
        expected = getattr(one, name)
        np.testing.assert_allclose(
            getattr(other, name), expected, rtol=1e-8, atol=1e-12 * np.abs(expected).max()
        )


@pytest.mark.parametrize(
    ("plant", "tolerance"),
    [
        (FOUR_STATES, 1e-6),
        (TWO_STATES, 1e-6),
        (TWO_STATES | {"measured": "at_jumps"}, 1e-6),
        (TWO_STATES | {"measured": "periodic", "period": 0.1}, 1e-6),
        (DOUBLE_INTEGRATOR, 1e-6),
    ],
)
def test_a_design_is_the_same_in_all_units(plant: dict[str, Any], tolerance: float) -> None:
    gains: list[np.ndarray] = []
    for tau in (1.0, DECIMAL[1]):
        outcome = obsdesign.investigate(in_time(plant, tau))
        assert outcome.verdict == "proved"
        assert outcome.design is not None
        is_rate = plant.get("measured") != "periodic"
        L = np.array(outcome.design.gains["L"]) * (tau if is_rate else 1.0)
        gains.append(np.hstack([L, outcome.design.gains["M"]] if "G" in plant else [L]))
        np.testing.assert_allclose(
            gains[-1], gains[0], rtol=0, atol=tolerance * np.abs(gains[0]).max()
        )


def test_what_no_gain_can_reach_is_refuted_in_all_units() -> None:
    hidden = {"A": [[0.1, 0.0], [0.0, -1.0]], "C": [[0.0, 1.0]], "G": [[1.0, 0.0], [0.0, 0.5]]}
    for tau in (1.0, *BINARY, *DECIMAL):
        outcome = obsdesign.investigate(in_time(TWO_STATES | hidden, tau))
        assert outcome.verdict == "refuted"


@pytest.mark.parametrize("tau", [1.0, 1e9, 1e-9])
def test_constraints_are_those_of_the_units_of_the_file(tau: float) -> None:
    stated = {"gain_norm": {"L": 4.0 / tau, "M": 1.5}, "region": {"decay": 0.5 / tau}}
    outcome = obsdesign.investigate(in_time(TWO_STATES, tau, form="split", **stated))
    assert outcome.verdict == "proved"
    assert outcome.design is not None
    L, M = (np.array(outcome.design.gains[name]) for name in "LM")
    F = np.array(TWO_STATES["A"]) - tau * L @ np.array(TWO_STATES["C"])
    assert np.linalg.norm(tau * L) <= 4.0
    assert np.linalg.norm(M) <= 1.5
    assert np.linalg.eigvals(F).real.max() < -0.5


def test_only_a_flow_without_cycles_takes_its_pace_from_elsewhere() -> None:
    at_jumps = DOUBLE_INTEGRATOR | {"G": np.eye(2), "c": [0.0, 0.0]}
    slow, fast = (
        balanced_units(in_time(at_jumps | {"dwell": [1.0, longest]}, 1.0)).pace
        for longest in (10.0, 1000.0)
    )
    assert slow == pytest.approx(100 * fast)
    cyclic = TWO_STATES | {"dwell": [1.0, 10.0]}, TWO_STATES | {"dwell": [1.0, 1000.0]}
    own, same = (balanced_units(in_time(plant, 1.0)).pace for plant in cyclic)
    assert own == same
