"""Impulses right after the first sample, which an error of the state at first explains as well."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.exponential import expm
from obsdesign.runtime.impulsive_input.event import CONFUSED
from obsdesign.runtime.impulsive_input.integral.first_state import first_state
from tests.runtime.impulsive_input.test_window_noise import COLOURED, TIMES, run_of, track_of
from tests.systems.impulsive_input import events_of, observer_of, record, rows_from

CHAIN = (np.array([[-0.5, 0.0], [0.7, -0.86]]), np.array([[0.0, 1.0]]))
TURNING = (np.array([[-0.25, -0.94], [0.94, -0.35]]), np.array([[0.0, 1.0]]))
NOISE, PERIOD = 0.002, 0.1
WORDS = "an error of the state at first explains an impulse as well"


def rows_of_record(plant: Any, train: Any, **options: Any) -> tuple[list[Any], list[Any]]:
    A, C = plant
    body = {
        "flow": {"A": A.tolist()},
        "jump": {"H": [[1], [0]], "dwell_time": [8.0, math.inf]},
        "output": {"C": C.tolist(), "measured": "periodic", "period": PERIOD, "noise_std": [NOISE]},
        "observer": {"kind": "impulsive_input", "operator": "integral", **options},
    }
    t, rng = PERIOD * np.arange(260), np.random.default_rng(0)
    y = record(A, [[1.0], [0.0]], train, t, np.zeros(2)) @ C.T
    rows = rows_from(observer_of(body), t, y + NOISE * rng.standard_normal(y.shape))
    return rows, events_of(rows)


@pytest.mark.parametrize("plant", [CHAIN, TURNING], ids=["chain", "turning"])
@pytest.mark.parametrize("onset", [0.06, 0.33, 0.81])
def test_rows_have_a_doubt_where_an_impulse_is_no_other_than_an_unknown_state(
    plant: Any, onset: float
) -> None:
    rows, events = rows_of_record(plant, [(onset, 1.0), (onset + 12, 1.0)])
    doubted = [row.t for row in rows if CONFUSED in row.status]
    assert doubted[-1] >= onset or abs(events[0].t - onset) < 5 * events[0].t_std
    assert all(CONFUSED in event.status for event in events if event.t <= doubted[-1])
    assert not any(row.status.count(CONFUSED) > 1 for row in rows)
    assert doubted == [row.t for row in rows[: len(doubted)]]  # from the first row on, no gap
    assert {row.status for row in rows if doubted[-1] < row.t < 12} == {"ok"}


def test_no_row_has_it_where_the_state_is_known() -> None:
    rows, events = rows_of_record(CHAIN, [(0.33, 1.0), (12.3, 1.0)], initial_std=[1e-3, 1e-3])
    assert rows[0].status == "ok"
    assert abs(events[0].t - 0.33) < 5 * events[0].t_std
    assert not any(WORDS in row.status for row in rows)


@pytest.mark.parametrize("options", [{}, {"weighting": "plain"}])
def test_no_row_has_it_at_rest(options: dict[str, Any]) -> None:
    rows, events = rows_of_record(CHAIN, [(12.3, 1.0)], **options)
    assert len(events) == 1
    assert {row.status for row in rows} == {"ok", "unresolved"}


LEVEL = {"A": [[-1.14, 0.0], [0.64, 0.0]], "C": [[0.0, 1.0]], "period": 0.136, "dwell": 2.12}
RAIN = {
    "A": [[-2.0, 0.0, 0.0], [0.69, -0.73, 0.0], [1.31, 0.0, -0.11]],
    "C": [[0.0, 1.0, 1.0]], "period": 0.217, "dwell": 21.9,
}  # fmt: skip


@pytest.mark.parametrize(
    ("plant", "state"),
    [(LEVEL, [0.06, -0.17]), (RAIN, [0.05, 0.04, 0.11]), (RAIN, [0.0, 0.0, 0.0])],
    ids=["level", "rain", "rain at rest"],
)
def test_deviations_of_the_plain_norm_hold_what_is_left_of_the_state_at_first(
    plant: dict[str, Any], state: list[float]
) -> None:
    """The plain norm does not weigh that error; the deviations of its impulses do."""
    A, dwell, noise = np.array(plant["A"]), plant["dwell"], 0.0005
    H = np.eye(len(A))[:, :1]
    body = {
        "flow": {"A": plant["A"]}, "jump": {"H": H.tolist(), "dwell_time": [dwell, math.inf]},
        "output": {"C": plant["C"], "measured": "periodic", "period": plant["period"],
                   "noise_std": [noise]},
        "observer": {"kind": "impulsive_input", "operator": "integral", "weighting": "plain"},
    }  # fmt: skip
    train = [(1.53 * dwell, -1.6), (3.04 * dwell, -1.2), (4.57 * dwell, 0.9)]
    t, rng = np.arange(0, 7 * dwell, plant["period"]), np.random.default_rng(0)
    y = record(A, H, train, t, state) @ np.array(plant["C"]).T
    events = events_of(rows_from(observer_of(body), t, y + noise * rng.standard_normal(y.shape)))
    assert [event.status for event in events] == ["ok"] * len(train)
    for event, (moment, weight) in zip(events, train, strict=True):
        assert abs(event.t - moment) < 4 * event.t_std
        assert abs(event.weights[0] - weight) < 4 * event.weights_std[0]
    assert events[-1].weights_std[0] < 0.1


SPRING = {"A": [[0, 1], [-0.9, -0.4]], "H": [[0], [1]], "C": [[1, 0]]}
BIASED = {"A": [[-1, 0, 0], [1, -0.5, 0], [0, 0, 0]], "H": [[1], [0], [0]], "C": [[0, 1, 1]]}
FED = {"A": [[-1, 0, 1], [1, -0.5, 0], [0, 0, 0]], "H": [[1], [0], [0]], "C": [[0, 1, 0]]}


def sampled_record(
    plant: dict[str, Any], state: list[float], noise: float, missing: int = 0
) -> tuple[list[Any], Any, list[Any]]:
    """(rows, true states, events): impulses of 1 at t = 12.03 and 19.44, operator `samples`."""
    A, H, C = (np.array(plant[name], dtype=float) for name in "AHC")
    body = {
        "flow": {"A": A.tolist()}, "jump": {"H": H.tolist(), "dwell_time": [6, math.inf]},
        "output": {"C": C.tolist(), "measured": "periodic", "period": 0.1, "noise_std": [noise]},
        "observer": {"kind": "impulsive_input", "operator": "samples"},
    }  # fmt: skip
    t, rng = np.round(0.1 * np.arange(250), 1), np.random.default_rng(0)
    x = record(A, H, [(12.03, 1.0), (19.44, 1.0)], t, state)
    y = x @ C.T
    y = y + noise * rng.standard_normal(y.shape)
    y[1 : missing + 1] = np.nan
    rows = rows_from(observer_of(body), t, y)
    return rows, x, events_of(rows)


@pytest.mark.parametrize("missing", [0, 6])
@pytest.mark.parametrize(
    "state", [[0.0, 0.5], [-0.02, 0.5], [0.03, 0.5], [0.0, -0.5], [-0.5, 0.0]], ids=str
)
def test_a_record_that_begins_where_y_crosses_zero_begins_with_no_impulse(
    state: list[float], missing: int
) -> None:
    _, _, events = sampled_record(SPRING, state, 0.002, missing)
    sure = [event for event in events if abs(event.weights[0]) > 5 * event.weights_std[0]]
    assert [round(event.t) for event in sure] == [12, 19]
    assert all(abs(event.weights[0] - 1) < 4 * event.weights_std[0] for event in sure)


@pytest.mark.parametrize(
    ("plant", "state"),
    [(BIASED, [0.0, 0.0, 1.0]), (FED, [0.0, 0.0, 0.3]), (FED, [0.3, 0.6, 0.3])],
    ids=["bias", "feed", "steady feed"],
)
def test_a_state_that_no_impulse_reaches_is_not_taken_as_known(
    plant: dict[str, Any], state: list[float]
) -> None:
    rows, x, events = sampled_record(plant, state, 0.01)
    sure = [event for event in events if abs(event.weights[0]) > 5 * event.weights_std[0]]
    assert [(round(event.t), event.status) for event in sure] == [(12, "ok"), (19, "ok")]
    assert np.abs(rows[-1].x - x[-1]).max() < 0.05


ROTOR = {"A": [[-1.05, 0.0], [1.0, 0.0]], "C": [[0.0, 1.0]], "period": 0.035, "dwell": 3.2}


@pytest.mark.parametrize("weighting", ["gls", "plain"])
@pytest.mark.parametrize(("speed", "weight"), [(0.0, 0.08), (1.0, 0.08), (-1.0, 0.08), (1.0, 0.0)])
def test_a_weak_impulse_after_the_first_window_is_there_whatever_the_state_at_first(
    weighting: str, speed: float, weight: float
) -> None:
    """The first rows tell a state that is not known; the twin has no impulse, and none is made."""
    A, dwell, noise = np.array(ROTOR["A"]), ROTOR["dwell"], 0.02
    body = {
        "flow": {"A": ROTOR["A"]}, "jump": {"H": [[1], [0]], "dwell_time": [dwell, math.inf]},
        "output": {"C": ROTOR["C"], "measured": "periodic", "period": ROTOR["period"],
                   "noise_std": [noise]},
        "observer": {"kind": "impulsive_input", "operator": "integral", "weighting": weighting},
    }  # fmt: skip
    train = [(1.5 * dwell, weight), (3.2 * dwell, weight)] if weight else []
    t, rng = np.arange(0, 6 * dwell, ROTOR["period"]), np.random.default_rng(0)
    observer = observer_of(body)
    for _ in range(3):
        y = record(A, [[1.0], [0.0]], train, t, [speed, 0.0])[:, 1:]
        rows = rows_from(observer, t, y + noise * rng.standard_normal(y.shape))
        events = events_of(rows)
        assert len(events) == len(train)
        for event, (moment, _) in zip(events, train, strict=True):
            assert abs(event.t - moment) < 4 * event.t_std
            assert abs(event.weights[0] - weight) < 4 * event.weights_std[0]
        assert {row.status for row in rows if 0.8 * dwell < row.t < 3 * dwell} == {"ok"}


def test_the_state_at_first_is_fitted_to_samples_with_its_covariance() -> None:
    """Errors over many records, the estimate at the last row with its own sample taken in."""
    run, rng, row, noise = run_of(COLOURED), np.random.default_rng(0), 6, 0.1
    C, root, spread = run.gains.C, np.diag([2.0, 0.5, 1.0]), np.full((row, 2), noise)
    flows = expm(run.gains.A * TIMES[:, None, None])
    newer, errors, covariance = run.maps(TIMES[row] - TIMES[row - 1]).newer, [], np.eye(3)
    for _ in range(400):
        states = flows @ (root @ rng.standard_normal(3))
        y = states @ C.T + noise * rng.standard_normal((len(TIMES), 2))
        track = track_of(run, TIMES, np.zeros(3), y)
        fitted, covariance = first_state(run, track, row, spread, root)
        own = newer @ (y[row] - states[row] @ C.T)  # the next window counts it
        errors.append(fitted[-1] - states[row] - own)
    white = np.linalg.solve(np.linalg.cholesky(covariance), np.transpose(errors))
    assert np.cov(white) == pytest.approx(np.eye(3), abs=0.25)
