"""Coordinates of plants with parameters: common eigenvectors of what changes."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.analysis.balancing import BalancedPlant
from obsdesign.data.simulation import simulate
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.synthesis.interval.common_coordinates import common_bases
from tests.systems.parameters import Body, degue

# exchange in a ring of three rooms
_RING = [[-2, 1, 1], [1, -2, 1], [1, 1, -2]]


def ring(losses: Any = (0.2, 0.2, 0.2), **observer: Any) -> Body:
    """Three rooms that exchange heat at a rate of 1 +- 0.6, the first one measured."""
    return {
        "flow": {"A": (-np.diag(losses)).tolist(),
                 "disturbance": {"lower": [-0.05] * 3, "upper": [0.05] * 3}},
        "output": {"C": [[1, 0, 0]], "noise_bound": [0.02]},
        "parameter": [{"name": "exchange", "range": [0.4, 1.6], "A": copy.deepcopy(_RING)}],
        "observer": {"kind": "interval", **observer},
    }  # fmt: skip


def _outcome(body: Body) -> tuple[obsdesign.Outcome, Any]:
    """The outcome, and the widths that are claimed for |y| = 0 and what |y| = 1 adds."""
    outcome = obsdesign.investigate(Problem.from_dict(body))
    evidence = {claim.id: claim.evidence for claim in outcome.claims}.get("source_width", {})
    return outcome, [np.array(own["always"])[3:] for own in evidence.values()]


@pytest.mark.parametrize("losses", [(0.2, 0.2, 0.2), (0.2, 0.3, 0.25)])
def test_a_ring_of_rooms_is_proved_in_coordinates_alone(losses: tuple[float, ...]) -> None:
    """In the plant's own the radius grows by 2.2 per unit of time, whatever the gains."""
    own, _ = _outcome(ring(losses, form="split"))
    assert own.verdict == "undecided"
    for observer in ({}, {"form": "coordinates"}):
        outcome, (constant, of_y) = _outcome(ring(losses, **observer))
        assert outcome.verdict == "proved"
        assert outcome.design is not None
        assert outcome.design.gains["form"] == "coordinates"
        assert (constant < 0.3).all()
        assert (of_y < 0.1).all()
        assert obsdesign.verify(outcome.design).verdict == "proved"


@pytest.mark.parametrize("gains", [{}, {"L": [[0], [0], [0]]}])
def test_stated_coordinates_are_taken(gains: dict[str, Any]) -> None:
    stated = {"S": [[1, 1, 1], [1, -1, 1], [1, 0, -2]], **gains}
    outcome, (constant, of_y) = _outcome(ring(form="coordinates", gains=stated))
    assert outcome.verdict == "proved"
    assert (constant < 0.7).all()
    assert (of_y < 1e-3).all()
    identity = {**stated, "S": np.eye(3).tolist()}
    assert _outcome(ring(form="coordinates", gains=identity))[0].verdict != "proved"


def _run(scale: float, course: Any) -> tuple[float, Any, Body]:
    """By how much x leaves its bounds where the range is so much wider, and their widths."""
    body = ring(gains={"S": [[1, 1, 1], [1, -1, 1], [1, 0, -2]], "L": [[0], [0], [0]]})
    true = copy.deepcopy(body)
    true["parameter"][0]["range"] = [1 - 0.6 * scale, 1 + 0.6 * scale]
    start = np.array([1.0, -2, 4])
    run = simulate(
        Problem.from_dict(true).plant, until=20.0, step=0.05, initial=start,
        disturbance="extreme", parameters=course, rng=np.random.default_rng(1),
    )  # fmt: skip
    observer = from_design(obsdesign.design(Problem.from_dict(body)))
    bounds = observer.run_batch(run.t, run.block("y"), lower=start - 0.1, upper=start + 0.1)
    x = run.block("x")
    gap = float(np.maximum(bounds.lower - x, x - bounds.upper).max())
    return gap, bounds.upper - bounds.lower, body


@pytest.mark.parametrize("course", ["bang-bang", "random", "extreme"])
def test_bounds_in_coordinates_hold(course: str) -> None:
    gap, widths, body = _run(1.0, course)
    assert gap <= 1e-9
    constant, of_y = _outcome(body)[1]
    assert (widths[-100:].max(axis=0) <= constant + 10 * of_y).all()


def test_bounds_in_coordinates_are_left_by_a_parameter_beyond_its_range() -> None:
    assert _run(3.0, {"exchange": 2.8})[0] > 0.1


def test_common_eigenvectors_make_every_matrix_diagonal() -> None:
    """Of a repeated eigenvalue those that C misses; without common ones those of an effect."""
    C, A = np.array([[1.0, 0, 0]]), -0.2 * np.eye(3)
    units = BalancedPlant(np.ones(3), np.ones(1), 1.0, A, C)
    S = next(common_bases(A, [np.array(_RING, float), np.eye(3)], units))
    R = np.linalg.solve(S, np.array(_RING) @ S)
    np.testing.assert_allclose(R, np.diag(np.diag(R)), atol=1e-8)
    assert sorted((np.abs(C @ S)[0] > 1e-4).tolist()) == [False, True, True]
    exchange = np.array([[-1.0, 1, 0], [1, -1, 0], [0, 0, 0]])
    bases = list(common_bases(np.diag([-1.0, -2, -3]), [exchange, exchange[::-1, ::-1]], units))
    off = [np.linalg.solve(S, exchange @ S) for S in bases]
    assert min(float(np.abs(R - np.diag(np.diag(R))).max()) for R in off) < 1e-4
    assert list(common_bases(A, [], units)) == []


def test_nothing_is_tried_where_other_forms_do_or_none_can() -> None:
    labels = obsdesign.investigate(Problem.from_dict(degue(0.05))).result["forms"]
    assert labels["split"]["verdict"] == "proved"
    lost = ring((0.2, 0.2, -3.0))
    assert obsdesign.investigate(Problem.from_dict(lost)).verdict != "proved"
