"""Impulses below the floor of |R|: by all that they leave in white features."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from obsdesign.runtime import from_design
from obsdesign.runtime.impulsive_input.event import Event
from obsdesign.runtime.impulsive_input.integral.matched_filter import MatchedFilter
from obsdesign.runtime.impulsive_input.integral.search import NoisyRows, Rule, Search
from tests.systems.designs import designed
from tests.systems.impulsive_input import events_of, record, rows_from

NOISE = 0.02
# plant, and the weight of ten Cramer-Rao deviations, state and onset unknown, at 90 rows a dwell
TANKS = {"A": [[-1, 0, 0], [1, -0.7, 0], [0, 0.7, -0.5]], "C": [[0, 0, 1]], "dwell": 7.0,
         "period": 0.078, "weight": 0.0895}  # fmt: skip
ROTOR = {"A": [[-1.05, 0], [1, 0]], "C": [[0, 1]], "dwell": 3.2, "period": 0.036, "weight": 0.0591}


def events_at(
    plant: dict[str, Any], times: float, *, part: float = 0.0, seed: int = 0
) -> tuple[list[Event], list[tuple[float, float]]]:
    """(events, impulses): of that many times the weight, the plant's A off by a part."""
    A, dwell, rng = np.array(plant["A"], float), plant["dwell"], np.random.default_rng(seed)
    H = np.eye(len(A))[:, :1]
    design = designed({
        "flow": {"A": A.tolist()}, "jump": {"H": H.tolist(), "dwell_time": [dwell, "inf"]},
        "output": {"C": plant["C"], "measured": "periodic", "period": plant["period"],
                   "noise_std": [NOISE]},
        "observer": {"kind": "impulsive_input", "operator": "integral"},
    })  # fmt: skip
    assert design.gains["rule"] == "peak"
    moments = dwell * (1.3 + np.cumsum(rng.uniform(1.2, 1.7, 12)))
    train = [(float(at), times * plant["weight"] * (-1) ** k) for k, at in enumerate(moments)]
    t = plant["period"] * np.arange(int((moments[-1] + 2 * dwell) / plant["period"]))
    y = record(A * (1 + part), H, train, t, np.zeros(len(A))) @ np.transpose(plant["C"])
    y = y + NOISE * rng.standard_normal(y.shape)
    return events_of(rows_from(from_design(design), t, y)), train


@pytest.mark.parametrize("plant", [TANKS, ROTOR], ids=["tanks", "rotor"])
def test_impulses_of_ten_deviations_are_all_there(plant: dict[str, Any]) -> None:
    events, train = events_at(plant, 1.0)
    assert [event.status for event in events] == ["ok"] * len(train)
    for event, (moment, size) in zip(events, train, strict=True):
        assert abs(event.t - moment) < 4 * event.t_std
        assert abs(event.weights[0] - size) < 4 * event.weights_std[0]


@pytest.mark.parametrize("plant", [TANKS, ROTOR], ids=["tanks", "rotor"])
@pytest.mark.parametrize(("times", "part"), [(0.0, 0.0), (10.0, 0.1), (10.0, -0.1)])
def test_noise_and_leftovers_of_a_wrong_plant_are_none(
    plant: dict[str, Any], times: float, part: float
) -> None:
    """The twin: as many events as impulses, none without, whatever a plant that is off leaves."""
    events, train = events_at(plant, times, part=part)
    assert len(events) == (len(train) if times else 0)
    for event, (moment, size) in zip(events, train, strict=False):
        assert abs(event.t - moment) < 0.1 * plant["dwell"]
        assert event.status != "ok" or abs(event.weights[0] - size) < 6 * event.weights_std[0]


# three kernels, one output; impulses turn from the first direction to the second with their age
TURN = np.linspace(0.1, 1.5, 30)
SHOWN = np.stack([np.cos(TURN), np.sin(TURN), 0 * TURN], axis=1)[:, :, None]
OLD, YOUNG = 10 * SHOWN[27, :, 0], 10 * SHOWN[5, :, 0]
ALL = np.array([np.inf])


def turning(nonnegative: bool = False) -> MatchedFilter:
    return MatchedFilter.from_curve(np.eye(3), TURN, SHOWN, nonnegative)


def test_an_impulse_counts_once_it_is_old() -> None:
    assert turning().deviations(OLD[None], ALL) == pytest.approx([10.0])
    assert turning().deviations(-OLD[None], ALL) == pytest.approx([10.0])
    assert turning().deviations(YOUNG[None], ALL) == [0.0]
    # of sizes of features nothing depends: white ones count
    scaled = MatchedFilter.from_curve(
        np.diag([1.0, 1e3, 1.0]), TURN, SHOWN / [[1], [1e3], [1]], False
    )
    assert scaled.deviations(OLD[None] / [1, 1e3, 1], ALL) == pytest.approx([10.0])


def test_what_an_impulse_leaves_must_be_noise() -> None:
    for left, counts in ((3.0, True), (4.0, False)):  # chi-squared of one degree: 10.8
        R = OLD + left * np.array([0, 0, 1.0])
        assert bool(turning().deviations(R[None], ALL)[0]) == counts


def test_the_dwell_time_admits_onsets_and_signs_are_those_of_the_problem() -> None:
    assert turning().deviations(OLD[None], np.array([TURN[10]])) == [0.0]
    assert turning(nonnegative=True).deviations(OLD[None], ALL) == pytest.approx([10.0])
    assert turning(nonnegative=True).deviations(-OLD[None], ALL) == [0.0]


def advanced(matched: float, values: list[float], search: Search) -> tuple[Search, bool]:
    """The rule `peak` along rows of which the fifth shows an impulse, deviation of |R| 0.1."""
    rows = NoisyRows(np.arange(9.0), np.full(9, 0.1), matched * (np.arange(9) == 4))
    return Rule(floor=0.0, share=0.05).advance(search, values, 0, rows, 9.0)


def test_an_impulse_below_the_floor_fires_where_it_stands_out() -> None:
    low, high = [0.1] * 9, [0.1, 0.3, 0.6, 0.8, 1.0, 1.0, 1.0, 1.0, 1.0]
    search, fired = advanced(6.1, low, Search())
    assert fired
    assert (search.top, search.position, search.at_start) == (4, 5, True)
    assert not advanced(5.9, low, Search())[1]
    # above the floor a maximum is in progress, whose top counts
    assert not advanced(6.1, high, Search())[1]
    # one that was turned down is looked at once more, later
    search = search.given_up(0.1, matched_from=4.5)
    assert not advanced(6.1, low, Search(matched_from=search.matched_from))[1]
    assert advanced(6.1, low, Search(matched_from=4.0))[1]
