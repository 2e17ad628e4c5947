"""[[parameter]], [state] and the radii: their normal form, and what is refused in one line."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import pytest

from lmi.arithmetic.balls import exact
from obsdesign.equations.parameters import NormalForm
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.kinds import KINDS, TAKING_PARAMETERS
from obsdesign.problem.problem import Problem
from obsdesign.workflow import investigate
from tests.systems.parameters import degue, rooms, spring

Change = Callable[[dict[str, Any]], object]


@pytest.mark.parametrize("body", [spring(), degue(0.05), rooms()])
def test_the_normal_form_comes_back(body: dict[str, Any]) -> None:
    problem = Problem.from_dict(body)
    assert Problem.from_dict(problem.to_dict()) == problem
    assert problem.to_dict().get("parameter") == Problem.from_dict(body).to_dict().get("parameter")
    other = Problem.from_dict({**body, "state": {"lower": [-9, -9], "upper": [9, 9]}})
    assert other != problem


def test_nominal_matrices_and_effects_are_exact() -> None:
    form = NormalForm.from_plant(Problem.from_dict(rooms()).plant)
    door = (Fraction(0.1) + Fraction(0.3)) / 2  # not 0.2, and no binary64 number
    assert form.G is not None
    assert form.G[0].tolist() == [1 - door, door]
    assert form.A[0].tolist() == [Fraction(-0.1) - 1, 1]
    exchange, door_effect = form.effects
    assert exchange.A is not None
    assert exchange.A.tolist() == [[Fraction(-1, 2), Fraction(1, 2)], [Fraction(1, 2), -0.5]]
    assert exchange.G is None
    assert form.on("A") == (exchange.A,)
    assert form.on("G") == (door_effect.G,)
    balls = NormalForm.from_plant(Problem.from_dict(rooms()).plant, exact)
    assert balls.G is not None
    assert [int(balls.G[0, 1].p), int(balls.G[0, 1].q)] == list(door.as_integer_ratio())


def test_a_radius_is_one_parameter_for_each_entry() -> None:
    sugar = degue(0.05)
    radii = [("A", sugar["flow"].pop("A_radius")), ("G", sugar["jump"].pop("G_radius"))]
    listed = [
        {"name": f"p{key.lower()}{i}{j}", "range": [-half, half], key: _unit(i, j)}
        for key, radius in radii
        for i, row in enumerate(radius)
        for j, half in enumerate(row)
        if half
    ]
    spelt = NormalForm.from_plant(Problem.from_dict({**sugar, "parameter": listed}).plant)
    short = NormalForm.from_plant(Problem.from_dict(degue(0.05)).plant)
    assert len(short.effects) == 7
    assert (spelt.A == short.A).all()
    for key in ("A", "G", "C"):
        pairs = zip(spelt.on(key), short.on(key), strict=True)
        assert all((a == b).all() for a, b in pairs)


def _unit(i: int, j: int) -> list[list[int]]:
    return [[int((i, j) == (k, m)) for m in range(2)] for k in range(2)]


def test_a_sensor_may_be_uncertain_too() -> None:
    body = spring()
    body["output"] |= {"C_radius": [[0.05, 0]]}
    parameters = Problem.from_dict(body).plant.parameters
    assert [parameter.name for parameter in parameters] == ["stiffness", "c_radius_1_1"]
    assert parameters[1].range == (-0.05, 0.05)


@pytest.mark.parametrize("name", ["k1", "m2", "p12_lo", "x", "time"])
def test_letters_of_no_signal_may_be_numbered(name: str) -> None:
    body = spring()
    body["parameter"][0]["name"] = name
    assert Problem.from_dict(body).plant.parameters[0].name == name


def _first(**entries: object) -> Change:
    return lambda body: body["parameter"][0].update(entries)


def _without(*keys: str) -> Change:
    return lambda body: [body["parameter"][0].pop(key) for key in keys]


_TABLES = {
    "event": [{"name": "kick", "every": [2, 6]}],
    "sensor": [{"name": "encoder", "C": [[1, 0]], "noise_bound": 0.01, "every": "continuous"}],
}
_MODES = {
    "mode": [{"name": name, "A": [[-1, 0], [0, -1]], "every": 1} for name in ("open", "closed")]
}


def _tables(body: dict[str, Any]) -> None:
    del body["jump"], body["output"]
    body |= _TABLES


def _modes(body: dict[str, Any]) -> None:
    del body["jump"]
    body |= _MODES


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (_first(range=[1.2, 0.8]), "parameter.stiffness.range must be [lowest, highest]; got"),
        (_first(range=[0, math.inf]), "parameter.stiffness.range must be finite; got [0.0, inf]"),
        (_first(range=[0, math.nan]), "parameter.stiffness.range must be finite"),
        (_first(range=[0]), "parameter.stiffness.range must be a pair [lowest, highest]; got [0]"),
        (_first(range=1), "parameter.stiffness.range must be a pair [lowest, highest]; got 1"),
        (_without("range"), "parameter.stiffness.range is required"),
        (_first(A=[[0, 0], [0, 0]]), "must have an entry other than 0 in A, B, G, E, C; got zeros"),
        (_without("A"), "must have an entry other than 0 in A, B, G, E, C; got none of them"),
        (_first(A=[[1]]), "parameter.stiffness.A must have 2 rows, as flow.A; got 1x1"),
        (_first(C=[[1], [0]]), "parameter.stiffness.C must have 1 row, as output.C; got 2x1"),
        (_first(B=[[1], [0]]), "parameter.stiffness.B requires flow.B; it is missing"),
        (_first(E=[[1], [0]]), "parameter.stiffness.E requires jump.E; it is missing"),
        (lambda b: (b.pop("jump"), _first(G=[[1, 0], [0, 1]])(b)), "requires jump.G"),
        (_first(constant=1), "parameter.stiffness.constant must be true or false; got 1"),
        (_first(name="Stiffness"), "parameter.name must be a small letter"),
        (_first(name="c2_lo"), "parameter.name: 'c2_lo' is kept for other columns of data files"),
        (_first(name="u1"), "parameter.name: 'u1' is kept for other columns of data files"),
        (_first(value=1), "unknown key 'value' in [parameter.stiffness]: did you mean 'range'?"),
        (_first(nominal=1), "unknown key 'nominal' in [parameter.stiffness]"),
        (lambda b: b["parameter"].append(b["parameter"][0]), "got 'stiffness' twice"),
        (lambda b: b["flow"].update(A_radius=[[1]]), "flow.A_radius must have 2 rows, as flow.A"),
        (
            lambda b: b["jump"].update(G_radius=[[0, -1], [0, 0]]),
            "jump.G_radius must hold numbers >= 0",
        ),
        (lambda b: b["output"].update(C_radius=[[1], [0]]), "output.C_radius must have 1 row"),
        (lambda b: b["state"].update(lower=[2, 0]), "state: lower must not exceed upper"),
        (lambda b: b["state"].update(lower=[0]), "state.lower must have 2 entries"),
        (lambda b: b["state"].pop("upper"), "state.upper is required"),
        (_tables, "parameters are not available with [[event]] and [[sensor]]"),
        (_modes, "parameters are not available with [[mode]]"),
        (lambda b: b["flow"].update(dt=1), "parameters are not available with flow.dt"),
    ],
)
def test_refusals_name_the_entry(change: Change, text: str) -> None:
    body = spring()
    change(body)
    with pytest.raises(InputError) as refusal:
        Problem.from_dict(body)
    assert text in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("table", ["event", "sensor"])
def test_named_clocks_have_no_radius(table: str) -> None:
    body = spring()
    del body["parameter"]
    _tables(body)
    body[table][0]["G_radius" if table == "event" else "C_radius"] = [[1, 0]]
    with pytest.raises(InputError, match="unknown key"):
        Problem.from_dict(body)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in TAKING_PARAMETERS])
def test_other_kinds_need_the_plant_exactly(kind: str) -> None:
    body = spring(observer={"kind": kind})
    with pytest.raises(DoesNotApply, match=r"parameter\.stiffness is uncertain: kind"):
        investigate(Problem.from_dict(body))
    del body["parameter"]
    body["flow"]["A_radius"] = [[0, 0], [0, 0.1]]
    with pytest.raises(DoesNotApply, match=r"parameter\.a_radius_2_2 is uncertain: kind"):
        investigate(Problem.from_dict(body))
