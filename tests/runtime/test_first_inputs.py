"""A known input acts from the time of `init` on: a first sample that states it later is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.interval.fleet import Fleet
from tests.systems.designs import designed

_BOX = {"lower": [0.0, 0.0], "upper": [1.0, 1.0]}
_FLOW: dict[str, Any] = {"A": [[-1.0, 0.0], [0.5, -2.0]], "B": [[3.0], [0.0]]}
_BOUNDED = {"disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]}}
_NOISY = {"C": [[0.0, 1.0]], "noise_bound": [5.0]}
_SAMPLED = {"C": [[0.0, 1.0]], "measured": "periodic", "period": 0.25}
BODIES: dict[str, dict[str, Any]] = {
    "interval": {"flow": _FLOW | _BOUNDED, "output": _NOISY},
    "set_membership": {"flow": _FLOW | _BOUNDED, "output": _NOISY, "window": 4},
    "luenberger": {"flow": _FLOW, "output": {"C": [[0.0, 1.0]]}},
    "finite_time": {"flow": _FLOW, "output": _SAMPLED, "window": 1.0},
    "unknown_input": {
        "flow": _FLOW | {"D": [[0.0], [1.0]]}, "output": {"C": [[1.0, 0.0], [0.0, 1.0]]},
    },
}  # fmt: skip
GIVING_BOUNDS = ["interval", "set_membership"]


def observer_of(kind: str, *, has_input: bool = True) -> Any:
    body = BODIES[kind]
    flow = body["flow"] if has_input else {k: v for k, v in body["flow"].items() if k != "B"}
    options = {"kind": kind} | {k: body[k] for k in body.keys() & {"window"}}
    kept = {"flow": flow, "output": body["output"], "observer": options}
    return from_design(designed(kept, allow_undecided=True))


def begun(observer: Any, kind: str) -> Any:
    return observer.init(0.0, **(_BOX if kind in GIVING_BOUNDS else {"x": [0.5, 0.5]}))


@pytest.mark.parametrize("kind", BODIES)
def test_an_input_since_init_must_be_known(kind: str) -> None:
    observer = observer_of(kind)
    y = np.zeros(int(observer.reads["y"]))
    for measured in (y, None):
        with pytest.raises(ValueError, match=r"u must be stated from the time of init, 0\.0, on"):
            observer.step(begun(observer, kind), Sample(0.5, measured, u=[5.0]))
    state, _ = observer.step(begun(observer, kind), Sample(0.0, u=[5.0]))
    observer.step(state, Sample(0.5))  # holds until a sample changes it


@pytest.mark.parametrize("kind", BODIES)
def test_an_input_that_nobody_states_is_zero(kind: str) -> None:
    observer = observer_of(kind)
    t, y = [0.0, 0.25, 0.5], np.zeros((3, int(observer.reads["y"])))
    initial = _BOX if kind in GIVING_BOUNDS else {"x": [0.5, 0.5]}
    silent = observer.run_batch(t, y, **initial)
    stated = observer.run_batch(t, y, u=np.zeros((3, 1)), **initial)
    for one, two in ((silent.x, stated.x), (silent.lower, stated.lower)):
        assert (one is None) == (two is None)
        assert one is None or np.array_equal(one, two, equal_nan=True)


@pytest.mark.parametrize("kind", BODIES)
def test_without_inputs_the_first_sample_may_come_later(kind: str) -> None:
    observer = observer_of(kind, has_input=False)
    observer.step(begun(observer, kind), Sample(0.5))


@pytest.mark.parametrize("kind", GIVING_BOUNDS)
def test_bounds_hold_between_init_and_the_second_sample(kind: str) -> None:
    """x1' = -x1 + 15 from 0.5 on: at t = 0.5 it is far from where u = 0 leaves it."""
    observer = observer_of(kind)
    state, _ = observer.step(begun(observer, kind), Sample(0.0, u=[5.0]))
    _, row = observer.step(state, Sample(0.5))
    truth = 15.0 + (0.5 - 15.0) * np.exp(-0.5)
    assert row.lower[0] <= truth <= row.upper[0]
    assert row.lower[0] > 5.0


@pytest.mark.parametrize("plants", [2, 9])
def test_inputs_of_a_fleet_since_init_must_be_known(plants: int) -> None:
    fleet, y = Fleet((observer_of("interval"),) * plants), np.zeros((1, plants))
    u = np.full((1, plants), 5.0)
    state = fleet.init(0.0, **_BOX)
    with pytest.raises(ValueError, match=r"u must be stated from the time of init, 0\.0, on"):
        fleet.step(state, 0.5, y, u=u)
    state, _ = fleet.step(state, 0.0, y, u=u)
    state = fleet.reset(state, 1, **_BOX)  # inputs are kept
    _, row = fleet.step(state, 0.5, y)
    truth = 15.0 + (0.5 - 15.0) * np.exp(-0.5)
    for i in range(plants):
        own = row.plant(i)
        assert own.lower[0] <= truth <= own.upper[0]
