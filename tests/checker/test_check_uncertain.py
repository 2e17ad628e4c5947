"""The checker of uncertain plants: what is true is proved, what is made false is not."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import cache
from typing import Any

import pytest

import obsdesign
from obsdesign.checker import check_uncertain
from obsdesign.design_file import from_dict
from obsdesign.document import digest
from obsdesign.errors import InputError
from obsdesign.verification.second_opinion import PROGRAMS
from tests.systems.checked import answer, changed, exit_code
from tests.systems.designs import designed

_STIFFNESS = {"name": "stiffness", "range": [0.9, 1.1], "A": [[0, 0], [-1, 0]]}
_JUMP = {"G": [[1, 0], [0, 0.8]], "dwell_time": [1, 3]}


def plant(**entries: Any) -> dict[str, Any]:
    """Spring and damper with an uncertain stiffness, by itself: no gains."""
    zero = [[0], [0]]
    body: dict[str, Any] = {
        "flow": {"A": [[0, 1], [0, -0.1]]}, "jump": _JUMP, "output": {"C": [[1, 0]]},
        "parameter": [_STIFFNESS],
        "observer": {"kind": "luenberger", "gains": {"L": zero, "M": zero}},
    }  # fmt: skip
    body |= entries
    if body["jump"] is None:
        del body["jump"], body["observer"]["gains"]["M"]
    return body


PLANTS = {
    "jumps": plant(),
    "no jumps": plant(jump=None, flow={"A": [[0, 1], [0, -1]]}),
    "no longest dwell time": plant(jump=_JUMP | {"dwell_time": [1, "inf"]}, flow={"A": [[0, 1], [0, -1]]}),
    "constant, in cells": plant(
        parameter=[_STIFFNESS | {"range": [0.7, 1.3], "constant": True}]
    ),
    "a radius": plant(flow={"A": [[0, 1], [-1, -0.1]], "A_radius": [[0, 0], [0.1, 0]]}, parameter=[]),
}  # fmt: skip


@cache
def document(name: str) -> dict[str, Any]:
    problem = {key: value for key, value in PLANTS[name].items() if value != []}
    return copy.deepcopy(designed(problem).to_dict())


def certificate(body: dict[str, Any]) -> dict[str, Any]:
    evidence = {claim["id"]: claim["evidence"] for claim in body["claims"]}
    tree: dict[str, Any] = evidence["robust_stability"]["certificate"]
    while "halves" in tree:
        tree = tree["halves"][1]
    return tree


def verdict(body: dict[str, Any]) -> str:
    try:
        return obsdesign.verify(from_dict(body)).verdict
    except InputError:
        return "unreadable"


@pytest.mark.parametrize("name", PLANTS)
def test_plants_are_proved_again(name: str) -> None:
    code, text = answer(document(name), PROGRAMS[3])
    assert code == 0, text
    assert "proved: the plant by itself tends to zero" in text
    claims = obsdesign.verify(from_dict(document(name)), paranoid=True).claims
    assert {claim.id: claim.verdict for claim in claims}["checker"] == "proved"


def test_a_wide_constant_range_is_cut() -> None:
    evidence = {
        claim["id"]: claim["evidence"] for claim in document("constant, in cells")["claims"]
    }
    assert evidence["robust_stability"]["cells"] > 1


def parameter(**entries: Any) -> Callable[[dict[str, Any]], object]:
    return lambda body: body["problem"]["parameter"][0].update(entries)


FALSE: list[tuple[str, Callable[[dict[str, Any]], object]]] = [
    ("jumps", parameter(range=[0.2, 1.8])),
    ("jumps", parameter(range=[1.1, 0.9])),
    ("jumps", parameter(range=[True, 1.0])),
    ("jumps", parameter(range=[0.9, "inf"])),
    ("jumps", parameter(constant=1)),
    ("jumps", parameter(unknown=1)),
    ("jumps", lambda d: d["problem"]["jump"].update(dwell_time=[0.1, 3.0])),
    ("jumps", lambda d: d["problem"]["jump"].update(dwell_time=[1.0, 9.0])),
    ("jumps", lambda d: d["problem"]["jump"].update(G=[[1.0, 0.0], [0.0, 1.3]])),
    ("jumps", lambda d: d["problem"]["flow"].update(A=[[0.0, 1.0], [0.0, 0.1]])),
    ("jumps", lambda d: d["problem"]["flow"].update(dt=0.1)),
    ("jumps", lambda d: certificate(d)["R"].reverse()),
    ("jumps", lambda d: certificate(d)["R"].pop()),
    ("jumps", lambda d: certificate(d)["nodes"].pop()),
    ("jumps", lambda d: certificate(d)["nodes"].reverse()),
    ("jumps", lambda d: certificate(d)["R"][0][0].reverse()),
    ("jumps", lambda d: certificate(d)["R"][0][0].__setitem__(0, "1")),
    ("jumps", lambda d: certificate(d)["R"][0][0].__setitem__(0, -1.0)),
    ("no jumps", lambda d: d["problem"]["flow"].update(A=[[0.0, 1.0], [0.0, 0.0]])),
    ("constant, in cells", parameter(constant=False)),
    ("constant, in cells", parameter(range=[0.2, 1.8])),
    ("a radius", lambda d: d["problem"]["flow"].update(A_radius=[[0.0, 0.0], [0.9, 0.0]])),
    ("a radius", lambda d: d["problem"]["flow"].update(A_radius=[[0.0, 0.0], [-0.1, 0.0]])),
]


@pytest.mark.parametrize(("name", "change"), FALSE)
def test_twins_that_must_not_be_proved(
    name: str, change: Callable[[dict[str, Any]], object]
) -> None:
    body = changed(document(name), change)
    assert exit_code(body, check_uncertain) != 0
    assert verdict(body) != "proved"


def test_conditions_are_strict() -> None:
    """x' = 0 and x+ = x / 2: R falls at jumps and only rests between them."""
    body = copy.deepcopy(document("jumps"))
    body["problem"]["flow"]["A"] = [[0.0, 0.0], [0.0, 0.0]]
    body["problem"]["jump"].update(G=[[0.5, 0.0], [0.0, 0.5]], dwell_time=[0.0, "inf"])
    body["problem"]["parameter"] = []
    tree = certificate(body)
    tree.update(nodes=[0.0], R=[[[1.0, 0.0], [0.0, 1.0]]])
    assert exit_code(body | {"digest": digest(body)}, check_uncertain) == 1
    body["problem"]["flow"]["A"] = [[-1e-9, 0.0], [0.0, -1e-9]]
    assert exit_code(body | {"digest": digest(body)}, check_uncertain) == 0
