"""Widths that are proved without one of the sensors: a further sample never widens."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign import workflow
from obsdesign.data.simulation import simulate
from obsdesign.document import Design
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import rows_of
from obsdesign.synthesis.interval import event_tubes

SHAFT: dict[str, Any] = {
    "flow": {"A": [[-1, 1], [-0.5, -4]], "disturbance": {"lower": [0, -0.3], "upper": [0, 0.3]}},
    "event": [{"name": "tick", "every": [5, 30]}],
    "sensor": [
        {"name": "angle", "C": [[1, 0]], "noise_bound": 0.05, "every": [0, 0.2]},
        {"name": "gyro", "C": [[0, 1]], "noise_bound": 0.2, "every": [0, 1]},
    ],
    "observer": {"kind": "interval"},
}


def width_of(design: Design) -> dict[str, Any]:
    claim = next(claim for claim in design.claims if claim.id == "event_width")
    assert claim.verdict == "proved"
    return dict(claim.evidence)


def test_the_width_is_that_of_the_sensor_that_is_read_often(shaft: Design) -> None:
    body = copy.deepcopy(SHAFT)
    body["sensor"].pop()
    alone = width_of(obsdesign.design(Problem.from_dict(body)))
    assert width_of(shaft)["without"] == ["gyro"]
    assert width_of(shaft)["always"] == alone["always"]


def only_subsets(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search with all sensors, which takes long, is in vain."""
    search = event_tubes._width_certificate
    monkeypatch.setattr(
        event_tubes, "_width_certificate",
        lambda system, budget: search(system, budget) if system.left_out else {},
    )  # fmt: skip


@pytest.fixture(scope="module")
def shaft() -> Design:
    with pytest.MonkeyPatch.context() as patch:
        only_subsets(patch)
        return obsdesign.design(Problem.from_dict(SHAFT))


def test_the_width_is_the_narrowest_of_fewer_sensors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the sensor that is read most rarely it is 7 times as wide."""
    body = copy.deepcopy(SHAFT)
    body["flow"] = {
        "A": [[-0.235, 0.804], [0.793, -3.992]],
        "disturbance": {"lower": [0, -0.081], "upper": [0.0794, 0.00434]},
    }
    box = {"lower": [0, -0.296], "upper": [0.0762, 0.2046]}
    body["event"] = [{"name": "tick", "every": [5, 6], "disturbance": box}]
    body["sensor"][0] |= {"noise_bound": 0.029, "every": [0, 0.5]}
    body["sensor"][1] |= {"noise_bound": 0.225, "every": [0, 0.2]}
    only_subsets(monkeypatch)
    both = width_of(obsdesign.design(Problem.from_dict(body)))
    monkeypatch.undo()
    widths = []
    for sensor in body["sensor"]:
        alone = Problem.from_dict(body | {"sensor": [sensor]})
        widths.append(width_of(obsdesign.design(alone))["always"])
    assert both["without"] == ["gyro"]
    assert both["always"] == widths[0]
    assert widths[1][0] > 6 * widths[0][0]


def test_bounds_that_run_are_within_it(shaft: Design) -> None:
    run = simulate(
        Problem.from_dict(SHAFT).plant, until=60, initial=np.zeros(2), disturbance="extreme",
        rng=np.random.default_rng(1),
    )  # fmt: skip
    assert run.happened is not None
    observer: Any = from_design(shaft)
    rows = list(rows_of(run.t, run.block("y"), jump=run.happened[:, 0]))
    state = observer.init(run.t[0], lower=[0.0, 0.0], upper=[0.0, 0.0])
    widest = np.zeros(2)
    for row, x in zip(observer.run(state, rows), run.block("x"), strict=True):
        assert (row.lower <= x + 1e-9).all()
        assert (x - 1e-9 <= row.upper).all()
        widest = np.maximum(widest, row.upper - row.lower)
    always = np.array(width_of(shaft)["always"])
    assert (widest <= always * (1 + 1e-9)).all()
    assert (widest > 0.4 * always).any()


def with_names(design: Design, without: Any) -> Design:
    """The design with other names in the evidence of its width, and nothing else changed."""
    claims = tuple(
        replace(claim, evidence={**claim.evidence, "without": without})
        if claim.id == "event_width"
        else claim
        for claim in design.claims
    )
    return replace(design, claims=claims)


def verdict_on_width(design: Design) -> str:
    claims = obsdesign.verify(design).claims
    return next(claim.verdict for claim in claims if claim.id == "event_width")


@pytest.mark.parametrize(
    "without",
    [["angle"], ["angle", "gyro"], [], ["dial"], "gyro", [3], 7, ["gyro", "gyro"],
     ["gyro", "tick"], ["gyro", "dial"], ["gyro", 3]],
)  # fmt: skip
def test_a_certificate_that_leaves_out_others_is_not_believed(shaft: Design, without: Any) -> None:
    assert verdict_on_width(with_names(shaft, without)) != "proved"


def test_a_sensor_that_is_read_at_events_is_not_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """The proof counts on it; the twin leaves out what it may."""
    body = copy.deepcopy(SHAFT)
    body["flow"] = {
        "A": [[-1, 1, 0], [-0.5, -4, 0], [0, 0, 0]],
        "disturbance": {"lower": [0, -0.3, -0.05], "upper": [0, 0.3, 0.05]},
    }
    for sensor in body["sensor"]:
        sensor["C"] = [[*sensor["C"][0], 0]]
    body["sensor"].append({"name": "probe", "C": [[0, 0, 1]], "noise_bound": 0.01, "at": "tick"})
    only_subsets(monkeypatch)
    design = obsdesign.design(Problem.from_dict(body))
    names = width_of(design)["without"]
    assert verdict_on_width(with_names(design, names)) == "proved"
    assert verdict_on_width(with_names(design, [*names, "probe"])) != "proved"


def test_a_sensor_that_sends_on_change_is_never_left_out() -> None:
    """A sample of it ends what its silence says."""
    body = copy.deepcopy(SHAFT)
    body["sensor"][1]["sends_on_change"] = [0.5]
    outcome = workflow.investigate(Problem.from_dict(body))
    claim = next(claim for claim in outcome.claims if claim.id == "event_width")
    assert "without" not in claim.evidence
