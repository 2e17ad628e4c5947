"""Several events and sensors: the state stays inside, and every sample helps."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.arrays import Matrix
from obsdesign.data.simulation import Simulation, simulate
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Estimate, Sample, rows_of
from obsdesign.runtime.set_membership.observer import SetMembershipObserver
from tests.systems.clocks import DOSES
from tests.systems.designs import designed

# what the search for multipliers may leave of the width, for records with other samples
_SEARCHED = 0.02
_START = {"lower": np.full(3, -2.0), "upper": np.full(3, 2.0)}


def observer_of(body: dict[str, Any], window: int = 8) -> SetMembershipObserver:
    body = {**body, "observer": {"kind": "set_membership", "window": window, "steps": 30}}
    observer = from_design(designed(body))
    assert isinstance(observer, SetMembershipObserver)
    return observer


def record(seed: int, disturbance: str = "extreme", until: float = 60.0) -> Simulation:
    plant, rng = Problem.from_dict(DOSES).plant, np.random.default_rng(seed)
    return simulate(plant, until=until, disturbance=disturbance, rng=rng)


def samples_of(run: Simulation) -> list[Sample]:
    rows = rows_of(run.t, run.block("y"), w=run.block("w"), jump=run.happened)
    return [row if np.isfinite(np.asarray(row.y)).any() else row._replace(y=None) for row in rows]


def estimates(observer: SetMembershipObserver, rows: list[Sample]) -> list[Estimate]:
    return list(observer.run(observer.init(rows[0].t, **_START), rows))


def widths(listed: list[Estimate]) -> Matrix:
    return np.array([np.subtract(one.upper, one.lower) for one in listed])  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("disturbance", ["extreme", "random"])
def test_the_state_never_leaves(seed: int, disturbance: str) -> None:
    run = record(seed, disturbance)
    for one, x in zip(estimates(observer_of(DOSES), samples_of(run)), run.block("x"), strict=True):
        assert one.status == "ok"
        assert (one.lower <= x).all()
        assert (x <= one.upper).all()


def test_a_disturbance_beyond_its_bounds_is_proved_by_the_data() -> None:
    """The twin that must not pass: a bolus twice as large as declared."""
    run = record(1)
    rows = samples_of(run)
    k = next(i for i, row in enumerate(rows) if 1 in row.events)
    rows = [row._replace(y=row.y if i <= k else np.asarray(row.y) + 3.0) if row.y is not None
            else row for i, row in enumerate(rows)]  # fmt: skip
    assert any("bounds crossed" in one.status for one in estimates(observer_of(DOSES), rows))


def test_a_sample_that_is_lost_narrows_nothing() -> None:
    observer, rows = observer_of(DOSES), samples_of(record(2))
    whole = widths(estimates(observer, rows))
    helped = 0
    for lost in [i for i, row in enumerate(rows) if row.y is not None][2:14:3]:
        fewer = [row._replace(y=None) if i == lost else row for i, row in enumerate(rows)]
        less = widths(estimates(observer, fewer))
        assert (less >= whole * (1 - _SEARCHED) - 1e-9).all()
        helped += bool((less[lost] > 1.1 * whole[lost]).any())
    assert helped > 1


def test_events_of_one_map_are_the_one_jump() -> None:
    """Two names for the same jump, by turns: the bounds of one, bit for bit."""
    dose = {**copy.deepcopy(DOSES["event"][0]), "every": [1, 30]}
    sensors = [{**sensor, "every": [0, 30], "jitter": 0, "losses": 0} for sensor in DOSES["sensor"]]
    one = {**DOSES, "event": [dose], "sensor": sensors}
    two = {**DOSES, "event": [dose, {**dose, "name": "other"}], "sensor": sensors}
    rows = [row for row in samples_of(record(3)) if 1 not in row.events]
    turns = []
    for i, row in enumerate(rows):
        w, place = np.asarray(row.w), i % 2
        events = (place,) if row.jump else ()
        both = np.where(np.arange(2) == place, w, np.nan)
        turns.append(row._replace(w=both, events=events))
    first = estimates(observer_of(one), [row._replace(events=()) for row in rows])
    second = estimates(observer_of(two), turns)
    assert any(row.jump for row in rows)
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a.lower, b.lower)  # type: ignore[arg-type]
        assert np.array_equal(a.upper, b.upper)  # type: ignore[arg-type]


def test_sensors_are_outputs_that_may_be_missing() -> None:
    """Two sensors are one output of two rows, NaN where one is silent, bit for bit."""
    body: dict[str, Any] = {key: DOSES[key] for key in ("name", "flow")}
    bounds = [[-0.02, 0.02], [-0.1, 0.2]]
    rows_of_C = [sensor["C"][0] for sensor in DOSES["sensor"]]
    plain = {**body, "output": {"C": rows_of_C, "noise_bound": bounds}}
    named = [{**sensor, "sees": "before"} for sensor in DOSES["sensor"]]
    run = record(4)
    rows = [Sample(t, y) for t, y in zip(run.t.tolist(), run.block("y"), strict=True)]
    first = estimates(observer_of(plain), rows)
    second = estimates(observer_of({**body, "sensor": named}), rows)
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a.lower, b.lower)  # type: ignore[arg-type]


def test_rows_of_one_time_act_in_their_order() -> None:
    observer = observer_of(DOSES)
    run = record(5)
    rows = samples_of(run)
    apart: list[Sample] = []
    for row in rows:
        if row.y is not None and row.jump:  # a sensor of each kind: before, the event, after
            y = np.asarray(row.y)
            apart += [Sample(row.t, np.where([True, False], y, np.nan)), row._replace(y=None)]
            apart += [Sample(row.t, np.where([False, True], y, np.nan))]
        else:
            apart.append(row)
    at = {row.t: one for row, one in zip(apart, estimates(observer, apart), strict=True)}
    for row, x in zip(rows, run.block("x"), strict=True):
        assert (at[row.t].lower <= x).all()
        assert (x <= at[row.t].upper).all()
    with pytest.raises(ValueError, match="time must not decrease"):
        observer.step(observer.step(observer.init(1.0, **_START), Sample(2.0))[0], Sample(1.5))


def test_what_an_event_shifts_is_of_the_sensors_that_see_after_it() -> None:
    """A sample before a bolus of 9 to 10, read as one after it, contradicts the bounds."""
    body = copy.deepcopy(DOSES)
    body["sensor"][0]["sees"] = "after"
    first, second = observer_of(DOSES), observer_of(body)
    before = Sample(0.0, np.array([0.0, np.nan]))
    row = Sample(0.5, np.array([0.0, np.nan]), w=np.zeros(1), jump=True, events=(1,))
    statuses = [estimates(observer, [before, row])[1].status for observer in (first, second)]
    assert "crossed" not in statuses[0]
    assert "crossed" in statuses[1]


def test_clocks_that_are_not_kept_are_named_and_void_no_bound() -> None:
    rows = [Sample(0.0, np.array([0.0, 0.0])), Sample(1.0, w=np.zeros(1), jump=True, events=(0,)),
            Sample(4.0, np.array([0.0, np.nan]), w=np.zeros(1), jump=True, events=(0,)),
            Sample(14.0), Sample(19.0)]  # fmt: skip
    listed = estimates(observer_of(DOSES), rows)
    assert [one.status for one in listed] == [
        "ok",
        "ok",
        "dose: dwell time 3 below 6",
        "tissue: time 14 since the last sample exceeds 13",
        "dose: dwell time 15 above 14; tissue: time 19 since the last sample exceeds 13",
    ]
    assert listed[2].events[0] == (4.0, "dose")


@pytest.mark.parametrize("events", [(), (2,), (-1,)])
def test_an_event_that_the_plant_has_not_is_refused(events: tuple[int, ...]) -> None:
    observer = observer_of(DOSES)
    with pytest.raises(ValueError, match="events must be places among dose, bolus"):
        observer.step(observer.init(0.0, **_START), Sample(0.0, jump=True, events=events))


@pytest.mark.parametrize("change", [{"sees": "after"}, {"outputs": 2}])
def test_gains_of_another_clock_are_refuted(change: dict[str, Any]) -> None:
    design = designed(DOSES)
    sensors = [dict(sensor) for sensor in design.gains["sensors"]]
    sensors[0] |= change
    forged = replace(design, gains={**design.gains, "sensors": sensors})
    assert obsdesign.verify(forged).verdict == "refuted"
    events = [{**event, "upper": np.full(3, 0.1)} for event in design.gains["events"]]
    forged = replace(design, gains={**design.gains, "events": events})
    assert obsdesign.verify(forged).verdict == "refuted"
