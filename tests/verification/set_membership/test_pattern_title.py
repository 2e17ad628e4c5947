"""Widths that are guaranteed for one pattern alone are titled with it, in the unit of time."""

from __future__ import annotations

from typing import Any

import pytest

import obsdesign
from obsdesign.pages.key_numbers import state_table
from obsdesign.problem.problem import Problem

SAMPLED: dict[str, Any] = {
    "flow": {"A": [[-0.5]], "disturbance": {"lower": [-0.1], "upper": [0.1]}},
    "output": {"C": [[1]], "noise_bound": 0.1, "measured": "periodic", "period": 0.5},
    "names": {"time_unit": "h"},
    "observer": {"kind": "set_membership", "window": 3},
}
AT_JUMPS = SAMPLED | {
    "jump": {"dwell_time": [0.2, 1.0]},
    "output": {"C": [[1]], "noise_bound": 0.1, "measured": "at_jumps"},
}
BOTH = SAMPLED | {"jump": {"G": [[0.5]], "dwell_time": [1.0, 2.0]}}


@pytest.mark.parametrize(
    ("body", "words"),
    [(SAMPLED, "a sample every 0.5 h"), (AT_JUMPS, "a jump every 0.2 h"),
     (BOTH, "a sample every 0.5 h and a jump every 1 h")],
)  # fmt: skip
def test_a_width_of_one_pattern_is_titled_with_it(body: dict[str, Any], words: str) -> None:
    outcome = obsdesign.investigate(Problem.from_dict(body))
    titles, *_ = state_table(outcome.result["states"])
    assert f"guaranteed with {words}" in [" ".join(title.split()) for title in titles]
    assert f"widths with {words}" in outcome.headline
    # the twin: kind interval guarantees them for all times that the plant allows
    problem = Problem.from_dict(body).for_kind("interval")[0]
    titles, *_ = state_table(obsdesign.investigate(problem).result["states"])
    assert "guaranteed" in titles
