"""Open gains are chosen for the narrowest bounds; gains that are all zero are a warning."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.analysis.interval.requirements import objective_of

TANKS: dict[str, Any] = {
    "flow": {"A": [[-0.5, 0], [0.4, -0.3]],
             "disturbance": {"lower": [0.2, -0.01], "upper": [0.3, 0.01]}},
    "jump": {"G": [[0.7, 0], [0.3, 1.0]], "dwell_time": [1, 3],
             "disturbance": {"lower": [-0.02, -0.02], "upper": [0.02, 0.02]}},
    "output": {"C": [[0, 1]], "noise_bound": [0.02]},
}  # fmt: skip
PERIODIC: dict[str, Any] = {
    "flow": {"A": [[-0.5]], "disturbance": {"lower": [-0.1], "upper": [0.1]}},
    "output": {"C": [[1]], "noise_bound": [0.02], "measured": "periodic", "period": 0.5},
}


def problem(plant: dict[str, Any], **observer: Any) -> obsdesign.Problem:
    return obsdesign.Problem.from_dict(
        copy.deepcopy(plant) | {"observer": {"kind": "interval", **observer}}
    )


@pytest.mark.parametrize("plant", [TANKS, PERIODIC], ids=["continuous", "periodic"])
def test_open_gains_use_the_sensor(plant: dict[str, Any]) -> None:
    outcome = obsdesign.investigate(problem(plant))
    assert outcome.verdict == "proved"
    assert outcome.design is not None
    assert np.any(outcome.design.gains["L"])
    assert not outcome.warnings


@pytest.mark.parametrize(
    ("observer", "words"),
    [
        ({"objective": "feasible"}, "objective 'narrowest' chooses"),
        ({"gains": {"L": [[0], [0]], "M": [[0], [0]]}}, "without gains.L and gains.M"),
    ],
)
def test_gains_that_are_zero_are_a_warning(observer: dict[str, Any], words: str) -> None:
    outcome = obsdesign.investigate(problem(TANKS, **observer))
    assert outcome.verdict == "proved"
    assert len(outcome.warnings) == 1
    assert "does not use the sensor: L = M = 0" in outcome.warnings[0]
    assert words in outcome.warnings[0]
    assert outcome.design is not None
    assert obsdesign.verify(outcome.design).verdict == "proved"


def test_given_gains_keep_the_first_form_that_is_proved() -> None:
    given = {"gains": {"L": [[0], [1]], "M": [[0], [0]]}}
    assert objective_of(problem(TANKS, **given)) == "feasible"
    assert objective_of(problem(TANKS, gains={"L": [[0], [1]]})) == "narrowest"
    assert objective_of(problem(TANKS, objective="shortest_dwell")) == "shortest_dwell"
    assert objective_of(problem(PERIODIC, gains={"L": [[0.5]]})) == "feasible"
