"""Courses of parameters in a simulation, against an integrator and against bounds."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.data.simulation import simulate
from obsdesign.data.simulation.parameter_courses import COURSES, certain_plant
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from tests.systems.designs import designed
from tests.systems.parameters import Body, compartments, degue, rooms, spring


def _simulated(body: Body, seed: int = 0, **options: Any) -> Any:
    rng = np.random.default_rng(seed)
    return simulate(Problem.from_dict(body).plant, rng=rng, **options)


@pytest.mark.parametrize("course", COURSES)
@pytest.mark.parametrize("body", [spring(), rooms(), compartments()])
def test_rows_follow_the_parameters_of_the_record(body: Body, course: str) -> None:
    """From row to row x moves by the plant with the parameters that the columns say."""
    problem = Problem.from_dict(body)
    run = _simulated(body, parameters=course, disturbance="zero", step=0.05, until=12.0)
    names = [parameter.name for parameter in problem.plant.parameters]
    values = np.column_stack([run.columns[name] for name in names])
    x = run.block("x")
    for k in range(1, len(x)):
        plant = certain_plant(problem.plant, values[k])
        b, h = (plant.flow.lower + plant.flow.upper) / 2, run.t[k] - run.t[k - 1]
        Z = np.block([[plant.flow.A, b[:, None]], [np.zeros((1, len(b) + 1))]])
        expected = expm(Z * h)[:-1] @ np.append(x[k - 1], 1.0)
        if run.columns["jump"][k]:
            assert plant.jump is not None
            expected = plant.jump.G @ expected + (plant.jump.lower + plant.jump.upper) / 2
        np.testing.assert_allclose(x[k], expected, rtol=1e-11, atol=1e-11)
        if not run.columns["jump"][k]:  # else it was measured before the jump
            np.testing.assert_allclose(run.block("y")[k], plant.output.C @ x[k], rtol=1e-12)


def test_courses_stay_inside_their_ranges() -> None:
    body = spring()
    body["parameter"].append(
        {"name": "drag", "range": [-0.1, 0.1], "constant": True, "A": [[0, 0], [0, 1]]}
    )
    courses = {word: _simulated(body, 3, parameters=word).columns for word in COURSES}
    for columns in courses.values():
        assert ((columns["stiffness"] >= 0.8) & (columns["stiffness"] <= 1.2)).all()
        assert len(set(columns["drag"])) == 1
    assert set(courses["nominal"]["stiffness"]) == {1.0}
    assert set(courses["bang-bang"]["stiffness"]) == {0.8, 1.2}
    assert set(courses["extreme"]["stiffness"]) < {0.8, 1.2}
    assert len(set(courses["random"]["stiffness"])) > 100
    fixed = _simulated(body, parameters={"stiffness": 0.9}).columns
    assert set(fixed["stiffness"]) == {0.9}
    assert set(fixed["drag"]) == {0.0}


def test_disturbances_do_not_depend_on_parameters() -> None:
    """The same seed draws the same signals, whatever the course, and without parameters at all."""
    plain = spring()
    del plain["parameter"], plain["state"]
    plain["flow"]["A"] = [[0, 1], [-1, -0.4]]
    stiff = spring(state=None)
    del stiff["state"]
    runs = [
        _simulated(body, parameters="nominal", initial=[1, 1]).columns for body in (plain, stiff)
    ]
    for name, values in runs[0].items():
        assert np.array_equal(values, runs[1][name], equal_nan=True), name


def test_the_state_starts_inside_the_box() -> None:
    assert _simulated(rooms(), disturbance="zero").block("x")[0] == pytest.approx([21, 21])
    assert _simulated(degue(0.05), disturbance="zero").block("x")[0] == pytest.approx([0, 0])


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ("adversarial", "parameters must be one of nominal, random, extreme, bang-bang"),
        ({"mass": 1.0}, "parameters: 'mass' is no parameter of the plant; it has stiffness"),
        ({"stiffness": 1.3}, "parameters: stiffness must be from 0.8 to 1.2; got 1.3"),
    ],
)
def test_other_courses_are_refused(parameters: Any, text: str) -> None:
    with pytest.raises(InputError) as refusal:
        _simulated(spring(), parameters=parameters)
    assert text in str(refusal.value)


def _beyond(design: obsdesign.Design, body: Body, course: str, seed: int) -> float:
    """By how much the state of a simulated plant leaves the bounds of a design, from inside."""
    n = len(body["flow"]["A"])
    size = np.array([0.1, 0.1]) if "state" not in body else np.array(body["state"]["upper"]) / 9
    middle = size * 0 if n != 2 or "state" not in body else np.mean(list(body["state"].values()), 0)
    run = _simulated(
        body, seed, parameters=course, disturbance="extreme" if seed % 2 else "random",
        initial=middle, step=0.05, until=12.0,
    )  # fmt: skip
    observer = from_design(design)
    batch = observer.run_batch(
        run.t, run.block("y"), jump=run.columns["jump"].astype(bool),
        lower=middle - size, upper=middle + size,
    )  # fmt: skip
    truth = run.block("x")
    gaps: NDArray[np.float64] = np.maximum(batch.lower - truth, truth - batch.upper)
    return float(gaps.max())


@pytest.mark.parametrize("body", [degue(0.05), rooms(), compartments()])
def test_bounds_contain_the_state(body: Body) -> None:
    """Whatever the course; a plant of wider ranges leaves the same bounds."""
    design = designed(body)
    margins = [_beyond(design, body, course, seed) for seed, course in enumerate(COURSES)]
    assert max(margins) <= 1e-9
    wide = copy.deepcopy(body)
    for parameter in wide.get("parameter", ()):
        low, high = parameter["range"]
        parameter["range"] = [low - 5 * (high - low), high + 5 * (high - low)]
    for block, key in (("flow", "A_radius"), ("jump", "G_radius")):
        if key in wide[block]:
            wide[block][key] = (20 * np.array(wide[block][key])).tolist()
    assert max(_beyond(design, wide, "bang-bang", seed) for seed in range(2)) > 0
