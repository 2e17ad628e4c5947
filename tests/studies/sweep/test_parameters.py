"""Sweeps over a parameter of a problem: by its name, and over the width of its range."""

from __future__ import annotations

import numpy as np
import pytest

import obsdesign
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.studies.sweep.axes import changed, parse_axis, require_number
from obsdesign.studies.sweep.point import evaluate, plan_sweep
from tests.systems.parameters import spring


def test_widths_of_bounds_over_the_width_of_a_parameter() -> None:
    """From the certain plant on they grow; at the width of the file they are those of the file."""
    problem = Problem.from_dict(spring())
    plan = plan_sweep(problem, [parse_axis("parameter.stiffness.width=0:0.4:3")], "width", 1e-6)
    values = [evaluate(plan, k).value for k in range(3)]
    assert plan.problem(1).to_dict()["parameter"][0]["range"] == [0.9, 1.1]
    assert np.diff(values).min() > 0.3
    outcome = obsdesign.investigate(problem)
    (width,) = (claim for claim in outcome.claims if claim.id == "width")
    assert values[2] == max(width.evidence["always"])
    certain = plan_sweep(problem, [parse_axis("parameter[0].width=0:0:1")], "width", 1e-6)
    assert evaluate(certain, 0).value == values[0]


def test_entries_of_a_parameter_by_its_name() -> None:
    body = Problem.from_dict(spring()).to_dict()
    axis = parse_axis("parameter.stiffness.range[1]=1:2:2")
    require_number(body, axis)
    assert changed(body, axis.path, 2.0)["parameter"][0]["range"] == [0.8, 2.0]
    assert body["parameter"][0]["range"] == [0.8, 1.2]
    deeper = parse_axis("parameter.stiffness.A[1][0]=-1:0:2")
    assert changed(body, deeper.path, 0.5)["parameter"][0]["A"] == [[0, 0], [0.5, 0]]


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("parameter.mass.width", "parameter has no 'mass'"),
        ("parameter.stiffness.wide", "it has name, range, constant, A."),
        ("state.width", "state has no 'width'; it has lower, upper"),
        ("parameter.stiffness.range", "is a list of 2, not one number"),
    ],
)
def test_what_is_no_entry_of_a_parameter(key: str, text: str) -> None:
    with pytest.raises(InputError) as refusal:
        require_number(Problem.from_dict(spring()).to_dict(), parse_axis(f"{key}=0:1:2"))
    assert text in str(refusal.value)
