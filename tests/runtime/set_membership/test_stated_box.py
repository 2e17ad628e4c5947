"""A stated box of the state: it bounds what no sample shows, and cuts bounds while it holds."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from obsdesign.data.simulation import simulate
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.boxes import BoundsFault
from obsdesign.workflow import Outcome, investigate, verify

# a cart of which the speed alone is measured, friction known to 10 %, between end stops
CART: dict[str, Any] = {
    "flow": {"A": [[0, 1], [0, -1]], "disturbance": {"lower": [0, -0.1], "upper": [0, 0.1]}},
    "parameter": [{"name": "friction", "range": [-0.1, 0.1], "A": [[0, 0], [0, 1]]}],
    "state": {"lower": [-1, -1], "upper": [1, 1]},
    "output": {"C": [[0, 1]], "noise_bound": [0.01]},
    "observer": {"kind": "set_membership", "window": 4},
}


def _outcome(kind: str, **changes: Any) -> Outcome:
    body = copy.deepcopy(CART) | changes
    body["observer"] = {"kind": kind}
    return investigate(Problem.from_dict({key: own for key, own in body.items() if own}))


@pytest.mark.parametrize("growth", [0.0, 0.2])
def test_the_box_bounds_a_state_that_no_sample_shows(growth: float) -> None:
    flow = CART["flow"] | {"A": [[growth, 1], [0, -1]]}
    outcome = _outcome("set_membership", flow=flow)
    assert outcome.verdict == "proved"
    assert outcome.design is not None
    assert verify(outcome.design).verdict == "proved"
    claim = next(claim for claim in outcome.claims if claim.id == "attainable")
    assert "stays in the box" in claim.statement
    plant = Problem.from_dict(outcome.design.problem).plant
    columns = simulate(plant, until=6.0, step=0.1, initial=[0.1, 0.0]).columns
    x = np.column_stack([columns["x1"], columns["x2"]])
    inside = (np.abs(x) <= 1).all(axis=1)
    batch = from_design(outcome.design).run_batch(
        columns["t"], columns["y1"][:, None], lower=[0, -0.1], upper=[0.2, 0.1]
    )
    assert inside.all()
    assert set(batch.status) == {"ok"}
    assert ((batch.lower - 1e-9 <= x) & (x <= batch.upper + 1e-9)).all()
    assert (batch.lower >= -1).all()
    assert (batch.upper <= 1).all()


@pytest.mark.parametrize("kind", ["set_membership", "interval"])
def test_without_the_box_or_a_parameter_no_observer_exists(kind: str) -> None:
    without = {"interval": {"state": None}, "set_membership": {"state": None, "parameter": None}}
    outcome = _outcome(kind, **without[kind])
    assert outcome.verdict == "refuted"
    witness = next(claim for claim in outcome.claims if claim.id == "attainable").evidence
    assert "no observer exists" in witness["witness"]["reason"]


def test_kind_interval_refutes_nothing_in_the_box() -> None:
    outcome = _outcome("interval")
    assert outcome.verdict == "undecided"
    claim = next(claim for claim in outcome.claims if claim.id == "attainable")
    assert "'set_membership' takes such plants" in claim.evidence["reason"]


def test_a_state_beyond_the_box_refutes_it() -> None:
    outcome = _outcome("set_membership", flow=CART["flow"] | {"A": [[0, 1], [0, 0]]})
    assert outcome.design is not None
    t = 0.1 * np.arange(8)
    y = 0.97 + 0.15 * t[:, None]  # as fast as disturbance and friction allow
    batch = from_design(outcome.design).run_batch(t, y, lower=[0, 0.9], upper=[0.1, 1.0])
    first = int(np.argmax(y[:, 0] > 1.01))  # noise alone does not make that
    assert batch.status[:first] == ("ok",) * first
    assert batch.status[first] == str(BoundsFault.APART)
    assert all("void since" in status for status in batch.status[first + 1 :])
    assert (batch.upper[first + 1 :, 1] > y[first + 1 :, 0]).all()  # without the box
