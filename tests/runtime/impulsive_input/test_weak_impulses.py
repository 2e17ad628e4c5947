"""Impulses hardly larger than the noise, operator `samples`: deviations cover where they may be."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.equations.impulsive_input.expectations import expectations
from obsdesign.equations.impulsive_input.gains import IntegralGains
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.impulsive_input.event import FAINT, Event
from obsdesign.runtime.impulsive_input.history import History
from obsdesign.runtime.impulsive_input.samples.engine import SamplesEngine
from obsdesign.runtime.impulsive_input.samples.refit import EARLIER
from obsdesign.runtime.impulsive_input.samples.uncertain_state import UNCERTAIN
from tests.systems.designs import designed
from tests.systems.impulsive_input import events_of, record, rows_from

CHAIN = ([[-1.0, 0.0, 0.0], [1.0, -0.4, 0.0], [0.0, 0.4, -0.05]], [[0.0, 0.0, 1.0]])
# an integrator before the output
STORE = ([[-0.8, 0.0, 0.0], [0.8, -0.3, 0.0], [0.0, 0.3, 0.0]], [[0.0, 0.0, 1.0]])
OSCILLATOR = ([[0.0, 1.0, 0.0], [-1.0, -0.3, 0.0], [0.0, 1.0, -0.1]], [[1.0, 0.0, 1.0]])


def errors(
    plant: tuple[list[list[float]], list[list[float]]],
    weights: tuple[float, float],
    dwell: float,
    window: float,
    seed: int,
) -> tuple[list[tuple[float, Event]], int]:
    """(error of time, event) for each impulse that has one, and how many impulses there were."""
    A, C = plant
    H, rng = [[1.0], [0.0], [0.0]], np.random.default_rng(seed)
    body = {
        "flow": {"A": A}, "jump": {"H": H, "dwell_time": [dwell, "inf"]},
        "output": {"C": C, "measured": "periodic", "period": 0.5, "noise_std": [0.02]},
        "observer": {"kind": "impulsive_input", "operator": "samples", "window": window},
    }  # fmt: skip
    observer = from_design(designed(body))
    onsets = dwell * (0.5 + np.arange(1, 41)) * 1.3 + rng.uniform(0, 0.25 * dwell, 40)
    sizes = rng.choice([-1, 1], 40) * rng.uniform(*weights, 40)
    t = 0.5 * np.arange(int(2 * (onsets[-1] + 2 * dwell)))
    trains: Sequence[Any] = list(zip(onsets, sizes, strict=True))
    y = record(A, H, trains, t, [0.0] * 3) @ np.transpose(C)
    events = observer.run_batch(t, y + 0.02 * rng.standard_normal(y.shape), x=np.zeros(3)).events
    close = [
        (event.t - onset, event)
        for onset in onsets
        for event in events
        if abs(event.t - onset) < 0.5 * dwell
    ]
    return close, len(onsets)


WEAK = (0.06, 0.2)  # noise: 0.02


@pytest.mark.parametrize(
    ("plant", "weights", "dwell", "window"),
    [(CHAIN, WEAK, 20, 3), (STORE, WEAK, 20, 3), (STORE, (0.5, 1), 10, 3),
     (OSCILLATOR, WEAK, 10, 3)],
)  # fmt: skip
def test_times_of_weak_impulses_lie_within_their_deviations(
    plant: Any, weights: Any, dwell: float, window: float
) -> None:
    events, count = errors(plant, weights, dwell, window, seed=0)
    scores = np.array(
        [error / event.t_std for error, event in events if event.status in ("ok", UNCERTAIN)]
    )
    assert len(scores) > 0.6 * count
    assert np.sqrt((scores**2).mean()) < 1.2
    assert np.abs(scores).max() < 4


def test_an_impulse_that_may_have_come_before_all_samples_compared_has_a_doubt() -> None:
    weak, _ = errors(STORE, WEAK, 10, 8, seed=0)
    assert sum(EARLIER in event.status for _, event in weak) >= 5
    scores = [abs(error) / event.t_std for error, event in weak if event.status == "ok"]
    assert len(scores) > 20
    assert max(scores) < 4
    strong, count = errors(STORE, (0.5, 1.0), 10, 8, seed=0)
    assert [event.status for _, event in strong] == ["ok"] * count
    # the twin: longer dwell times leave more samples to compare
    rare, count = errors(STORE, WEAK, 20, 8, seed=0)
    assert len(rare) == count
    assert {event.status for _, event in rare} <= {"ok", UNCERTAIN}


@pytest.mark.parametrize(("deviation", "is_doubted"), [(0.0, False), (0.3, True)])
def test_an_impulse_found_late_hides_no_earlier_onset(deviation: float, is_doubted: bool) -> None:
    """The one before may have come earlier, by its deviation: so may this one."""
    gains = SimpleNamespace(shortest_dwell=1.0, window=0.5)
    live = SimpleNamespace(first=0.0, history=History(t=4.5, t_std=deviation))
    refit = SimpleNamespace(start=SimpleNamespace(row=SimpleNamespace(t=5.2)), may_be_earlier=True)
    engine: Any = SimpleNamespace(gains=gains)
    doubts = SamplesEngine._doubts(engine, live, refit)  # type: ignore[arg-type]
    assert doubts == ([EARLIER] if is_doubted else [])


@pytest.mark.parametrize("step", [1e-12, 1e-4, 1e-3])
def test_rows_far_closer_together_than_the_period(step: float) -> None:
    """An onset on a grid as coarse as the period lies behind all of them."""
    body = {
        "flow": {"A": [[0.001]]}, "jump": {"H": [[1.0]], "dwell_time": [3.0, "inf"]},
        "output": {"C": [[-0.24]], "noise_std": [0.02], "measured": "periodic", "period": 0.2},
        "observer": {"kind": "impulsive_input"},
    }  # fmt: skip
    observer = from_design(designed(body))
    y = -0.24 + 0.02 * np.random.default_rng(0).standard_normal(60)
    y[35:] -= 0.3  # an impulse
    rows = [Sample(k * step, np.array([value])) for k, value in enumerate(y)]
    listed = list(observer.run(observer.start(0.0, [0.1]), rows))
    assert len(listed) == 60
    assert "ok" not in {each.status for each in listed if not np.isfinite(each.x).all()}


ROTOR = {"A": [[-1.05, 0], [1, 0]], "dwell": 3.2, "period": 0.035, "noise": 0.07}
CLOSE = [-4.8, -5.2, -5.5, -5.9, -6.3, -6.6, -7.0, -7.4]  # as the design chooses them


@pytest.mark.parametrize("weighting", ["gls", "plain"])
@pytest.mark.parametrize("weight", [0.3, 0.0])
def test_impulses_that_the_largest_deviation_of_features_covers_are_evaluated(
    weighting: str, weight: float
) -> None:
    """Rule `peak`: |R| of ten deviations of the impulse is six of its worst direction."""
    A, H, dwell, noise = np.array(ROTOR["A"]), [[1.0], [0]], ROTOR["dwell"], ROTOR["noise"]
    design = designed({
        "flow": {"A": A.tolist()}, "jump": {"H": H, "dwell_time": [dwell, "inf"]},
        "output": {"C": [[0, 1]], "measured": "periodic", "period": ROTOR["period"],
                   "noise_std": [noise]},
        "observer": {"kind": "impulsive_input", "operator": "integral", "exponents": CLOSE,
                     "weighting": weighting},
    })  # fmt: skip
    assert design.gains["rule"] == "peak"
    rng = np.random.default_rng(0)
    moments = dwell * (1.3 + np.cumsum(rng.uniform(1.2, 1.7, 6)))
    train = [(float(at), weight * (-1) ** k) for k, at in enumerate(moments)]
    t = np.arange(0, moments[-1] + 2 * dwell, ROTOR["period"])
    y = record(A, H, train, t, np.zeros(2))[:, 1:] + noise * rng.standard_normal((len(t), 1))
    events = events_of(rows_from(from_design(design), t, y))
    assert len(events) == (len(train) if weight else 0)
    assert {event.status for event in events} <= {"ok", *([FAINT] if weighting == "plain" else [])}
    for event, (moment, size) in zip(events, train, strict=False):
        assert abs(event.t - moment) < 4 * event.t_std
        assert abs(event.weights[0] - size) < 4 * event.weights_std[0]


@pytest.mark.parametrize("weight", [0.8, 1.3, 2.4])
def test_an_impulse_far_above_the_threshold_is_evaluated_once_it_is_old_enough(
    weight: float,
) -> None:
    """It is above it while it is younger than the margin by a part of a period."""
    A, H, dwell, noise = np.array([[-2.46, 0], [2.46, -0.25]]), [[1.0], [0]], 11.3, 0.012
    design = designed({
        "flow": {"A": A.tolist()}, "jump": {"H": H, "dwell_time": [dwell, "inf"]},
        "output": {"C": [[0, 1]], "measured": "periodic", "period": 0.119, "noise_std": [noise]},
        "observer": {"kind": "impulsive_input", "operator": "integral", "smallest_weight": 0.56},
    })  # fmt: skip
    rng = np.random.default_rng(0)
    moments = dwell * (1.3 + np.cumsum(rng.uniform(1.2, 1.7, 6)))
    t = np.arange(0, moments[-1] + 2 * dwell, 0.119)
    y = record(A, H, [(float(at), weight) for at in moments], t, np.zeros(2))[:, 1:]
    y = y + noise * rng.standard_normal(y.shape)
    events = events_of(rows_from(from_design(design), t, y))
    assert [event.status for event in events] == ["ok"] * len(moments)
    for event, moment in zip(events, moments, strict=True):
        assert abs(event.t - moment) < 4 * event.t_std
        assert abs(event.weights[0] - weight) < 4 * event.weights_std[0]


MOTOR = ([[-0.76, -0.123], [1.0, 0.0]], [[1.0], [0.0]], [[0.0, 1.0]])


@pytest.mark.parametrize("weight", [0.04, 0.4])
def test_an_impulse_that_may_be_younger_than_the_margin_is_dated_where_it_is_older(
    weight: float,
) -> None:
    """Noise makes the maximum of |R| too early; a posterior cut off there is far too narrow."""
    (A, H, C), dwell, noise, period = MOTOR, 14.2, 0.018, 0.096
    design = obsdesign.design(obsdesign.Problem.from_dict({
        "flow": {"A": A}, "jump": {"H": H, "dwell_time": [dwell, "inf"]},
        "output": {"C": C, "measured": "periodic", "period": period, "noise_std": [noise]},
        "observer": {"kind": "impulsive_input", "operator": "integral"},
    }))  # fmt: skip
    assert design.gains["rule"] == "peak"
    rng = np.random.default_rng(0)
    moments = dwell * (1.3 + np.cumsum(rng.uniform(1.2, 1.7, 50)))
    train = [(float(at), weight * (-1) ** k) for k, at in enumerate(moments)]
    t = period * np.arange(int((moments[-1] + 2 * dwell) / period))
    y = record(np.array(A), H, train, t, np.zeros(2)) @ np.transpose(C)
    y = y + noise * rng.standard_normal(y.shape)
    events = events_of(rows_from(from_design(design), t, y))
    assert [event.status for event in events] == ["ok"] * len(train)
    scores = [(event.t - at) / event.t_std for event, at in zip(events, moments, strict=True)]
    assert np.abs(scores).max() < 4
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.2


ROD = [[-1.01, 0.81, 0.0], [0.81, -1.7, 0.88], [0.0, 0.88, -1.18]]


@pytest.mark.parametrize(("deviations", "least", "most"), [(3.0, 0.0, 0.8), (6.0, 1.0, 1.0)])
def test_what_a_short_window_shows_is_in_deviations_that_the_design_foresees(
    deviations: float, least: float, most: float
) -> None:
    """A stated K and a window of a third of the dwell time, which holds a part of what rows do."""
    A, dwell, noise, period = np.array(ROD), 16.7, 0.001, 0.117
    design = obsdesign.design(obsdesign.Problem.from_dict({
        "flow": {"A": ROD}, "jump": {"H": [[1], [0], [0]], "dwell_time": [dwell, "inf"]},
        "output": {"C": [[0, 0, 1]], "measured": "periodic", "period": period,
                   "noise_std": [noise]},
        "observer": {"kind": "impulsive_input", "operator": "integral", "window": 5.7,
                     "gains": {"K": [[0.3], [0.6], [0.5]]}},
    }))  # fmt: skip
    gains = IntegralGains.from_document(design.gains)
    foreseen = expectations(gains.A - gains.K @ gains.C, gains).deviations["weight_std"]
    rng = np.random.default_rng(0)
    moments = dwell * (1.3 + np.cumsum(rng.uniform(1.2, 1.7, 25)))
    train = [(float(at), deviations * foreseen * (-1) ** k) for k, at in enumerate(moments)]
    t = period * np.arange(int((moments[-1] + 2 * dwell) / period))
    y = record(A, [[1.0], [0], [0]], train, t, np.zeros(3))[:, 2:]
    events = events_of(rows_from(from_design(design), t, y + noise * rng.standard_normal(y.shape)))
    near = [min(abs(event.t - at) for event in events) < 0.3 * dwell for at in moments]
    assert least <= np.mean(near) <= most
    assert all(np.abs(moments - event.t).min() < 0.3 * dwell for event in events)
