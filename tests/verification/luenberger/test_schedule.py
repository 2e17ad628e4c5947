"""Gains at jumps that depend on the dwell time that has just ended."""

from __future__ import annotations

import copy
import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.data.simulation import simulate
from obsdesign.document import jsonable
from obsdesign.equations.luenberger.error_system import schedule_cells, schedule_pairs
from obsdesign.runtime import Sample, from_design
from obsdesign.studies.search.search import search
from obsdesign.verification.luenberger.claims import claims

# one output, three states that grow between jumps: no single gain is found for this range
BASE: dict[str, Any] = {
    "flow": {"A": [[-0.6, 0, -2.3], [-0.2, -1.2, -0.7], [-0.5, -0.3, 0.4]]},
    "jump": {"G": [[1, -0.1, 1.4], [-0.7, 0.4, 0.9], [0.1, -0.7, -0.9]], "dwell_time": [0.2, 1.6]},
    "output": {"C": [[-0.5, 0.2, -1]], "measured": "at_jumps"},
    "observer": {"kind": "luenberger", "schedule": 4},
}


def problem(**changes: Any) -> obsdesign.Problem:
    body = copy.deepcopy(BASE)
    for path, value in changes.items():
        block, key = path.split("__")
        if value is None:
            del body[block][key]
        else:
            body[block][key] = value
    return obsdesign.Problem.from_dict(body)


@pytest.fixture(scope="module")
def design() -> obsdesign.Design:
    return obsdesign.design(problem())


def test_more_dwell_times_than_any_one_gain_that_is_found(design: obsdesign.Design) -> None:
    assert obsdesign.investigate(problem(observer__schedule=None)).verdict == "undecided"
    assert {claim.verdict for claim in design.claims} == {"proved"}
    assert obsdesign.verify(design, paranoid=True).verdict == "proved"
    assert design.gains["M_cells"].shape == (4, 3, 1)


def test_the_error_dies_out_at_random_dwell_times(design: obsdesign.Design) -> None:
    plant = problem().plant
    record = simulate(
        plant, until=40.0, step=0.25, initial=np.array([1.0, -2.0, 1.0]), dwell="random",
        rng=np.random.default_rng(5),
    )  # fmt: skip
    batch = from_design(design).run_batch(
        record.t, record.block("y"), jump=record.columns["jump"], x=[0.0, 0.0, 0.0]
    )
    assert set(batch.status) == {"ok"}
    error = np.abs(batch.x - record.block("x")).max(axis=1)
    assert record.columns["jump"].sum() > 30
    assert error[-20:].max() < 1e-4 * error[:20].max()


def test_the_gain_is_that_of_the_dwell_time_that_ends(design: obsdesign.Design) -> None:
    observer = from_design(design)
    borders, gains = design.gains["dwell_borders"], design.gains
    for dwell in [0.2, *borders, *(borders + 0.01), 1.6]:
        state = observer.init(t=0.0, x=[1.0, 0.0, 0.0])
        state, first = observer.step(state, Sample(1.0, y=[0.0], jump=True))
        state, second = observer.step(state, Sample(1.0 + dwell, y=[0.0], jump=True))
        before = expm(gains["A"] * (1.0 + dwell - 1.0)) @ first.x
        cell = int(np.sum(borders <= 1.0 + dwell - 1.0))
        after = (gains["G"] - gains["M_cells"][cell] @ gains["C"]) @ before
        np.testing.assert_allclose(second.x, after, rtol=1e-9, atol=1e-12)


def test_brute_force_does_not_contradict(design: obsdesign.Design) -> None:
    gains, rng = design.gains, np.random.default_rng(0)
    P = np.array(evidence(design, "dwell_stability")["P_cells"])
    for _ in range(200):
        dwells = rng.uniform(0.2, 1.6, 30)
        e, cell, value = rng.standard_normal(3), 0, math.inf
        for theta in dwells:
            cell = int(np.searchsorted(gains["dwell_borders"], theta, side="right"))
            H = gains["G"] - gains["M_cells"][cell] @ gains["C"]
            e = H @ expm(gains["A"] * theta) @ e
            assert e @ P[cell] @ e < value
            value = float(e @ P[cell] @ e)


def evidence(design: obsdesign.Design, name: str) -> Any:
    return next(claim for claim in design.claims if claim.id == name).evidence


def judged(design: obsdesign.Design, gains: Any, certificate: Any) -> dict[str, str]:
    listed = claims(problem(), gains, {"dwell_stability": certificate})
    return {claim.id: claim.verdict for claim in listed}


def test_twins_that_must_not_be_proved(design: obsdesign.Design) -> None:
    right = evidence(design, "dwell_stability")
    P = np.array(right["P_cells"])
    assert judged(design, design.gains, right)["dwell_stability"] == "proved"
    flipped = design.gains | {"M_cells": design.gains["M_cells"][::-1]}
    assert judged(design, flipped, right)["dwell_stability"] != "proved"
    for wrong in (
        P[::-1] * [[[1]], [[9]], [[1]], [[9]]],
        -P,
        P[:3],
        P * np.nan,
        P + np.eye(3, k=1),
        "P",
    ):
        certificate = {"P_cells": jsonable_or_text(wrong)}
        assert judged(design, design.gains, certificate)["dwell_stability"] == "undecided"
    shrunk = design.gains | {"dwell_borders": design.gains["dwell_borders"] * 0.7}
    assert judged(design, shrunk, right)["dwell_stability"] != "proved"
    short = design.gains | {"dwell_borders": design.gains["dwell_borders"][:2]}
    assert judged(design, short, right) == {"consistent": "refuted"}


def jsonable_or_text(value: Any) -> Any:
    return value if isinstance(value, str) else value.tolist()


def test_borders_out_of_order_are_not_believed(design: obsdesign.Design) -> None:
    turned = design.gains | {"dwell_borders": design.gains["dwell_borders"][::-1]}
    right = evidence(design, "dwell_stability")
    assert judged(design, turned, right) == {"consistent": "refuted"}


def test_a_gain_that_grows_is_refuted() -> None:
    design = obsdesign.design(problem())
    loud = design.gains | {"M_cells": design.gains["M_cells"] + 50.0}
    judgement = claims(problem(), loud, {})
    claim = next(c for c in judgement if c.id == "dwell_stability")
    assert claim.verdict == "refuted"
    assert claim.evidence["witness"]["spectral_radius"] > 1


@pytest.mark.parametrize(
    "changes",
    [
        {"observer__schedule": [0.5, 0.9, 1.3]},
        {"observer__decay_rate": 0.05},
        {"output__jump_measurement": "after"},
        {"jump__dwell_jitter": 0.1},
    ],
)
def test_variants_are_proved_and_verified(changes: dict[str, Any], tmp_path: Path) -> None:
    design = obsdesign.design(problem(**changes))
    design.save(tmp_path / "design.json")
    again = obsdesign.load_design(tmp_path / "design.json")
    assert obsdesign.verify(again, paranoid=True).verdict == "proved"
    assert json.dumps(jsonable(again.gains)) == json.dumps(jsonable(design.gains))


def test_an_unbounded_range_with_a_flow_that_decays() -> None:
    slow = {
        "flow__A": [[-2.6, 0, -2.3], [-0.2, -3.2, -0.7], [-0.5, -0.3, -1.6]],
        "jump__G": [[1.3, -0.1, 1.8], [-0.9, 0.5, 1.2], [0.1, -0.9, -1.2]],
        "jump__dwell_time": [0.05, "inf"],
    }
    design = obsdesign.design(problem(**slow))
    assert obsdesign.verify(design, paranoid=True).verdict == "proved"
    assert "hurwitz" in {claim.id for claim in design.claims}


def test_a_search_for_dwell_times_wants_one_gain() -> None:
    with pytest.raises(obsdesign.InputError) as caught:
        search(problem(), "longest_dwell")
    assert str(caught.value) == (
        "--for dwell times: observer.schedule divides a range that is fixed; search without it."
    )


def test_cells_cover_the_range_and_pairs_obey_the_jitter() -> None:
    cells = schedule_cells(0.2, 1.6, [0.5, 0.9, 1.3])
    assert (cells[0][0], cells[-1][1]) == (0.2, 1.6)
    assert all(a[1] > b[0] for a, b in itertools.pairwise(cells))
    assert len(schedule_pairs(cells, math.inf)) == 16
    near = schedule_pairs(cells, 0.05)
    assert near == tuple((i, j) for i in range(4) for j in range(4) if abs(i - j) <= 1)
    endless = schedule_cells(0.2, math.inf, [0.5, 0.9, 1.3])
    # only the first cell and the last are further apart than that
    dropped = set(schedule_pairs(endless, math.inf)) - set(schedule_pairs(endless, 0.45))
    assert dropped == {(0, 3), (3, 0)}


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        (
            {"observer__gains": {"M": [[0], [0], [0]]}},
            "observer.schedule chooses M, but M is given; drop one.",
        ),
        (
            {"observer__schedule": [0.1, 1.0]},
            "observer.schedule must lie inside jump.dwell_time = [0.2, 1.6], more than 8e-09 of "
            "itself from the ends; got 0.1.",
        ),
        (
            {"observer__schedule": 17},
            "observer.schedule must make at most 16 cells, each pair of which is an inequality; "
            "got 17.",
        ),
        (
            {"jump__dwell_time": [0.5, 0.5]},
            "observer.schedule needs a range of dwell times; jump.dwell_time holds one, 0.5. "
            "Drop schedule.",
        ),
        (
            {"output__jump_measurement": "none", "output__measured": "continuous"},
            "observer.schedule needs a measurement at jumps: output.jump_measurement is 'none'.",
        ),
    ],
)
def test_requests_that_cannot_be_met(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(obsdesign.InputError) as caught:
        obsdesign.design(problem(**changes))
    assert str(caught.value) == line


def test_a_second_method_adds_no_boxes(design: obsdesign.Design) -> None:
    certificate = {"dwell_stability": evidence(design, "dwell_stability")}
    plain, again = (
        next(
            c
            for c in claims(problem(), design.gains, certificate, paranoid=paranoid)
            if "P_cells" in c.evidence
        )
        for paranoid in (False, True)
    )
    assert plain.verdict == again.verdict == "proved"
    assert plain.evidence["pairs"] == 16
    assert plain.evidence["boxes"] >= 16
    assert again.evidence["boxes"] == plain.evidence["boxes"]
