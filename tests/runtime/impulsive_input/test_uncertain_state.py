"""Windows that show an impulse and not its weight: rows of such a state are doubtful."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from obsdesign.runtime import from_design
from obsdesign.runtime.impulsive_input.event import Event
from obsdesign.runtime.impulsive_input.history import History
from obsdesign.runtime.impulsive_input.samples.filter import Filtered, Row
from obsdesign.runtime.impulsive_input.samples.uncertain_state import UNCERTAIN, UncertainState
from obsdesign.runtime.impulsive_input.significance import (
    LEAST_WEIGHT_DEVIATIONS,
    is_weight_significant,
)
from tests.systems.designs import designed
from tests.systems.impulsive_input import record

PERIOD, NOISE, ONSET = 0.03, 1e-3, 10.0
RATES = {3: [1.0, 1.4, 0.9], 4: [1.0, 1.4, 0.9, 1.1]}


def body(states: int, samples: int) -> dict[str, Any]:
    rates = RATES[states]
    return {
        "flow": {"A": (np.diag([-rate for rate in rates]) + np.diag(rates[:-1], -1)).tolist()},
        "jump": {"H": np.eye(states)[:, :1].tolist(), "dwell_time": [3.2, "inf"]},
        "output": {
            "C": np.eye(states)[-1:].tolist(), "measured": "periodic", "period": PERIOD,
            "noise_std": [NOISE],
        },
        "observer": {"kind": "impulsive_input", "operator": "samples", "window": samples * PERIOD},
    }  # fmt: skip


@cache
def run(states: int, samples: int, weight: float) -> tuple[Any, Any, Any]:
    """Times, errors of the state and the batch of an impulse at ONSET."""
    problem = body(states, samples)
    A, H = np.array(problem["flow"]["A"]), problem["jump"]["H"]
    t = PERIOD * np.arange(600)
    x = record(A, H, [(ONSET, weight)], t, np.zeros(states))
    y = x[:, -1:] + NOISE * np.random.default_rng(1).standard_normal((len(t), 1))
    observer: Any = from_design(designed(problem))
    batch = observer.run_batch(t, y)
    return t, np.abs(batch.x - x).max(axis=1), batch


@pytest.mark.parametrize(("states", "weight"), [(3, 0.3), (4, 1.0), (4, 0.1)])
def test_rows_after_a_weight_that_is_hardly_known_are_doubtful(states: int, weight: float) -> None:
    t, error, batch = run(states, 4, weight)
    (event,) = [event for event in batch.events if abs(event.t - ONSET) < 1]
    assert UNCERTAIN in event.status
    assert event.weights_std[0] > weight
    later = t > ONSET + 1
    is_ok = np.array(batch.status) == "ok"
    doubtful = np.array([UNCERTAIN in status for status in batch.status])
    assert error[doubtful].max() > weight
    assert error[later & is_ok].max() < 0.05 * weight
    # the doubt ends: samples have shown the state
    assert doubtful.sum() < 160
    assert is_ok[-50:-5].all()


@pytest.mark.parametrize("states", [3, 4])
def test_a_window_that_shows_the_weight_leaves_no_doubt(states: int) -> None:
    t, error, batch = run(states, 64, 1.0)
    (event,) = batch.events
    assert event.status == "ok"
    assert abs(event.weights[0] - 1) < 5 * event.weights_std[0] < 0.05
    assert error[t > ONSET + PERIOD].max() < 0.05
    assert not any(UNCERTAIN in status for status in batch.status)


def test_a_weight_counts_from_two_deviations_on_with_either_sign() -> None:
    deviations = np.array([0.3])
    weight = LEAST_WEIGHT_DEVIATIONS * deviations
    for sign in (-1, 1):
        assert is_weight_significant(sign * weight * 1.001, deviations)
        assert not is_weight_significant(sign * weight, deviations)
    assert not is_weight_significant(np.array([np.nan]), deviations)


def test_a_doubt_lasts_while_the_state_is_uncertain_and_no_other_doubt_does() -> None:
    observer: Any = from_design(designed(body(3, 4)))
    uncertain = UncertainState(observer.gains)
    event = Event(9.0, np.ones(1), 0.1, np.ones(1), (UNCERTAIN,))
    history = History().after(event, 8.0, 10.0)

    def at(size: float, t: float = 10.1) -> Filtered:
        row = Row(t, np.zeros(1), np.zeros(0), np.array([NOISE]))
        return Filtered.without_sample(row, np.zeros(3), size * np.eye(3))

    longer = uncertain.continued(history, 10.0, at(1.0))
    assert longer.doubts_at(10.1) == (UNCERTAIN,)
    assert uncertain.continued(longer, 10.1, at(1.0, 10.2)).doubts_at(10.2) == (UNCERTAIN,)
    assert uncertain.continued(history, 10.0, at(1e-5)) == history
    assert uncertain.continued(history, 10.05, at(1.0)) == history  # the doubt ended before
    # a doubtful impulse that follows leaves it as it was
    other = Event(10.05, np.ones(1), 0.1, np.full(1, 0.1), ("another doubt",))
    both = history.after(other, 10.0, 10.1)
    assert uncertain.continued(both, 10.0, at(1.0)).doubts_at(10.1) == (UNCERTAIN, "another doubt")
    only = History().after(other, 10.0, 10.1)
    assert uncertain.continued(only, 10.1, at(1.0, 10.2)) == only
