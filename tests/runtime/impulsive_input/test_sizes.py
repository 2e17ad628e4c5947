"""Units far from one, and numbers that floats cannot square: the same answer, or a line."""

from __future__ import annotations

import copy
import warnings
from typing import Any

import numpy as np
import pytest

import obsdesign
from tests.systems.impulsive_input import CHAIN, observer_of, record

TRAIN = [(20.03, 1.0), (50.06, 2.0), (80.08, -3.0)]


@pytest.fixture(autouse=True)
def no_warnings() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def changed(block: str, name: str, value: Any, noise: float = 0.0) -> dict[str, Any]:
    body = copy.deepcopy(CHAIN)
    body["output"] |= {"period": 0.1, "noise_std": [noise]}
    body[block] |= {name: value}
    return body


@pytest.mark.parametrize("sizes", [(1e-8, 1.0, 1e8), (1e-12, 1.0, 1e12), (1e3, 1e-5, 1e2)])
def test_units_of_the_states_do_not_matter(sizes: tuple[float, ...]) -> None:
    S, back = np.diag(sizes), np.diag(1 / np.array(sizes))
    A, H, C = (np.array(CHAIN[b][k]) for b, k in (("flow", "A"), ("jump", "H"), ("output", "C")))
    body = changed("flow", "A", (S @ A @ back).tolist())
    body["jump"]["H"], body["output"]["C"] = (S @ H).tolist(), (C @ back).tolist()
    observer, t = observer_of(body), 0.1 * np.arange(1200)
    x = record(A, H, TRAIN, t, np.zeros(3))
    batch = observer.run_batch(t, x @ C.T)
    for event, (onset, weight) in zip(batch.events, TRAIN, strict=True):
        assert event.status == "ok"
        assert event.t == pytest.approx(onset, abs=1e-4)
        assert event.weights[0] == pytest.approx(weight, abs=1e-4)
    assert batch.x is not None
    # the last window is not decided
    np.testing.assert_allclose(batch.x[:990] @ back, x[:990], atol=1e-2)


def in_units(weighting: str, y: float, time: float) -> Any:
    """The observer of a chain whose y and time are measured in other units."""
    body = copy.deepcopy(CHAIN)
    body["flow"]["A"] = (np.array(CHAIN["flow"]["A"]) / time).tolist()
    body["jump"]["dwell_time"] = [25 * time, "inf"]
    body["output"] |= {"C": [[0, 0, y]], "noise_std": [0.3 * y], "period": 0.1 * time}
    body["observer"] |= {
        "operator": "integral", "weighting": weighting, "window": 20 * time, "margin": 5 * time,
        "exponents": [-0.65 / time, -0.75 / time, -0.85 / time],
        "gains": {"K": (np.array([[2e-4], [4.8e-3], [2e-2]]) / y / time).tolist()},
    }  # fmt: skip
    return observer_of(body)


def pulses(weighting: str, y: float = 1.0, time: float = 1.0) -> tuple[Any, Any]:
    """(t, weight, their deviations) of every impulse in the units of the chain, and the states."""
    t = 0.1 * np.arange(1200)
    states = record(CHAIN["flow"]["A"], CHAIN["jump"]["H"], TRAIN, t, np.zeros(3))
    noise = 0.3 * np.random.default_rng(5).standard_normal((len(t), 1))
    batch = in_units(weighting, y, time).run_batch(t * time, y * (states[:, 2:] + noise))
    events = [
        (e.t / time, e.weights[0], e.t_std / time, e.weights_std[0], e.status) for e in batch.events
    ]
    return events, batch.x


@pytest.mark.parametrize("weighting", ["gls", "plain"])
def test_units_of_y_that_are_powers_of_two_change_no_bit(weighting: str) -> None:
    events, states = pulses(weighting)
    assert [round(event[0] / 30) for event in events] == [1, 2, 3]
    for power in (-60, -43, -7, 1, 20, 37, 43, 50, 60):
        other, their_states = pulses(weighting, y=2.0**power)
        assert other == events, power
        np.testing.assert_array_equal(their_states, states)


@pytest.mark.parametrize("weighting", ["gls", "plain"])
@pytest.mark.parametrize(("y", "time"), [(1e13, 1.0), (1e50, 1.0), (1.0, 1e12), (1e-9, 1e-15)])
def test_units_of_y_and_time_do_not_matter(weighting: str, y: float, time: float) -> None:
    events, states = pulses(weighting)
    other, their_states = pulses(weighting, y, time)
    assert [event[-1] for event in other] == [event[-1] for event in events]
    numbers, theirs = (np.array([event[:-1] for event in found]) for found in (events, other))
    np.testing.assert_allclose(theirs, numbers, rtol=1e-6)
    np.testing.assert_allclose(their_states, states, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    ("block", "name", "value", "line"),
    [
        ("output", "noise_std", [1e120], "output.noise_std must be 0, or between 1e-100 and 1e\\+100"),
        ("output", "noise_std", [1e-120], "output.noise_std must be 0, or between"),
        ("output", "C", [[0, 0, 1e120]], "output.C must be at most 1e\\+100 in size"),
        ("flow", "A", [[-0.08, 0, 0], [1e80, -0.15, 0], [0, 1e80, -0.2]], "are the units of flow.A and output.C what they should be"),
        ("output", "C", [[0, 0, 1e-99]], "output.C must be 0, or at least 1e-70 in size"),
        ("jump", "H", [[1e120], [0], [0]], "jump.H must be at most 1e\\+100 in size"),
    ],
)  # fmt: skip
def test_what_floats_cannot_follow_is_refused(block: str, name: str, value: Any, line: str) -> None:
    with pytest.raises(obsdesign.InputError, match=line):
        obsdesign.investigate(obsdesign.Problem.from_dict(changed(block, name, value)))


@pytest.mark.parametrize("noise", [0.0, 3.0])
@pytest.mark.parametrize("outlier", [1e6, 1e30, 1e99])
def test_an_outlier_leaves_every_row_finite(noise: float, outlier: float) -> None:
    observer, t = (
        observer_of(changed("jump", "dwell_time", [25, "inf"], noise)),
        0.1 * np.arange(900),
    )
    y = np.ones((900, 1))
    y[500] = outlier
    batch = observer.run_batch(t, y)
    assert batch.x is not None
    assert np.isfinite(batch.x).all()
    near = [status for status, at in zip(batch.status, t, strict=True) if 48 < at < 50]
    assert all(status != "ok" for status in near)


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_a_number_that_cannot_be_squared_is_refused(noise: float) -> None:
    observer = observer_of(changed("jump", "dwell_time", [25, "inf"], noise))
    t, y = 0.1 * np.arange(10), np.ones((10, 1))
    y[4] = -1e300
    with pytest.raises(obsdesign.InputError, match=r"y1 must be at most 1e.100 in size.*t = 0.4"):
        observer.run_batch(t, y)
    with pytest.raises(obsdesign.InputError, match=r"x2 must be at most 1e.100 in size"):
        observer.init(0.0, x=[0.0, 1e300, 0.0])
    with pytest.raises(ValueError, match="x must be finite"):
        observer.init(0.0, x=[0.0, np.nan, 0.0])
