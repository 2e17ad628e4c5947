"""Default gains do not depend on the units of the file: x := D x, y := E y."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign
from obsdesign.analysis.balancing import BalancedPlant, balancing_units

SEEDS = st.integers(0, 2**32 - 1)


def random_plant(rng: np.random.Generator, n: int, p: int) -> dict[str, Any]:
    """Matrices of an observable plant with jumps, an infinite range half of the time."""
    low = float(rng.uniform(0.3, 1.0))
    return {
        "A": rng.standard_normal((n, n)) - np.eye(n) * rng.choice([0.0, 1.5]),
        "G": np.eye(n) + 0.4 * rng.standard_normal((n, n)),
        "C": rng.standard_normal((p, n)),
        "b": np.full(n, 0.1),
        "v": np.full(p, 0.05),
        "dwell": [low, rng.choice([2 * low, math.inf])],
        "weights": np.ones(n),
    }


def in_units(plant: dict[str, Any], D: np.ndarray, E: np.ndarray) -> dict[str, Any]:
    """The same plant for states D x and outputs E y."""
    A, G, C = (plant[name] for name in "AGC")
    return plant | {
        "A": A * D[:, None] / D, "G": G * D[:, None] / D, "C": C * E[:, None] / D,
        "b": plant["b"] * D, "v": plant["v"] * E, "weights": plant["weights"] / D,
    }  # fmt: skip


def random_units(rng: np.random.Generator, n: int, p: int) -> tuple[np.ndarray, np.ndarray]:
    return 10.0 ** rng.integers(-4, 5, n), 10.0 ** rng.integers(-4, 5, p)


def outcome_of(plant: dict[str, Any], kind: str, **observer: Any) -> obsdesign.Outcome:
    body = {
        "flow": {"A": plant["A"], "disturbance": {"lower": -plant["b"], "upper": plant["b"]}},
        "jump": {"G": plant["G"], "dwell_time": plant["dwell"]},
        "output": {"C": plant["C"], "noise_bound": plant["v"], **observer.pop("output", {})},
        "observer": {"kind": kind, **observer},
    }
    return obsdesign.investigate(obsdesign.Problem(**body))


def assert_same_gains(
    one: obsdesign.Outcome, other: obsdesign.Outcome, D: np.ndarray, E: np.ndarray, **rtol: float
) -> None:
    """The gains of the second outcome are those of the first one in units D and E."""
    assert one.design is not None
    assert other.design is not None
    for name, tolerance in rtol.items():
        gain, again = one.design.gains[name], other.design.gains[name] * E / D[:, None]
        np.testing.assert_allclose(again, gain, rtol=0, atol=tolerance * np.abs(gain).max())


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS, n=st.integers(2, 4))
def test_point_observers_do_not_depend_on_units(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    p = int(rng.integers(1, n))
    plant, units = random_plant(rng, n, p), random_units(rng, n, p)
    one, other = (outcome_of(each, "luenberger") for each in (plant, in_units(plant, *units)))
    assert one.verdict == other.verdict
    if one.verdict == "proved":  # M where the margin is largest, which is flat there
        assert_same_gains(one, other, *units, L=1e-4, M=0.2)


@pytest.mark.parametrize("seed", [4])
@pytest.mark.parametrize("output", [{}, {"measured": "periodic", "period": 0.1}])
def test_interval_observers_do_not_depend_on_units(seed: int, output: dict[str, Any]) -> None:
    rng = np.random.default_rng([seed, 1])
    plant, units = random_plant(rng, 2, 1), random_units(rng, 2, 1)
    other = in_units(plant, *units)
    first, second = (
        outcome_of(each, "interval", output=output, width_weights=each["weights"].tolist())
        for each in (plant, other)
    )
    assert first.verdict == second.verdict == "proved"
    assert_same_gains(first, second, *units, L=1e-6, M=1e-6)
    # of widths that are summed in the units of the file, which weigh the states
    assert outcome_of(other, "interval", output=output).verdict == "proved"


def test_a_plant_of_three_states_in_very_different_units_has_an_interval_observer() -> None:
    rng = np.random.default_rng(5)
    plant = random_plant(rng, 3, 1)
    D, E = np.array([1e-4, 1e3, 1.0]), np.array([1e4])
    for each in (plant, in_units(plant, D, E)):
        assert outcome_of(each, "interval", objective="feasible").verdict == "proved"


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, n=st.integers(1, 5))
def test_the_balanced_plant_is_the_same_in_all_units(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    p = int(rng.integers(1, n + 1))
    plant, (D, E) = random_plant(rng, n, p), random_units(rng, n, p)
    if seed % 2:  # chains, in which nothing but the units of the file sets a pace
        plant["A"] = np.triu(plant["A"], 1)
    other = in_units(plant, D, E)
    one, again = (BalancedPlant.from_matrices(each["A"], each["C"]) for each in (plant, other))
    np.testing.assert_allclose(again.A, one.A, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(again.C, one.C, rtol=1e-9, atol=1e-12)
    assert again.pace == pytest.approx(one.pace, rel=1e-9)
    L = rng.standard_normal((n, p))
    np.testing.assert_allclose(other["A"] - again.flow_gain(L) @ other["C"],
        (plant["A"] - one.flow_gain(L) @ plant["C"]) * D[:, None] / D, rtol=1e-8, atol=1e-9 * D.max() / D.min())  # fmt: skip
    sizes, _ = balancing_units(plant["A"], plant["C"], np.zeros((n, 0)))
    assert np.array_equal(sizes, np.exp2(np.round(np.log2(sizes))))


CHAIN = {"A": [[0, 1], [0, 0]], "C": [[1, 0]], "G": [[1, 0], [0.3, 0.5]]}
# flows without cycles, and as a twin one with a pace of its own
FLOWS: dict[str, dict[str, Any]] = {
    "chain": CHAIN,
    "no flow": {"A": [[0]], "C": [[1]], "G": [[1.5]]},
    "chain, constrained": CHAIN | {"structure": {"L": [[1], [1]]}, "region": {"sector": 0.6}},
    "cycles": CHAIN | {"A": [[-1, 1], [0, -2]]},
}


@pytest.mark.parametrize("name", FLOWS)
@pytest.mark.parametrize("unit", [3600.0, 2.0**-20])
def test_gains_of_a_flow_do_not_depend_on_the_unit_of_time(name: str, unit: float) -> None:
    plant = dict(FLOWS[name])
    A, C, G = (np.array(plant.pop(key), dtype=float) for key in "ACG")

    def gains(unit: float) -> tuple[np.ndarray, np.ndarray]:
        made = obsdesign.design(obsdesign.Problem(
            flow={"A": A * unit}, jump={"G": G, "dwell_time": [0.5 / unit, 2 / unit]},
            output={"C": C}, observer={"kind": "luenberger", **plant},
        ))  # fmt: skip
        return np.array(made.gains["L"]) / unit, np.array(made.gains["M"])

    for one, other in zip(gains(1.0), gains(unit), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("unit", [3600.0, 2.0**-20])
def test_gains_of_modes_do_not_depend_on_the_unit_of_time(unit: float) -> None:
    """A position and its velocity, which is lost at times: the chain keeps time by its stays."""
    gains = []
    for one in (1.0, unit):
        modes = [
            {"name": name, "A": (one * np.array(A)).tolist(), "every": [1 / one, 3 / one]}
            for name, A in (("drive", [[0, 1], [0, 0]]), ("brake", [[0, 1], [0, -1]]))
        ]
        made = obsdesign.design(obsdesign.Problem(
            flow={"A": (0.0 * np.eye(2)).tolist()}, output={"C": [[1, 0]]}, mode=modes,
            observer={"kind": "luenberger"},
        ))  # fmt: skip
        gains.append([np.array(mode["L"]) / one for mode in made.gains["modes"]])
    np.testing.assert_allclose(gains[0], gains[1], rtol=1e-9)
