"""Open gains are chosen for the narrowest bounds; gains that are all zero are a warning."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.time_budget import UNLIMITED
from obsdesign.analysis.interval.requirements import objective_of
from obsdesign.synthesis.kind import candidates_of

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


# states whose best coordinates are those of the file, and others
OWN_BEST: dict[str, Any] = {
    "flow": {"A": [[-1.12, -0.62, -0.64], [-0.3, -2.55, 0.34], [-0.77, 0.79, -1.29]],
             "disturbance": {"lower": [-0.1] * 3, "upper": [0.1] * 3}},
    "output": {"C": [[0.1, -0.8, -0.5]], "noise_bound": [0.02]},
}  # fmt: skip
OTHERS_BEST: dict[str, Any] = {
    "flow": {"A": [[-0.83, 0.6, 0.16], [-0.81, -0.43, -0.04], [-0.68, 0.47, -1.07]],
             "disturbance": {"lower": [-0.1] * 3, "upper": [0.1] * 3}},
    "output": {"C": [[1, 0, 0]], "noise_bound": [0.02]},
}  # fmt: skip


def proved_width(plant: dict[str, Any], form: str) -> float:
    """Sum of the proved widths of all states."""
    design = obsdesign.design(problem(plant, form=form))
    (claim,) = (claim for claim in design.claims if claim.id == "width")
    return float(sum(claim.evidence["always"]))


def test_stated_coordinates_are_never_wider_than_those_of_the_file() -> None:
    assert proved_width(OWN_BEST, "coordinates") <= proved_width(OWN_BEST, "split") * (1 + 1e-5)
    # the twin: other coordinates that are better are still chosen
    assert proved_width(OTHERS_BEST, "coordinates") < 0.96 * proved_width(OTHERS_BEST, "split")


def test_stated_coordinates_of_samples_try_those_of_the_file() -> None:
    outcomes = {}
    for form in ("split", "coordinates"):
        plant = copy.deepcopy(OWN_BEST)
        plant["output"] |= {"measured": "periodic", "period": 0.5}
        (first, *others) = candidates_of(problem(plant, form=form), UNLIMITED)
        outcomes[form] = min(x.cost or math.inf for x in (first, *others))
    assert outcomes["coordinates"] <= outcomes["split"] * (1 + 1e-5)
