"""A box of the state that is proved bounds effects once the state has come to it."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import obsdesign
from lmi.arithmetic.arrays import Matrix
from obsdesign.document import Claim
from obsdesign.problem.problem import Problem
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.known_inputs import LARGE_U
from obsdesign.runtime.set_membership.uncertain_observer import UncertainSetMembershipObserver
from obsdesign.workflow import investigate, verify
from tests.systems.parameters import Body

_RATE, _STEP = 0.3, 0.25


def _body(jumps: bool, **flow: Any) -> Body:
    """Two compartments with a common uncertain rate; the second is measured, with much noise."""
    body: Body = {
        "flow": {"A": [[-1, 0.2], [0.1, -1.5]],
                 "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]}, **flow},
        "output": {"C": [[0, 1]], "noise_bound": [20], "measured": "periodic", "period": _STEP},
        "parameter": [{"name": "rate", "range": [-_RATE, _RATE], "A": [[1, 0], [0, 1]]}],
        "observer": {"kind": "set_membership", "window": 6},
    }  # fmt: skip
    if jumps:
        ends = {"lower": [-0.2, -0.2], "upper": [0.2, 0.2]}
        body["jump"] = {"disturbance": ends, "dwell_time": [1, 1]}
    return body


@cache
def _outcome(jumps: bool) -> obsdesign.Outcome:
    return investigate(Problem.from_dict(_body(jumps)))


def _observer(outcome: obsdesign.Outcome) -> UncertainSetMembershipObserver:
    assert outcome.verdict == "proved"
    assert outcome.design is not None
    observer = from_design(outcome.design)
    assert isinstance(observer, UncertainSetMembershipObserver)
    return observer


def _worst(jumps: bool, x: float, until: float) -> tuple[Matrix, Any, Matrix]:
    """(t, jump, x) of the slowest decay with the largest disturbances, from x > 0."""
    A = np.array([[-1, 0.2], [0.1, -1.5]]) + _RATE * np.eye(2)
    whole = scipy.linalg.expm(_STEP * np.block([[A, 0.1 * np.ones((2, 1))], [np.zeros((1, 3))]]))
    t = _STEP * np.arange(round(until / _STEP) + 1)
    jump = jumps & (np.arange(len(t)) % 4 == 0) & (t > 0)
    xs = [np.array([x, x])]
    for k in range(1, len(t)):
        xs.append(whole[:2, :2] @ xs[-1] + whole[:2, 2] + 0.2 * jump[k])
    return t, jump, np.array(xs)


def _claims(outcome: obsdesign.Outcome) -> dict[str, Claim]:
    return {claim.id: claim for claim in outcome.claims}


@pytest.mark.parametrize("jumps", [False, True])
@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_bounds_hold_from_outside_the_box_and_come_to_their_width(
    jumps: bool, scale: float
) -> None:
    outcome = _outcome(jumps)
    observer = _observer(outcome)
    t, jump, x = _worst(jumps, 8 * scale, 50.0 + 4 * np.log(scale))
    more = {"jump": jump} if jumps else {}
    batch = observer.run_batch(t, x[:, 1:], lower=[0, 0], upper=[9 * scale] * 2, **more)
    assert (batch.lower <= x * (1 + 1e-12) + 1e-9).all()
    assert (x * (1 - 1e-12) - 1e-9 <= batch.upper).all()
    widths = np.array(_claims(outcome)["width"].evidence["always"])
    assert ((batch.upper - batch.lower)[-20:] <= widths * (1 + 1e-4)).all()
    # without the box the parameter acts on all that y leaves open
    free = observer._without_box.run_batch(t, x[:, 1:], lower=[0, 0], upper=[9] * 2, **more)
    assert ((free.upper - free.lower)[-20:] > widths).any()


def test_what_is_claimed_is_proved_from_the_file() -> None:
    outcome = _outcome(True)
    assert outcome.design is not None
    assert verify(outcome.design).verdict == "proved"
    assert "proved ultimate bound of |x|" in outcome.guarantees[0].statement
    design = outcome.design
    tube = design.gains["state_tube"]
    forged = obsdesign.Design(**{**vars(design), "gains": {**design.gains, "state_tube": 2 * tube}})
    assert _claims(verify(forged))["consistent"].verdict == "refuted"


def test_a_smaller_box_is_not_proved() -> None:
    outcome = _outcome(False)
    design = outcome.design
    assert design is not None
    half = {name: [0.5 * x for x in own] for name, own in
            _claims(outcome)["state_box"].evidence.items() if isinstance(own, list)}  # fmt: skip
    claims = tuple(
        Claim(c.id, c.statement, c.source, c.verdict, {**c.evidence, **half})
        if c.id == "state_box" else c for c in design.claims
    )  # fmt: skip
    forged = obsdesign.Design(**{**vars(design), "claims": claims})
    assert verify(forged).verdict != "proved"


@pytest.mark.parametrize("jumps", [False, True])
def test_a_box_that_holds_at_once_counts_at_once(jumps: bool) -> None:
    observer = _observer(_outcome(jumps))
    tube = observer.gains.state_tube
    assert tube is not None
    inside, outside = (observer.init(0.0, lower=-s * tube, upper=s * tube) for s in (1.0, 1.01))
    assert (inside.largest is None) is not jumps  # with jumps, from the first one on
    assert outside.largest is not None
    state, _ = observer.step(inside, Sample(0.0, y=np.zeros(1)))
    state, _ = observer.step(state, Sample(1.0, y=np.zeros(1), jump=jumps))
    assert state.largest is None


def test_inputs_beyond_their_bound_and_early_jumps_end_it() -> None:
    body = _body(True, B=[[1], [0]], input_bound=[0.1])
    observer = _observer(investigate(Problem.from_dict(body)))
    state = observer.init(0.0, lower=[0, 0], upper=[0.1, 0.1])
    for k in range(5):
        state, estimate = observer.step(
            state, Sample(float(k), np.zeros(1), np.zeros(1), jump=k > 0)
        )
    assert state.largest is None
    state, estimate = observer.step(state, Sample(4.5, np.zeros(1), u=np.array([5.0])))
    assert state.largest is None
    state, estimate = observer.step(state, Sample(5.0, np.zeros(1), u=np.zeros(1), jump=True))
    assert LARGE_U in estimate.status
    assert state.largest is not None
    state = observer.reset(state, lower=[0, 0], upper=[0.1, 0.1])
    state, _ = observer.step(state, Sample(6.0, np.zeros(1), jump=True))
    assert state.largest is None
    state, estimate = observer.step(state, Sample(6.1, np.zeros(1), jump=True))
    assert "dwell time" in estimate.status
    for k in range(1, 60):  # jumps far too often: x leaves the tube
        state, estimate = observer.step(state, Sample(6.1 + 0.01 * k, np.zeros(1), jump=True))
    assert state.largest is not None
