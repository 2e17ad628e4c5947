"""Known inputs beyond the bounds that effects of parameters count on: a status, bounds that hold."""

from __future__ import annotations

import copy
import dataclasses
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import obsdesign
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.columns import Batch
from obsdesign.runtime.interval.fleet import Fleet
from obsdesign.runtime.known_inputs import LARGE_U, LARGE_W
from tests.systems.designs import designed

_STEP = 0.1
# rows in which the input is beyond its bound of 1
_LARGE = slice(20, 40)
_BODY: dict[str, Any] = {
    "flow": {"A": [[-1, 0], [1, -2]], "B": [[0.5], [0]], "input_bound": [1],
             "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]}},
    "output": {"C": [[0, 1]], "noise_bound": [5]},
    "parameter": [{"name": "effect", "range": [-0.5, 0.5], "B": [[1], [0]]}],
    "observer": {"kind": "interval", "gains": {"L": [[0], [0]]}},
}  # fmt: skip
_JUMP = {"G": [[0.5, 0], [0, 0.5]], "E": [[0.2], [0]], "dwell_time": [0.5, 2],
         "input_bound": [1], "disturbance": {"lower": [0, 0], "upper": [0, 0]}}  # fmt: skip


def _body(kind: str, box: str, jumps: bool = False) -> dict[str, Any]:
    """Input and jump of an uncertain effect; the box stated, or proved."""
    body = copy.deepcopy(_BODY)
    if jumps:
        body["jump"] = copy.deepcopy(_JUMP)
        body["observer"]["gains"]["M"] = [[0], [0]]
        body["parameter"].append({"name": "kick", "range": [-0.5, 0.5], "E": [[1], [0]]})
    if box == "stated":
        body["state"] = {"lower": [-2, -2], "upper": [2, 2]}
    if kind == "set_membership":
        body["observer"] = {"kind": kind, "window": 3}
    if kind == "luenberger":
        body["observer"] = {"kind": kind}
    return body


@cache
def _observer(kind: str, box: str, jumps: bool = False) -> Any:
    design = designed(_body(kind, box, jumps))
    return from_design(design)


def _course(size: float, jumps: bool = False) -> tuple[Any, ...]:
    """(t, y, u, w, jump, x): the largest effects on inputs of that size in some of the rows."""
    rows = 100
    u, w = np.ones((rows, 1)), np.ones((rows, 1))
    (w if jumps else u)[_LARGE] = size
    jump = jumps & (np.arange(rows) % 10 == 9)
    x, t = np.zeros((rows, 2)), _STEP * np.arange(rows)
    A = np.array([[-1, 0], [1, -2]])
    for k in range(1, rows):
        b = np.array([u[k - 1, 0] + 0.1, 0.1])
        x[k] = (scipy.linalg.expm(_STEP * np.block([[A, b[:, None]], [np.zeros((1, 3))]]))
                @ np.append(x[k - 1], 1))[:2]  # fmt: skip
        if jump[k]:
            x[k] = 0.5 * x[k] + np.array([0.7 * w[k, 0], 0])
    return t, x[:, 1:], u, w, jump, x


def _run(observer: Any, course: tuple[Any, ...], jumps: bool = False) -> Batch:
    t, y, u, w, jump, _ = course
    more = {"w": w, "jump": jump} if jumps else {}
    batch: Batch = observer.run_batch(
        t, y, u=u, lower=[-0.1, -0.1], upper=[0.1, 0.1], **more)  # fmt: skip
    return batch


def _beyond(batch: Batch, x: Any) -> float:
    return float(np.maximum(batch.lower - x, x - batch.upper).max())


_CASES = [(kind, box) for kind in ("interval", "set_membership") for box in ("stated", "proved")]


@pytest.mark.parametrize("jumps", [False, True])
@pytest.mark.parametrize(("kind", "box"), _CASES)
def test_bounds_hold_beyond_the_bound_of_an_input(kind: str, box: str, jumps: bool) -> None:
    """In a status, and until the box counts again; within the bound every row is as before."""
    observer, reason = _observer(kind, box, jumps), LARGE_W if jumps else LARGE_U
    course = _course(6.0, jumps)
    batch = _run(observer, course, jumps)
    assert _beyond(batch, course[-1]) <= 1e-6
    large = [k for k, status in enumerate(batch.status) if status != "ok"]
    assert large == ([29, 39] if jumps else list(range(21, 41)))
    assert {batch.status[k] for k in large} == {reason}
    kept = _course(1.0, jumps)
    within = _run(observer, kept, jumps)
    assert set(within.status) == {"ok"}
    assert _beyond(within, kept[-1]) <= 1e-6
    # the box counts again at the end: as narrow as if nothing had been
    ends = [(each.upper - each.lower)[-1] for each in (batch, within)]
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.02)


@pytest.mark.parametrize(("kind", "box"), _CASES)
def test_without_a_bound_the_same_input_leaves_the_bounds(kind: str, box: str) -> None:
    """The twin: a design that does not know of the bound counts on the box in vain."""
    observer = _observer(kind, box)
    gains = {**observer.gains.to_document()}
    del gains["input_bound"]
    course = _course(6.0)
    batch = _run(type(observer).from_gains(gains), course)
    assert set(batch.status[:25]) == {"ok"}
    assert _beyond(batch, course[-1]) > 0.1


def test_steps_batches_and_fleets_agree() -> None:
    observer = _observer("interval", "stated")
    t, y, u, _, _, _ = course = _course(6.0)
    batch, fleet = _run(observer, course), Fleet((observer,) * 12)
    state = observer.init(0.0, lower=[-0.1, -0.1], upper=[0.1, 0.1])
    fleets = fleet.init(0.0, lower=[-0.1, -0.1], upper=[0.1, 0.1])
    for k, time in enumerate(t.tolist()):
        state, estimate = observer.step(state, Sample(time, y[k], u[k]))
        fleets, together = fleet.step(fleets, time, y[k], u=u[k])
        np.testing.assert_array_equal(batch.upper[k], estimate.upper)
        assert batch.status[k] == estimate.status
        np.testing.assert_allclose(together.upper[:, 5], estimate.upper, rtol=1e-12)
        assert together.plant(5).status == estimate.status
    assert state.largest is None
    assert not fleets.single


@pytest.mark.parametrize("kind", ["interval", "set_membership"])
def test_reset_makes_a_stated_box_count_again(kind: str) -> None:
    observer = _observer(kind, "stated")
    state = observer.init(0.0, lower=[-1, -1], upper=[1, 1])
    for k in range(30):
        state, _ = observer.step(state, Sample(_STEP * k, None, [50.0]))
    state = state._replace(u=np.zeros(1))
    following, estimate = observer.step(state, Sample(3.0, None, [0.0]))
    assert (estimate.upper > 2).any()
    following = observer.reset(following, lower=[-1, -1], upper=[1, 1])
    assert following.largest is None


@pytest.mark.parametrize(("kind", "box"), _CASES)
@pytest.mark.parametrize("entry", ["input_bound", "jump_input_bound"])
def test_a_design_holds_the_bounds_of_its_problem(kind: str, box: str, entry: str) -> None:
    design = designed(_body(kind, box, jumps=True))
    assert obsdesign.verify(design).verdict == "proved"
    forged = {**design.gains, entry: 10 * np.array(design.gains[entry])}
    assert obsdesign.verify(dataclasses.replace(design, gains=forged)).verdict == "refuted"


@pytest.mark.parametrize("kind", ["interval", "set_membership"])
def test_an_input_that_should_be_zero_has_its_effect(kind: str) -> None:
    """Its effect within the bound is zero: a direction that is there all the same."""
    body = _body(kind, "stated")
    body["flow"]["input_bound"] = [0]
    observer = from_design(designed(body))
    course = _course(1.0)
    batch = _run(observer, course)
    assert _beyond(batch, course[-1]) <= 1e-6
    assert set(batch.status[1:]) == {LARGE_U}


@pytest.mark.parametrize("kind", ["interval", "set_membership", "luenberger"])
@pytest.mark.parametrize("size", [0.9, 5.0])
def test_an_input_that_is_held_is_beyond_its_bound_in_every_row(kind: str, size: float) -> None:
    """Stated once, it drives all rows that follow; a smaller one has no status."""
    observer = _observer(kind, "stated")
    state = observer.start(0.0, [0.0, 0.0] if kind == "luenberger" else [-1.0, 1.0, -1.0, 1.0])
    statuses = []
    for k in range(6):
        sample = Sample(_STEP * k, np.zeros(1), u={0: [0.0], 1: [size]}.get(k))
        state, estimate = observer.step(state, sample)
        statuses.append(estimate.status)
    large = [str(LARGE_U) in status for status in statuses]
    assert large == [False, False, *([size > 1] * 4)]
