"""Laws of plants with parameters: how a parameter is written changes no verdict, what it is does."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.problem.problem import Problem
from tests.systems.parameters import Body, compartments, rooms, spring

_KEYS = ("A", "B", "G", "E", "C")


def _plain(body: Body) -> Body:
    return {key: own for key, own in body.items() if key != "state"}


def _two() -> Body:
    """A spring of uncertain stiffness and damping, its state without known bounds."""
    body = _plain(spring())
    damping = {"name": "damping", "range": [-0.125, 0.125], "A": [[0, 0], [0, 1]]}
    body["parameter"].append(damping)
    return body


def _hot() -> Body:
    body = _plain(rooms())
    body["observer"]["form"] = "split"
    body["observer"]["gains"] = {"L": [[1], [0]], "M": [[0.5], [0]]}
    return body


def _ring(kind: str, half: float, **observer: Any) -> Body:
    """An oscillator that jumps to .8 of its speed, alone."""
    body = _plain(spring())
    body["flow"]["A"], body["parameter"][0]["range"] = [[0, 1], [0, -0.1]], [1 - half, 1 + half]
    body["jump"] = {"G": [[1, 0], [0, 0.8]], "dwell_time": [1, 3]}
    body["observer"] = {"kind": kind, **observer}
    return body


_UNSTABLE = "luenberger, not stable"
_CASES: dict[str, Callable[[], Body]] = {
    "stated box": spring,
    "proved box": lambda: _plain(compartments()),
    "no box": _two,
    "no box, two matrices": lambda: _plain(rooms()),
    "not proved": _hot,
    "set membership": lambda: spring(observer={"kind": "set_membership", "window": 4}),
    "luenberger, proved": lambda: _ring("luenberger", 0.125),
    _UNSTABLE: lambda: _ring("luenberger", 0.5),
}


def _permuted(body: Body) -> None:
    body["parameter"].reverse()


def _mirrored(body: Body) -> None:
    for own in body["parameter"]:
        own["range"] = [-own["range"][1], -own["range"][0]]
        own |= {key: (-np.array(own[key])).tolist() for key in _KEYS if key in own}


def _split(body: Body) -> None:
    """Each as two parameters of half the range, the second one about 0."""
    for own in list(body["parameter"]):
        low, high = own["range"]
        quarter, middle = (high - low) / 4, (high + low) / 2
        own["range"] = [middle - quarter, middle + quarter]
        more = copy.deepcopy(own) | {"name": f"{own['name']}_more", "range": [-quarter, quarter]}
        body["parameter"].append(more)


@cache
def _outcome(case: str, change: Callable[[Body], None] | None = None) -> obsdesign.Outcome:
    body = _CASES[case]()
    if change is not None:
        change(body)
    return obsdesign.investigate(Problem.from_dict(body))


def _numbers(outcome: obsdesign.Outcome) -> dict[str, Any]:
    """Claimed bounds and widths."""
    names = ("always", "after_jump", "before_jump")
    listed: dict[str, Any] = {}
    for claim in outcome.claims:
        parts = {"": claim.evidence} if claim.id != "source_width" else claim.evidence
        for part, own in parts.items():
            listed |= {f"{claim.id} {part} {name}": own[name] for name in names if name in own}
    return listed


@pytest.mark.parametrize("change", [_permuted, _mirrored, _split])
@pytest.mark.parametrize("case", [case for case in _CASES if case != "no box, two matrices"])
def test_another_way_to_write_parameters_changes_no_verdict(
    case: str, change: Callable[[Body], None]
) -> None:
    first, other = _outcome(case), _outcome(case, change)
    assert [(each.id, each.verdict) for each in first.claims] == [
        (each.id, each.verdict) for each in other.claims
    ]
    numbers, others = _numbers(first), _numbers(other)
    assert numbers.keys() == others.keys()
    for name, values in numbers.items():
        np.testing.assert_allclose(others[name], values, rtol=1e-5, atol=1e-4, err_msg=name)


def test_the_cases_are_of_every_kind_of_verdict() -> None:
    verdicts = {case: _outcome(case).verdict for case in _CASES}
    assert verdicts.pop("not proved") != "proved"
    assert set(verdicts.values()) == {"proved"}
    last = {case: _outcome(case).claims[-1].id for case in ("luenberger, proved", _UNSTABLE)}
    assert list(last.values()) == ["robust_stability", "robust_instability"]


@pytest.mark.parametrize("case", ["stated box", "proved box", "no box"])
def test_a_radius_is_the_parameters_of_its_entries(case: str) -> None:
    """The same design, but for the names."""
    sugar = _CASES[case]()
    del sugar["parameter"]
    sugar["flow"]["A"] = [[-1.0, 0.25], [0.5, -0.5]]
    radius = [[0.125, 0.0], [0.25, 0.0625]]
    spelt = copy.deepcopy(sugar)
    sugar["flow"]["A_radius"] = radius
    places = [(i, j) for i in range(2) for j in range(2) if radius[i][j]]
    units = {place: np.zeros((2, 2)) for place in places}
    for place, unit in units.items():
        unit[place] = 1
    spelt["parameter"] = [
        {"name": f"entry{i}{j}", "range": [-radius[i][j], radius[i][j]], "A": unit.tolist()}
        for (i, j), unit in units.items()
    ]
    short, long = (obsdesign.investigate(Problem.from_dict(body)) for body in (sugar, spelt))
    assert short.verdict == "proved"
    assert [claim.evidence for claim in short.claims] == [claim.evidence for claim in long.claims]
    assert short.design is not None
    assert long.design is not None
    for name, value in short.design.gains.items():
        if name != "effects":
            assert np.array_equal(value, long.design.gains[name]), name


@pytest.mark.parametrize(
    "case", ["stated box", "proved box", "no box", "set membership", "luenberger, proved"]
)
def test_middle_and_half_width_are_not_interchangeable(case: str) -> None:
    """Neither in the gains nor in the problem of a design."""
    design = _outcome(case).design
    assert design is not None
    assert obsdesign.verify(design).verdict == "proved"
    body = copy.deepcopy(_CASES[case]())
    for own in body["parameter"]:
        low, high = own["range"]
        middle, half = (low + high) / 2, (high - low) / 2
        own["range"] = [half - abs(middle), half + abs(middle)]
    swapped = dataclasses.replace(design, problem=Problem.from_dict(body).to_dict())
    assert obsdesign.verify(swapped).verdict != "proved"
    if "effects" not in design.gains:  # `luenberger` stores those of its problem alone
        return
    gains = copy.deepcopy(dict(design.gains))
    effect = next(own for own in gains["effects"] if "A" in own)
    gains["A"], effect["A"] = np.array(effect["A"]), np.array(gains["A"])
    assert obsdesign.verify(dataclasses.replace(design, gains=gains)).verdict != "proved"
