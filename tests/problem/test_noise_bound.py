"""A noise bound that is absent is not zero: kinds that guarantee bounds refuse, others do not."""

from __future__ import annotations

import copy
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign import Flow, Output, Problem
from obsdesign.data.simulation import simulate
from obsdesign.errors import DoesNotApply
from obsdesign.problem.plant import Plant
from obsdesign.runtime import from_design
from tests.systems.checks import check_kind
from tests.systems.command_line import command

ROOT = Path(__file__).parents[2]
LINE = (
    "output.noise_bound is required by kind 'interval', which guarantees bounds; it is missing. "
    "If y is free of noise, write noise_bound = [0.0]."
)


def body(**output: Any) -> dict[str, Any]:
    return {
        "flow": {"A": [[-1, 0], [1, -2]]},
        "jump": {"G": [[2, 1], [1, 3]], "dwell_time": [0.7, 2]},
        "output": {"C": [[0, 1]], **output},
        "observer": {"kind": "interval", "form": "split",
                     "gains": {"L": [[0], [1]], "M": [[1], [2.8]]}},
    }  # fmt: skip


@pytest.mark.parametrize(
    "output",
    [{}, {"noise_std": [0.1]}, {"noise_cv": [0.1]}, {"measured": "periodic", "period": 0.1}],
)
def test_interval_asks_for_the_bound(output: Any) -> None:
    problem = Problem.from_dict(body(**output))
    for stated in (problem, Problem.from_dict(problem.to_dict())):
        with pytest.raises(DoesNotApply) as refusal:
            obsdesign.investigate(stated)
        assert str(refusal.value) == LINE
    assert check_kind(problem, "interval").reasons == (LINE,)
    bounded = Problem.from_dict(body(noise_bound=0.03, **output))
    assert obsdesign.investigate(bounded).design is not None


def test_another_kind_in_the_file_does_not_get_past_the_refusal(tmp_path: Path) -> None:
    text = (ROOT / "examples" / "gantry_crane.toml").read_text()
    (tmp_path / "p.toml").write_text(text)
    done = command("design", "p.toml", "--kind", "interval", cwd=tmp_path)
    zeros = LINE.replace("[0.0]", "[0.0, 0.0]")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"obsdesign: p.toml: {zeros}\n"
    assert [path.name for path in tmp_path.iterdir()] == ["p.toml"]


def test_a_design_whose_bound_was_taken_away_is_not_proved() -> None:
    design = obsdesign.design(Problem.from_dict(body(noise_bound=0.0)))
    assert obsdesign.verify(design).verdict == "proved"
    problem = copy.deepcopy(dict(design.problem))
    del problem["output"]["noise_bound"]
    gains = {name: gain for name, gain in design.gains.items() if name != "noise_bound"}
    for forged in (
        dataclasses.replace(design, problem=problem),
        dataclasses.replace(design, problem=problem, gains=gains),
    ):
        assert obsdesign.verify(forged).verdict == "refuted"
        with pytest.raises(obsdesign.InputError, match="noise_bound"):
            from_design(forged)


def points(**output: Any) -> Problem:
    return Problem.from_dict({
        "flow": {"A": [[0, 1], [-1, -0.2]], "disturbance": {"lower": [0, -0.1], "upper": [0, 0.1]}},
        "output": {"C": [[1, 0]], "measured": "periodic", "period": 0.1, **output},
        "observer": {"kind": "finite_time", "window": 0.4},
    })  # fmt: skip


def test_finite_time_gives_points_and_no_radius_without_it() -> None:
    design = obsdesign.design(points(noise_std=[0.1]))
    assert "radius" not in design.gains
    assert obsdesign.verify(design).verdict == "proved"
    withheld = [g.statement for g in design.guarantees if not g.given]
    assert "Bounds of the state around the estimate: output.noise_bound is not given." in withheld
    observer: Any = from_design(design)
    assert observer.names == ("x1", "x2")
    t = np.arange(20) / 10
    batch = observer.run_batch(t, np.cos(t))
    assert batch.lower is None
    assert batch.upper is None
    # the twin: no noise is a bound, and the disturbance leaves a radius
    twin = obsdesign.design(points(noise_bound=0.0))
    assert (twin.gains["radius"] > 0).all()
    assert from_design(twin).names[2:] == ("x1_lo", "x1_hi", "x2_lo", "x2_hi")
    # the gains are the same: the bound changes what is promised
    np.testing.assert_array_equal(twin.gains["window_gain"], design.gains["window_gain"])


def test_a_radius_without_a_bound_of_the_noise_is_refuted() -> None:
    design, twin = obsdesign.design(points()), obsdesign.design(points(noise_bound=0.0))
    forged = dataclasses.replace(design, gains=dict(twin.gains))
    assert obsdesign.verify(forged).verdict == "refuted"


@pytest.mark.parametrize("kind", ["luenberger", "impulsive", "unknown_input", "impulsive_input"])
def test_kinds_that_give_points_need_none(kind: str) -> None:
    from tests.fuzz.plants import PROBLEMS

    plain = copy.deepcopy(PROBLEMS[kind])
    plain["output"].pop("noise_bound", None)
    design = obsdesign.design(Problem.from_dict(plain))
    assert "noise_bound" not in design.problem["output"]
    assert obsdesign.verify(design).verdict == "proved"
    from_design(design)


def test_simulated_noise_keeps_a_bound_of_zero_too() -> None:
    flow = Flow(np.array([[-1.0]]))
    noise: Any = {"noise_std": 0.2, "noise_cv": 0.5}
    for bound in (0.0, 0.05):
        output = Output(np.array([[1.0]]), noise_bound=bound, **noise)
        record = simulate(Plant(flow, None, output))
        assert np.abs(record.block("y") - record.block("x")).max() <= bound * (1 + 1e-12)
    record = simulate(Plant(flow, None, Output(np.array([[1.0]]), **noise)))
    assert np.abs(record.block("y") - record.block("x")).max() > 0.2
