"""Interval observers of several events and sensors: the state stays inside, every sample helps."""

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
from obsdesign.runtime.bounds import Bounds
from obsdesign.runtime.interval.fleet import Fleet
from obsdesign.runtime.interval.several_clocks import ClockedIntervalObserver
from obsdesign.runtime.stored_state import Progress, progress_from_text, state_text
from tests.systems.clocks import DOSES
from tests.systems.designs import designed

_START = {"lower": np.full(3, -2.0), "upper": np.full(3, 2.0)}
# rounding of a record, relative to the bounds
_ROUNDING = 1e-12
# an oscillator, whose flow is no positive system, and an output of two states
SPRING: dict[str, Any] = {
    "name": "spring",
    "flow": {
        "A": [[0, 1, 0], [-2, -1, 0.3], [0, 0.2, -0.5]],
        "disturbance": {"lower": [0, -0.2, -0.1], "upper": [0, 0.2, 0.1]},
    },
    "event": [
        {"name": "kick", "G": [[1, 0, 0], [0.2, 0.9, -0.1], [0, 0, 1]], "every": [1, 4]},
        {
            "name": "tap", "every": [2, 5],
            "disturbance": {"lower": [0, -0.1, 0], "upper": [0, 0.1, 0.05]},
        },
    ],
    "sensor": [
        {"name": "both", "C": [[1, 1, 0], [1, -1, 0.2]], "noise_bound": 0.05, "every": [0.2, 1]},
        {"name": "sum", "C": [[1, 0, 1]], "noise_bound": [[-0.02, 0.1]], "at": "kick"},
        {"name": "last", "C": [[0, 0, 1]], "noise_bound": 0.1, "every": 0.7, "jitter": 0.2},
    ],
    "observer": {"kind": "interval"},
}  # fmt: skip
GAINS = {
    "both": {"L": [[0.5, 0.5], [0.4, -0.6], [0, 0.3]]},
    "sum": {"L": [[0.5], [0], [0.5]]},
    "last": {"L": [[0.1], [0], [0.9]]},
    "kick": {"M": [[0, 0, 0.5, 0], [0, 0, 0.2, 0], [0, 0, 0.3, 0]]},
}


def observer_of(body: dict[str, Any], gains: Any = None) -> ClockedIntervalObserver:
    observer = {"kind": "interval", "gains": gains or {}}
    # undecided where widths are, which these tests are not about
    made = from_design(designed({**body, "observer": observer}, allow_undecided=True))
    assert isinstance(made, ClockedIntervalObserver)
    return made


def record(body: dict[str, Any], seed: int, disturbance: str = "extreme") -> Simulation:
    plant, rng = Problem.from_dict(body).plant, np.random.default_rng(seed)
    until = 60.0 if body is DOSES else 12.0
    return simulate(plant, until=until, disturbance=disturbance, rng=rng)


def samples_of(run: Simulation) -> list[Sample]:
    return list(rows_of(run.t, run.block("y"), w=run.block("w"), jump=run.happened))


def estimates(observer: ClockedIntervalObserver, rows: list[Sample]) -> list[Estimate]:
    return list(observer.run(observer.init(rows[0].t, **_START), rows))


def boxes(listed: list[Estimate]) -> Matrix:
    """[lower, -upper] of each row: the smaller, the larger the box."""
    return np.array([np.concatenate([x.lower, -x.upper]) for x in listed])  # type: ignore[operator]


def is_wider(boxes_with_less: Matrix, boxes_with_more: Matrix) -> bool:
    slack = _ROUNDING * (1.0 + np.abs(boxes_with_more))
    return bool((boxes_with_less <= boxes_with_more + slack).all())


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("disturbance", ["extreme", "random"])
@pytest.mark.parametrize(("body", "gains"), [(DOSES, None), (SPRING, None), (SPRING, GAINS)])
def test_the_state_never_leaves(
    seed: int, disturbance: str, body: dict[str, Any], gains: Any
) -> None:
    run = record(body, seed, disturbance)
    for late in (0.0, 1.7e9):
        rows = [row._replace(t=row.t + late) for row in samples_of(run)]
        for one, x in zip(estimates(observer_of(body, gains), rows), run.block("x"), strict=True):
            assert one.status == "ok"
            assert (one.lower <= x).all()
            assert (x <= one.upper).all()


def test_a_measurement_beyond_its_bounds_is_named() -> None:
    """The twin that must not pass: an output that is off by more than its noise."""
    rows = samples_of(record(SPRING, 1))
    k = [i for i, row in enumerate(rows) if np.isfinite(np.asarray(row.y)[3])][4]
    y = np.array(rows[k].y)
    y[3] += 1.0
    rows[k] = rows[k]._replace(y=y)
    listed = estimates(observer_of(SPRING), rows)
    assert listed[k].status.startswith("last outside its bounds")
    assert all(f"void since time {rows[k].t:.9g}" in one.status for one in listed[k + 1 :])
    assert all(np.isfinite(one.lower).all() for one in listed)


@pytest.mark.parametrize(("body", "gains"), [(DOSES, None), (SPRING, None), (SPRING, GAINS)])
def test_a_sample_that_is_lost_never_narrows(body: dict[str, Any], gains: Any) -> None:
    """Any single one, whatever the gains; the whole row where nothing else happens in it."""
    observer, rows, helped = observer_of(body, gains), samples_of(record(body, 2)), 0
    whole = boxes(estimates(observer, rows))
    for i, row in enumerate(rows):
        for k in np.flatnonzero(np.isfinite(np.asarray(row.y)))[:2]:
            y = np.array(row.y)
            y[k] = np.nan
            fewer = [*rows[:i], row._replace(y=y), *rows[i + 1 :]]
            less = boxes(estimates(observer, fewer))
            assert is_wider(less, whole)
            helped += bool((less < whole - 1e-3).any())
            if not np.isfinite(y).any() and not row.jump and i:
                without = boxes(estimates(observer, [*rows[:i], *rows[i + 1 :]]))
                assert is_wider(without, np.delete(whole, i, 0))
                assert np.allclose(without, np.delete(less, i, 0), atol=1e-9)
    assert helped > 3


@pytest.mark.parametrize("body", [DOSES, SPRING])
def test_rows_that_say_nothing_change_nothing(body: dict[str, Any]) -> None:
    observer, rows = observer_of(body), samples_of(record(body, 3))
    more = sorted([*rows, *(Sample(row.t + 1e-3 * k) for k in (1, 7) for row in rows[1:])],
                  key=lambda row: row.t)  # fmt: skip
    times = {row.t for row in rows}
    with_more = [
        one for one, row in zip(estimates(observer, more), more, strict=True) if row.t in times
    ]
    assert np.allclose(boxes(with_more), boxes(estimates(observer, rows)), rtol=1e-10, atol=1e-10)


def test_batches_streams_and_stored_states_give_the_same_bounds() -> None:
    design = designed(SPRING, allow_undecided=True)
    observer: Any = from_design(design)
    run = record(SPRING, 4)
    rows = samples_of(run)
    batch = observer.run_batch(run.t, run.block("y"), w=run.block("w"), jump=run.happened, **_START)
    state, stream = observer.init(rows[0].t, **_START), []
    for row in rows:
        state, one = observer.step(state, row)
        stream.append(one)
        state = progress_from_text(
            state_text(design, Progress(state)), design, observer, "state"
        ).state
    assert np.array_equal(batch.lower, [one.lower for one in stream])
    assert np.array_equal(batch.upper, [one.upper for one in stream])
    assert list(batch.status) == [one.status for one in stream]


def test_two_names_of_one_event_are_one_event() -> None:
    kick = {**copy.deepcopy(SPRING["event"][0]), "every": [0, "inf"]}
    sensors = [{**one, "at": None} for one in SPRING["sensor"]]
    sensors = [{k: x for k, x in one.items() if x is not None} for one in sensors]
    sensors[1]["every"] = [0, "inf"]
    one = {**SPRING, "event": [kick], "sensor": sensors}
    two = {**SPRING, "event": [kick, {**kick, "name": "other"}], "sensor": sensors}
    rows = [row._replace(w=None) for row in samples_of(record(SPRING, 5))]
    first = [row._replace(events=(0,) if row.jump else ()) for row in rows]
    second = [row._replace(events=(i % 2,) if row.jump else ()) for i, row in enumerate(rows)]
    a, b = estimates(observer_of(one), first), estimates(observer_of(two), second)
    assert any(row.jump for row in rows)
    assert np.array_equal(boxes(a), boxes(b))


def test_a_gain_of_two_outputs_sees_what_no_strip_does() -> None:
    """x1 + x2 and x1 - x2 together give both; chosen by synthesis, as given, and not at all."""
    body = {
        "flow": {"A": [[-1, 0], [0, -1]], "disturbance": {"lower": [-2, -2], "upper": [2, 2]}},
        "sensor": [
            {"name": "both", "C": [[1, 1], [1, -1]], "noise_bound": 0.1, "every": [0, 1]},
            {"name": "slow", "C": [[1, 0]], "noise_bound": 1.0, "every": [0, 10]},
        ],
    }
    row = Sample(0.0, np.array([1.0, 1.0, np.nan]))
    widths = []
    for L in (None, [[0.5, 0.5], [0.5, -0.5]], [[0, 0], [0, 0]]):
        observer = observer_of(body, None if L is None else {"both": {"L": L}})
        one = observer.step(observer.init(0.0, lower=[-4, -4], upper=[4, 4]), row)[1]
        widths.append(float((one.upper - one.lower)[1]))  # type: ignore[operator]
    assert widths[1] == pytest.approx(0.2)
    assert widths[0] <= 1.01 * widths[1]
    assert widths[2] > 3.0


def test_a_gain_at_an_event_keeps_what_a_sample_and_the_event_share() -> None:
    """G = [[1, 1], [0, 0]] after y = x1 + x2: x1 is known to the noise; twin: without M not."""
    body = {
        "flow": {"A": [[-1, 0], [0, -1]], "disturbance": {"lower": [-2, -2], "upper": [2, 2]}},
        "event": [{"name": "sum", "G": [[1, 1], [0, 0]], "every": [1, 2]}],
        "sensor": [
            {"name": "read", "C": [[1, 1]], "noise_bound": 0.1, "at": "sum"},
            {"name": "slow", "C": [[1, 0]], "noise_bound": 1.0, "every": [0, 10]},
        ],
    }
    row = Sample(0.0, np.array([1.0, np.nan]), jump=True)
    widths = []
    for gains in (None, {"sum": {"M": [[1, 0], [0, 0]]}}, {"sum": {"M": [[0, 0], [0, 0]]}}):
        observer = observer_of(body, gains)
        one = observer.step(observer.init(0.0, lower=[-4, -4], upper=[4, 4]), row)[1]
        widths.append(float((one.upper - one.lower)[0]))  # type: ignore[operator]
    assert widths[1] == pytest.approx(0.2)
    assert widths[0] == pytest.approx(0.2)
    assert widths[2] > 3.0
    alone = list(observer_of(body, {"sum": {"M": [[1, 0], [0, 0]]}}).run(
        observer.init(0.0, lower=[-4, -4], upper=[4, 4]), [row._replace(y=None)]
    ))  # fmt: skip
    assert (alone[0].upper - alone[0].lower)[0] > 3.0  # type: ignore[operator]


def test_what_a_sensor_sees_at_an_event_is_before_or_after_it() -> None:
    """A sample before a bolus of 9 to 10, read as one after it, contradicts the bounds."""
    body = copy.deepcopy(DOSES)
    body["sensor"][0]["sees"] = "after"
    row = Sample(0.5, np.array([0.0, np.nan]), w=np.zeros(1), jump=True, events=(1,))
    rows = [Sample(0.0, np.array([0.0, np.nan])), row]
    statuses = [estimates(observer_of(x), rows)[1].status for x in (DOSES, body)]
    assert statuses[0] == "ok"
    assert statuses[1].startswith("plasma outside its bounds")


def test_bounds_of_a_row_narrow_what_follows_it() -> None:
    observer, rows = observer_of(SPRING), samples_of(record(SPRING, 6, "zero"))
    b = (np.zeros(3), np.zeros(3))
    v = (np.full(4, -0.01), np.full(4, 0.01))
    v[0][2] = 0.0
    own = [row._replace(bounds=Bounds(b=b, v=v)) for row in rows]
    less, whole = boxes(estimates(observer, own)), boxes(estimates(observer, rows))
    assert (less >= whole - _ROUNDING * (1 + np.abs(whole))).all()
    assert (less[-1] > whole[-1]).all()
    with pytest.raises(ValueError, match="bounds of c are not used with several clocks"):
        observer.step(observer.init(0.0, **_START), rows[0]._replace(bounds=Bounds(c=b)))


def test_clocks_that_are_not_kept_are_named_and_void_no_bound() -> None:
    rows = [Sample(0.0, np.array([0.0, 0.0])), Sample(1.0, w=np.zeros(1), jump=True, events=(0,)),
            Sample(4.0, np.array([0.0, np.nan]), w=np.zeros(1), jump=True, events=(0,)),
            Sample(14.0), Sample(19.0)]  # fmt: skip
    assert [one.status for one in estimates(observer_of(DOSES), rows)] == [
        "ok",
        "ok",
        "dose: dwell time 3 below 6",
        "tissue: time 14 since the last sample exceeds 13",
        "dose: dwell time 15 above 14; tissue: time 19 since the last sample exceeds 13",
    ]


def test_a_sample_with_an_output_missing_is_none_for_the_clock() -> None:
    """Widths count on all outputs of a sensor: the other one still narrows the bounds."""
    observer = observer_of(SPRING)
    state = observer.init(0.0, **_START)
    for t, y in ((0.5, [0.0, 0.0]), (1.2, [0.0, np.nan]), (1.8, [0.0, np.nan]), (2.0, [0.0, 0.0])):
        before = state
        state, one = observer.step(state, Sample(t, np.array([*y, np.nan, np.nan])))
        missing = observer.step(before, Sample(t))[1]
        assert (one.upper < missing.upper).any()  # type: ignore[operator]
        is_late = "both: time" in one.status
        assert is_late == (t > 1.5)


def test_bounds_that_overflow_say_so() -> None:
    body = copy.deepcopy(SPRING)
    body["flow"]["A"] = [[400, 0, 0], [0, -1, 0], [0, 0, -1]]
    rows = [Sample(0.0), Sample(1.0), Sample(3.0)]
    listed = estimates(observer_of(body), rows)
    assert listed[0].status == "ok"
    assert "bounds overflowed" in listed[2].status
    assert np.isinf(listed[2].upper[0])  # type: ignore[index]


def test_gains_stand_in_a_table_for_each_event_and_sensor() -> None:
    problem = Problem.from_dict({**SPRING, "observer": {"kind": "interval", "gains": GAINS}})
    assert problem.to_dict()["observer"]["gains"].keys() == GAINS.keys()
    assert Problem.from_dict(problem.to_dict()) == problem
    design = designed(problem.to_dict(), allow_undecided=True)
    assert np.array_equal(design.gains["L"][:, :2], GAINS["both"]["L"])
    assert np.array_equal(design.gains["M"][0], GAINS["kick"]["M"])
    assert obsdesign.verify(design).claims[0].verdict == "proved"


@pytest.mark.parametrize("place", [("L", (0, 0)), ("M", (0, 0, 2)), ("C", (0, 0))])
def test_gains_that_are_not_those_of_the_problem_are_refuted(place: tuple[str, Any]) -> None:
    design = designed(
        {**SPRING, "observer": {"kind": "interval", "gains": GAINS}}, allow_undecided=True
    )
    name, entry = place
    changed = np.array(design.gains[name])
    changed[entry] += 1e-3
    forged = replace(design, gains={**design.gains, name: changed})
    assert obsdesign.verify(forged).verdict == "refuted"
    for key, change in (("events", {"upper": np.zeros(3)}), ("sensors", {"gap": 0.5})):
        blocks = [dict(block) for block in design.gains[key]]
        blocks[1] |= change
        forged = replace(design, gains={**design.gains, key: blocks})
        assert obsdesign.verify(forged).verdict == "refuted"


def test_a_fleet_takes_one_clock_alone() -> None:
    observer: Any = observer_of(DOSES)
    with pytest.raises(ValueError, match="plants with one event and one sensor"):
        Fleet((observer,))


@pytest.mark.parametrize("first", ["dose", "purge"])
def test_only_the_first_event_of_a_row_is_corrected_by_what_came_before(first: str) -> None:
    """A dose of exactly 1 and a purge that changes nothing, at once: 0 before them, 1 after."""
    dose = {"name": "dose", "every": [0.5, "inf"], "disturbance": {"lower": [1], "upper": [1]}}
    purge = {"name": "purge", "every": [0.5, "inf"]}
    body = {
        "flow": {"A": [[-0.1]], "disturbance": {"lower": [0], "upper": [0]}},
        "event": [dose, purge] if first == "dose" else [purge, dose],
        "sensor": [{"name": "lab", "C": [[1]], "noise_bound": 0.2, "at": "purge"}],
    }
    observer = observer_of(body, {"purge": {"M": [[1]]}})
    state = observer.init(0.0, lower=[-1.0], upper=[1.0])
    row = Sample(1.0, y=np.array([0.0]), jump=True, events=(0, 1))
    state, estimate = observer.step(state, row)
    assert estimate.lower is not None
    assert estimate.upper is not None
    assert estimate.status == "ok"
    assert estimate.lower[0] <= 1.0 <= estimate.upper[0]
    assert observer.step(state, row._replace(t=2.0, jump=False))[1].events[:2] == (
        (2.0, "dose"), (2.0, "purge"),
    )[:: 1 if first == "dose" else -1]  # fmt: skip
