"""Tail matrices of designs: proved where they stand, never needed, never believed."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.balls import exact
from obsdesign.design_file import from_dict
from obsdesign.verification.tails import proved_tails
from tests.systems.checked import PROBLEMS, body, changed, evidence
from tests.systems.designs import designed

CLAIMS = [
    ("cooperative", "dwell_stability"),
    ("point, decay", "dwell_stability"),
    ("point, decay", "decay_rate"),
    ("point, no jumps", "hurwitz"),
    ("point, no jumps", "decay_rate"),
]


@pytest.mark.parametrize(("name", "claim"), CLAIMS)
def test_designs_carry_tails_that_fall_along_the_flow(name: str, claim: str) -> None:
    gains = designed(PROBLEMS[name]).gains
    F = gains["A"] - gains["L"] @ gains["C"]
    if claim == "decay_rate":
        F = F + PROBLEMS[name]["observer"]["decay_rate"] * np.eye(len(F))
    tails = evidence(body(name), claim)["tails"]
    assert tails
    for X in tails:
        assert np.array_equal(X, np.transpose(X))
        assert np.linalg.eigvalsh(X).min() > 0
        assert np.linalg.eigvalsh(F.T @ np.array(X) + np.array(X) @ F).max() < 0


@pytest.mark.parametrize(("name", "claim"), CLAIMS)
def test_a_design_without_them_is_verified_and_a_false_one_is_false(name: str, claim: str) -> None:
    without = changed(body(name), lambda d: evidence(d, claim).pop("tails"))
    assert obsdesign.verify(from_dict(without)).verdict == "proved"
    unit = np.eye(2).tolist()
    hostile: list[Any] = [
        [],
        [[[-1.0, 0.0], [0.0, -1.0]]],
        "tails",
        [unit, [[1.0, 0.5], [0.0, 1.0]]],
    ]
    hostile += [[[[1.0]]], [[["1", "0"], ["0", "1"]]], [None]]
    for tails in hostile:
        false = changed(body(name), lambda d, tails=tails: evidence(d, claim).update(tails=tails))
        outcome = obsdesign.verify(from_dict(json.loads(json.dumps(false))))
        assert outcome.verdict == "refuted", tails
        assert outcome.claims[-1].evidence["witness"]["entry"] == f"{claim}.tails"


def test_only_what_falls_is_evidence() -> None:
    F = exact(np.array([[-1.0, 0.0], [4.0, -1.0]]))
    falls, grows = [[17.0, 2.0], [2.0, 1.0]], [[1.0, 0.0], [0.0, 1.0]]
    assert proved_tails(F, [falls]) == {"tails": [falls]}
    assert proved_tails(F, [falls, grows]) == {}
    assert proved_tails(F, None) == proved_tails(F, []) == {}
    assert proved_tails(-F, [falls]) == {}


def test_a_flow_that_grows_has_none() -> None:
    assert "tails" not in evidence(body("schedule"))
    assert "tails" not in evidence(body("windows, reduced"))
