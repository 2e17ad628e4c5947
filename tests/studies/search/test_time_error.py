"""Search for the largest error of an event's time stamps."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.studies.search import search

TANK: dict[str, Any] = {
    "flow": {"A": [[-1.0]], "disturbance": {"lower": [-0.1], "upper": [0.1]}},
    "event": [{"name": "refill", "E": [[1]], "input_bound": [2], "every": [2, 4]}],
    "sensor": [{"name": "level", "C": [[1]], "noise_bound": 0.05, "every": [0, 3]}],
    "observer": {"kind": "interval"},
}


def tank(**changes: Any) -> Problem:
    return Problem(**{**copy.deepcopy(TANK), **changes})


def test_the_width_that_is_asked_for_is_met_and_hardly_more() -> None:
    outcome = search.search(tank(), "largest_time_error", 0.2, width=[0.8])
    proved, other = outcome.result["proved"], outcome.result["not_proved"]
    assert outcome.verdict == "proved"
    assert 1 < other / proved <= 1.21
    # a refill of 2 leaves 2 (e^d - e^-d) e^-t, and 4 d of it just behind a window
    assert 0.05 < proved < 0.2
    claim = outcome.claims[-1]
    assert claim.id == "late_width"
    assert claim.verdict == "proved"
    assert claim.evidence["always"][0] <= 0.8


def test_a_width_that_a_run_exceeds_is_refuted() -> None:
    """The twin: no error at all keeps the width of b alone below this."""
    outcome = search.search(tank(), "largest_time_error", 0.05, width=[0.1])
    assert outcome.verdict == "refuted"
    assert outcome.result["proved"] is None
    assert outcome.result["witness"]["width"][0] > 0.1


def test_half_the_shortest_time_is_the_limit() -> None:
    outcome = search.search(tank(), "largest_time_error", 0.2)
    assert 0.5 < outcome.result["proved"] < 1.0
    assert outcome.result["not_proved"] <= 1.0
    assert outcome.result["not_proved_verdict"] == "undecided"


def test_exact_events_beside_keep_above_the_window() -> None:
    """Windows of refills are shorter than the time between two top-ups, which they may hold."""
    added = {"lower": [0.0], "upper": [0.2]}
    top_up = {"name": "top_up", "every": [0.6, 4], "disturbance": added}
    beside = tank(event=[top_up, *TANK["event"]])
    outcome = search.search(beside, "largest_time_error", 0.5, of="refill")
    assert 0.1 < outcome.result["proved"] < 0.3
    assert outcome.claims[-1].id == "late_width"
    # the twin: a second event at uncertain times, of which nothing is proved
    late = tank(event=[{**top_up, "time_error": 0.1}, *TANK["event"]])
    other = search.search(late, "largest_time_error", 0.5, of="refill")
    assert other.result["proved"] is None
    assert "the plant has several (top_up, refill)" in other.result["reason"]


@pytest.mark.parametrize(
    ("changes", "arguments", "message"),
    [
        ({}, {"of": "drain"}, "--of must be an event, one of refill; got 'drain'"),
        ({}, {"width": [1.0, 2.0]}, "--width must be 1 positive numbers"),
        ({}, {"width": [0.0]}, "--width must be 1 positive numbers"),
        ({"event": None}, {}, r"\[\[event\]\] is required"),
        ({"event": [{"name": "refill"}]}, {}, r"event\.refill\.every is required"),
    ],
)
def test_what_cannot_be_searched_is_refused(
    changes: dict[str, Any], arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        search.search(tank(**changes), "largest_time_error", **arguments)
    with pytest.raises(InputError, match="--width is available for largest_time_error alone"):
        search.search(tank(), "shortest_dwell", width=[1.0])
