"""A box of the state that was proved counts once the state has come to it, wherever it began."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import obsdesign
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.interval.fleet import Fleet
from obsdesign.runtime.state_box import SizeStep
from obsdesign.workflow import investigate, verify
from tests.systems.designs import designed

_RATE = 0.3


def _body(jumps: bool) -> dict[str, Any]:
    """Two compartments with a common uncertain rate; y tells nothing."""
    body: dict[str, Any] = {
        "flow": {"A": [[-1, 0.2], [0.1, -1.5]],
                 "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]}},
        "output": {"C": [[0, 1]], "noise_bound": [20]},
        "parameter": [{"name": "rate", "range": [-_RATE, _RATE], "A": [[1, 0], [0, 1]]}],
        "observer": {"kind": "interval", "gains": {"L": [[0], [0]]}},
    }  # fmt: skip
    if jumps:
        ends = {"lower": [-0.2, -0.2], "upper": [0.2, 0.2]}
        body["jump"] = {"disturbance": ends, "dwell_time": [1, 3]}
        body["observer"]["gains"]["M"] = [[0], [0]]
    return body


@cache
def _observer(jumps: bool) -> tuple[Any, Any]:
    outcome = investigate(obsdesign.Problem.from_dict(_body(jumps)))
    assert outcome.verdict == "proved"
    assert outcome.design is not None
    width = next(claim for claim in outcome.claims if claim.id == "width")
    return from_design(outcome.design), np.array(width.evidence["always"])


def _worst(jumps: bool, x: Any, dwell: float, until: float = 30.0) -> Any:
    """(t, jump, x) of the slowest decay with the largest disturbances, from x > 0."""
    A = np.array([[-1, 0.2], [0.1, -1.5]]) + _RATE * np.eye(2)
    h = 0.05
    whole = scipy.linalg.expm(h * np.block([[A, 0.1 * np.ones((2, 1))], [np.zeros((1, 3))]]))
    t = h * np.arange(round(until / h) + 1)
    jump = jumps & (np.arange(len(t)) % round(dwell / h) == 0) & (t > 0)
    xs = [np.array(x, float)]
    for k in range(1, len(t)):
        xs.append(whole[:2, :2] @ xs[-1] + whole[:2, 2] + 0.2 * jump[k])
    return t, jump, np.array(xs)


@pytest.mark.parametrize("jumps", [False, True])
@pytest.mark.parametrize("scale", [1.0, 1e6])
def test_bounds_hold_from_outside_the_box_and_come_to_its_width(jumps: bool, scale: float) -> None:
    observer, always = _observer(jumps)
    t, jump, x = _worst(jumps, [8 * scale, 8 * scale], 1.0, 40.0 + 2 * np.log(scale))
    more = {"jump": jump} if jumps else {}
    batch = observer.run_batch(t, x[:, 1:], lower=[0, 0], upper=[9 * scale] * 2, **more)
    assert (batch.lower <= x + 1e-9).all()
    assert (x - 1e-9 <= batch.upper).all()
    assert set(batch.status[:1]) | set(batch.status[-200:]) == {"ok"}
    assert ((batch.upper - batch.lower)[-100:] <= always * (1 + 1e-6)).all()


@pytest.mark.parametrize("jumps", [False, True])
def test_a_box_that_holds_at_once_counts_at_once(jumps: bool) -> None:
    observer, _ = _observer(jumps)
    tube = observer.gains.state_tube
    inside, outside = (observer.init(0.0, lower=-s * tube, upper=s * tube) for s in (1.0, 1.01))
    assert (inside.largest is None) is not jumps  # with jumps, from the first one on
    assert outside.largest is not None
    state, _ = observer.step(inside, Sample(0.0))
    state, _ = observer.step(state, Sample(1.5, jump=jumps))
    assert state.largest is None


def test_a_jump_too_early_ends_what_counts_on_the_box() -> None:
    observer, _ = _observer(True)
    state = observer.init(0.0, lower=[0, 0], upper=[0.1, 0.1])
    for t in (0.0, 1.0, 2.0, 3.0):
        state, _ = observer.step(state, Sample(t, jump=t > 0))
    assert state.largest is None
    x = state.box[2:] * -1
    for k in range(1, 40):  # jumps far too often: x leaves the tube
        t = 3.0 + 0.01 * k
        state, estimate = observer.step(state, Sample(t, jump=True))
        x = x * np.exp(-0.02) + 0.2
        assert "dwell time" in estimate.status
        assert (estimate.upper >= x).all()
    assert state.largest is not None


def test_the_stated_box_counts_from_the_start() -> None:
    body = _body(False) | {"state": {"lower": [-1, -1], "upper": [1, 1]}}
    observer = from_design(designed(body))
    assert observer.gains.state_tube is None
    assert observer.init(0.0, lower=[0, 0], upper=[9, 9]).largest is None


@pytest.mark.parametrize("jumps", [False, True])
def test_the_bound_of_the_state_is_above_every_solution(jumps: bool) -> None:
    tube = _observer(jumps)[0].box
    rng = np.random.default_rng(3)
    for _ in range(30):
        x, h = rng.uniform(-5, 5, 2), 10.0 ** rng.uniform(-3, 0.5)
        largest = tube.after(abs(x), SizeStep(h, 1.0, np.zeros(0)))
        for _ in range(10):
            own = x.copy()
            for _ in range(5):
                A = np.array([[-1, 0.2], [0.1, -1.5]]) + rng.choice([-_RATE, _RATE]) * np.eye(2)
                b = rng.choice([-0.1, 0.1], (2, 1))
                own = (scipy.linalg.expm(h / 5 * np.block([[A, b], [np.zeros((1, 3))]]))
                       @ np.append(own, 1.0))[:2]  # fmt: skip
            assert (abs(own) <= largest).all()
        if jumps:
            assert (tube.after_jump(largest, np.zeros(0)) >= largest + 0.2).all()


def test_steps_batches_and_fleets_agree_on_when_it_holds() -> None:
    observer, _ = _observer(False)
    t, _, x = _worst(False, [8, 8], 1.0, 40.0)
    batch = observer.run_batch(t, x[:, 1:], lower=[0, 0], upper=[9, 9])
    state = observer.init(0.0, lower=[0, 0], upper=[9, 9])
    fleet = Fleet((observer,) * 12)
    fleets = fleet.init(0.0, lower=[0, 0], upper=[9, 9])
    for k, time in enumerate(t):
        state, estimate = observer.step(state, Sample(float(time), x[k, 1:]))
        fleets, all_of_them = fleet.step(fleets, float(time), x[k, 1:])
        np.testing.assert_array_equal(batch.upper[k], estimate.upper)
        np.testing.assert_allclose(all_of_them.upper[:, 5], estimate.upper, rtol=1e-12)
    assert state.largest is None
    assert not fleets.single


def test_a_larger_tube_in_the_file_is_refuted() -> None:
    design = designed(_body(False))
    assert verify(design).verdict == "proved"
    gains = {**design.gains, "state_tube": [10.0, 10.0]}
    assert verify(dataclasses.replace(design, gains=gains)).verdict == "refuted"
