"""Units of several outputs do not matter to operator `integral`: R has each in a unit of its own."""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.equations.impulsive_input.output_units import output_units
from obsdesign.runtime import from_design
from tests.systems.designs import designed
from tests.systems.impulsive_input import CHAIN, events_of, record, rows_from

# two coupled oscillators, y: both positions
PAIR: dict[str, Any] = {
    "flow": {"A": [[0, 1, 0, 0], [-1, -0.2, 0.3, 0], [0, 0, 0, 1], [0.3, 0, -2, -0.3]]},
    "jump": {"H": [[0], [1], [0], [0]], "dwell_time": [12, "inf"]},
    "output": {"C": [[1, 0, 0, 0], [0, 0, 1, 0]], "measured": "periodic", "period": 0.1},
    "observer": {
        "kind": "impulsive_input", "operator": "integral", "window": 9.6, "margin": 1.2,
        "exponents": [-0.4, -0.6, -0.8, -1.0, -1.2, -1.4, -1.6, -1.8],
    },
}  # fmt: skip
TRAIN = ((15.03, 1.0), (31.47, -1.4), (46.2, 0.8))
TIMES = np.round(0.1 * np.arange(600), 10)
NOISE = 0.002
UNITS = [(2.0**-9, 8.0), (2.0**6, 2.0**-4), (0.01, 10.0)]
RULES: list[dict[str, float]] = [{}, {"threshold": 0.0}, {"smallest_weight": 0.5}]


@cache
def positions() -> np.ndarray:
    x = record(np.array(PAIR["flow"]["A"]), PAIR["jump"]["H"], TRAIN, TIMES, np.zeros(4))
    return x[:, [0, 2]]


def pair(units: tuple[float, float], noise: str, **options: Any) -> Any:
    body, scale = copy.deepcopy(PAIR), np.array(units)
    body["output"]["C"] = (scale[:, None] * np.array(body["output"]["C"])).tolist()
    if noise:
        body["output"][noise] = (NOISE * scale).tolist()
    if "threshold" in options:  # of |R| in units of noise, or of what an impulse leaves
        options["threshold"] = 150.0 if noise else 0.3
    body["observer"] |= options
    return designed(body)


def found(design: Any, units: tuple[float, float], noise: str) -> list[Any]:
    y = positions()
    if noise == "noise_std":  # the plain norm without it takes records as exact
        y = y + NOISE * np.random.default_rng(1).standard_normal(y.shape)
    return events_of(rows_from(from_design(design), TIMES, y * units, x=np.zeros(4)))


def without_units(design: Any) -> Any:
    """A design of old, which searches |R| of outputs as they are, in noise too."""
    gains = {name: value for name, value in design.gains.items() if name != "output_units"}
    return replace(design, gains=gains | {"rule": "peak"})


@pytest.mark.parametrize("rule", RULES, ids=["peak", "threshold", "smallest_weight"])
@pytest.mark.parametrize(
    ("weighting", "noise"),
    [("gls", "noise_std"), ("plain", "noise_std"), ("plain", "noise_bound"), ("plain", "")],
)
def test_outputs_in_other_units_give_the_same_impulses(
    weighting: str, noise: str, rule: dict[str, float]
) -> None:
    options = {"weighting": weighting, **rule}
    design = pair((1.0, 1.0), noise, **options)
    alone = "position" if noise == "noise_std" else "peak"
    assert design.gains["rule"] == ("threshold" if rule else alone)
    first = found(design, (1.0, 1.0), noise)
    assert len(first) >= 2  # the third is below the given threshold
    if noise != "noise_std" and "threshold" not in rule:
        for event, (moment, weight) in zip(first, TRAIN, strict=True):
            assert event.t == pytest.approx(moment, abs=1e-6)
            assert event.weights[0] == pytest.approx(weight, abs=1e-6)
    for units in UNITS:
        other = found(pair(units, noise, **options), units, noise)
        for event, same in zip(first, other, strict=True):
            assert same.t == pytest.approx(event.t, abs=1e-6)
            np.testing.assert_allclose(same.weights, event.weights, rtol=1e-6)
            assert (same.t_std is None) == (event.t_std is None)
            if event.t_std is not None:
                assert same.t_std == pytest.approx(event.t_std, rel=1e-4)


def test_outputs_as_they_are_hide_impulses() -> None:
    """The twin: what designs without units do, one output drowning the other."""
    units = UNITS[0]
    design = pair(units, "noise_std", weighting="gls")
    assert len(found(design, units, "noise_std")) == 3
    assert len(found(without_units(design), units, "noise_std")) < 2


@pytest.mark.parametrize("noise", ["noise_std", "noise_bound", ""])
def test_units_are_stored_and_verified(noise: str) -> None:
    units = UNITS[0]
    design = pair(units, noise, weighting="plain", smallest_weight=0.5)
    stored = np.array(design.gains["output_units"])
    if noise:
        np.testing.assert_array_equal(stored, NOISE * np.array(units))
    claims = {claim.id: claim.verdict for claim in obsdesign.verify(design).claims}
    assert set(claims.values()) == {"proved"}
    assert "smallest_weight" in claims
    for wrong in (2 * stored, 0 * stored, stored[:1], stored[::-1]):
        forged = replace(design, gains={**design.gains, "output_units": wrong})
        verdicts = {claim.id: claim.verdict for claim in obsdesign.verify(forged).claims}
        assert verdicts["consistent"] == "refuted"


def test_designs_without_units_still_verify() -> None:
    old = without_units(pair((1.0, 1.0), "noise_std", weighting="gls"))
    verdicts = {claim.id: claim.verdict for claim in obsdesign.verify(old).claims}
    verdicts.pop("document")  # the evidence of a file that has one entry more
    assert set(verdicts.values()) == {"proved"}
    assert len(found(old, (1.0, 1.0), "noise_std")) == 3


def test_one_output_has_no_units() -> None:
    design = designed(CHAIN)
    assert "output_units" not in design.gains
    forged = replace(design, gains={**design.gains, "output_units": np.ones(1)})
    claims = {claim.id: claim.verdict for claim in obsdesign.verify(forged).claims}
    assert claims["consistent"] == "refuted"


TANKS = np.array([[-0.58, 0, 0], [0.58, -0.57, 0], [0, 0.57, -0.6]])
LEVELS = ((7.02, 1.0), (14.51, 0.01), (22.33, 1.0), (30.01, 0.5), (38.99, 2.0), (47.123, 0.1))


@pytest.mark.parametrize("second", [0, 1])
def test_an_output_that_the_chosen_gain_hides_brings_no_error_of_sampling(second: int) -> None:
    """K leaves 1e-4 and 2e-5 of an impulse in y1, as much as lines between samples do."""
    C = np.eye(3)[[2, second]]
    design = designed({
        "flow": {"A": TANKS.tolist()},
        "jump": {"H": [[1], [0], [0]], "dwell_time": [6, "inf"]},
        "output": {"C": C.tolist(), "measured": "periodic", "period": 0.05},
        "observer": {"kind": "impulsive_input", "operator": "integral"},
    })  # fmt: skip
    t = np.round(0.05 * np.arange(1200), 2)
    y = record(TANKS, [[1.0], [0], [0]], LEVELS, t, np.zeros(3)) @ C.T
    events = events_of(rows_from(from_design(design), t, y))
    assert [event.status for event in events] == ["ok"] * len(LEVELS)
    for event, (moment, weight) in zip(events, LEVELS, strict=True):
        assert event.t == pytest.approx(moment, abs=1e-6)
        assert event.weights[0] == pytest.approx(weight, rel=1e-6)


def test_an_output_that_the_gain_leaves_is_taken_by_what_it_leaves() -> None:
    """K leaves a tenth of an impulse in y1, or 1e-4; a tenth is clear of sampling at 0.005."""
    C, H = np.eye(3)[[2, 0]], np.eye(3)[:, :1]
    for speed, period, is_clear in ((6.0, 0.005, True), (6.0, 0.05, False), (6e3, 0.005, False)):
        plant = obsdesign.Problem.from_dict({
            "flow": {"A": TANKS.tolist()}, "jump": {"H": H.tolist(), "dwell_time": [6, "inf"]},
            "output": {"C": C.tolist(), "measured": "periodic", "period": period},
            "observer": {"kind": "impulsive_input"},
        }).plant  # fmt: skip
        K = np.array([[0.0, 0.0], [0.0, 0.0], [speed, 0.0]])
        units, free = (output_units(plant, gain, H, 4.8) for gain in (K, 0 * K))
        assert units is not None
        assert free is not None
        assert (units[0] < 0.2 * free[0]) == is_clear
        assert units[1] == pytest.approx(free[1])
