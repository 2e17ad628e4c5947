"""Designs for plants with modes: claims, widths at entry, and files that lie."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from obsdesign.document import Design
from obsdesign.workflow import design, investigate, verify
from tests.systems.switched import valve


def evidence(made: Design, name: str) -> dict[str, Any]:
    (claim,) = (claim for claim in made.claims if claim.id == name)
    return dict(claim.evidence)


@pytest.mark.parametrize(
    ("longest", "opened", "closed"),
    [(10.0, (0.5994, 0.0313), (0.2062, 0.0784)), (20.0, (4.176, 0.0605), (1.283, 0.370))],
)
def test_widths_at_entry_are_those_of_the_tube(
    longest: float, opened: tuple[float, ...], closed: tuple[float, ...]
) -> None:
    made = design(valve(longest_closed=longest))
    entry = evidence(made, "mode_width")["entry"]
    assert entry[0][0] == pytest.approx(opened[0], rel=1e-3)
    assert entry[0][1] == pytest.approx(opened[1], abs=6e-5)
    assert entry[1][0] == pytest.approx(closed[0], rel=1e-3)
    assert entry[1][1] == pytest.approx(closed[1], abs=6e-4)
    assert verify(made, paranoid=True).verdict == "proved"


def test_a_stay_beyond_the_limit_is_refuted_by_a_cycle() -> None:
    outcome = investigate(valve(longest_closed=24.01))
    assert outcome.verdict == "refuted"
    (claim,) = (claim for claim in outcome.claims if claim.id == "mode_stability")
    stays = dict(claim.evidence["witness"]["stays"])
    assert stays["open"] == 2.0
    assert stays["closed"] == 24.01
    assert investigate(valve(longest_closed=23.99)).verdict == "proved"


@pytest.mark.parametrize("kind", ["interval", "luenberger"])
def test_open_gains_are_chosen_for_each_mode(kind: str) -> None:
    made = design(valve(kind=kind))
    gains = [mode["L"] for mode in made.gains["modes"]]
    assert np.abs(gains[0]).max() > 0
    assert verify(made).verdict == "proved"
    assert any(one.given and "open [2.0, 10.0]" in one.statement for one in made.guarantees)


def test_decay_rate_holds_along_all_paths_or_is_not_claimed() -> None:
    slow = investigate(valve(kind="luenberger", decay_rate=0.01))
    assert slow.verdict == "proved"
    assert any("e^(-0.01 t)" in one.statement for one in slow.guarantees if one.given)
    # with this gain x1 decays like e^(-0.6 t) while open, and grows while closed
    fixed = {"L": [[0.1], [2]]}
    fast = investigate(valve(kind="luenberger", decay_rate=0.5, gains=fixed))
    assert {claim.id: claim.verdict for claim in fast.claims} == {
        "consistent": "proved", "mode_stability": "proved", "decay_rate": "refuted",
    }  # fmt: skip


def altered(made: Design, change: Any) -> str:
    """The verdict on a design with changed gains or problem, signed anew."""
    gains, problem = copy.deepcopy(dict(made.gains)), copy.deepcopy(dict(made.problem))
    change(gains, problem)
    from dataclasses import replace

    return verify(replace(made, gains=gains, problem=problem)).verdict


def test_files_that_lie_are_refuted() -> None:
    made = design(valve())

    def other_gain(gains: Any, problem: Any) -> None:
        gains["modes"][0]["L"] = np.array([[0.1], [1.9]])

    def longer(gains: Any, problem: Any) -> None:
        gains["modes"][1]["every"] = np.array([1.0, 12.0])

    def fewer(gains: Any, problem: Any) -> None:
        gains["modes"] = gains["modes"][:1]

    def successor(gains: Any, problem: Any) -> None:
        gains["modes"][0]["next"] = ""

    def stays_of_both(gains: Any, problem: Any) -> None:
        longer(gains, problem)
        problem["mode"][1]["every"] = [1.0, 12.0]

    for change in (other_gain, longer, fewer, successor):
        assert altered(made, change) == "refuted"
    # the certificate is for shorter stays: what it states is proved no more
    assert altered(made, stays_of_both) != "proved"
    assert altered(made, lambda gains, problem: None) == "proved"


def test_cells_of_another_certificate_prove_nothing() -> None:
    from dataclasses import replace

    made = design(valve())
    claims = []
    for claim in made.claims:
        if claim.id == "mode_stability":
            cells = copy.deepcopy(claim.evidence["cells"])
            cells[0]["P"], cells[1]["P"] = cells[1]["P"], cells[0]["P"]
            claim = replace(claim, evidence={**claim.evidence, "cells": cells})
        claims.append(claim)
    assert verify(replace(made, claims=tuple(claims))).verdict != "proved"
