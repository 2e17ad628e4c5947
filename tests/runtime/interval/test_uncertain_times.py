"""Events at uncertain times: the state stays inside, the bounds are narrow, rows may come late."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.data.simulation import simulate
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem, load_problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Announced, Estimate, Observer, Sample, rows_of
from obsdesign.runtime.interval.fleet import Fleet
from obsdesign.runtime.interval.several_clocks import ClockedIntervalObserver
from obsdesign.runtime.load import observer_class
from obsdesign.runtime.replay import PROVISIONAL, Replay
from obsdesign.runtime.stored_state import Progress, progress_from_text, state_text
from tests.systems.time_stamps import fifty_digits
from tests.systems.uncertain_times import record

PK: dict[str, Any] = {
    "flow": {"A": [[-1, 0, 0], [1, -0.5, 0.2], [0, 0.3, -0.2]]},
    "event": [{"name": "dose", "E": [[100], [0], [0]], "every": [6, 14], "time_error": 0.25}],
    "sensor": [{"name": "plasma", "C": [[0, 0.05, 0]], "noise_bound": 0.02, "every": [0, 6]}],
}


def body_with(**event: Any) -> dict[str, Any]:
    return {**PK, "event": [{**PK["event"][0], **event}]}


def observer_of(body: dict[str, Any]) -> Observer:
    plant = Problem(**body).plant
    shape = (len(plant.events), plant.n, plant.p)
    gains = ClockedIntervalGains.from_plant(plant, L=np.zeros(shape[1:]), M=np.zeros(shape))
    return observer_class("interval", gains.to_document()).from_gains(gains.to_document())


def dose(t: float, amount: float = 1.0) -> Sample:
    return Sample(t, None, None, np.array([amount]), True, None, (0,))


def estimates(observer: Any, rows: list[Sample], reach: float = 0.0) -> list[Estimate]:
    n = observer.gains.n
    state = observer.init(rows[0].t, lower=-reach * np.ones(n), upper=reach * np.ones(n))
    return list(observer.run(state, rows))


def widths(listed: list[Estimate]) -> Matrix:
    return np.array([e.upper - e.lower for e in listed])  # type: ignore[operator]


def simulated(body: dict[str, Any], seed: int, until: float = 60.0) -> list[Sample]:
    plant = Problem(**body).plant
    run = simulate(
        plant, until=until, initial=np.zeros(plant.n), rng=np.random.default_rng(seed)
    )  # fmt: skip
    assert run.happened is not None
    return list(rows_of(run.t, run.block("y"), w=run.block("w"), jump=run.happened[:, 0]))


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("since", [0.0, 1.7e9])
def test_the_state_stays_inside_in_fifty_digits(seed: int, since: float) -> None:
    with fifty_digits():
        case = record(seed, 4.0, since=since)
        assert case.outside() == []
        words = case.statuses()
    assert not [word for word in words if "outside" in word or "void" in word or "crossed" in word]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("plain", [False, True])
def test_windows_that_are_long_for_a_fast_state(seed: int, plain: bool) -> None:
    with fifty_digits():
        case = record(seed, 3.0, fast=40.0, plain=plain)
        assert case.outside() == []
        words = case.statuses()
    assert not [word for word in words if "outside" in word or "void" in word or "crossed" in word]


@pytest.mark.parametrize("fast", [5.0, 200.0, 2000.0])
def test_a_fast_state_passes_on_what_it_has(fast: float) -> None:
    """The slow state gets 1 / fast of the event: its bounds are no wider than twice that."""
    body = {
        "flow": {"A": [[-fast, 0], [1, -0.1]]},
        "event": [
            {
                "name": "hit", "disturbance": {"lower": [1, 0], "upper": [1, 0]}, "every": [6, 14],
                "time_error": 0.25,
            }
        ],
        "sensor": [{"name": "y", "C": [[0, 1]], "noise_bound": 0.02, "every": [0, 5]}],
    }  # fmt: skip
    rows = [Sample(0.0), Sample(1.0, jump=True, events=(0,)), Sample(3.0)]
    (*_, last) = widths(estimates(observer_of(body), rows))
    hull = exact_hull(np.array(body["flow"]["A"]), np.array([1.0, 0]), 3.0, [1.0], 0.25)
    assert (hull * (1 - 1e-6) <= last + 1e-12).all()
    assert last[1] <= 2.0 / fast


def test_an_event_farther_from_its_stamp_is_outside() -> None:
    """The twin that must not hold, and the one that still does."""
    observer, A = observer_of(PK), np.array(PK["flow"]["A"])
    for off, holds in ((0.25, True), (-0.25, True), (0.26, False), (-0.26, False)):
        rows = [Sample(0.0), dose(1.0), Sample(2.0), Sample(5.0)]
        x = np.array([expm(A * (t - 1.0 - off))[:, 0] * 100.0 for t in (2.0, 5.0)])
        inside = [
            bool((e.lower <= z + 1e-9).all() and (z - 1e-9 <= e.upper).all())  # type: ignore[operator]
            for e, z in zip(estimates(observer, rows)[2:], x, strict=True)
        ]
        assert all(inside) is holds


def test_no_error_is_the_observer_of_exact_times() -> None:
    exact = body_with()
    del exact["event"][0]["time_error"]
    zero = body_with(time_error=0)
    observers = [observer_of(body) for body in (exact, zero)]
    assert all(isinstance(each, ClockedIntervalObserver) for each in observers)
    rows = simulated(exact, 1)
    one, other = (estimates(each, rows, 1.0) for each in observers)
    for a, b in zip(one, other, strict=True):
        assert a.lower.tobytes() == b.lower.tobytes()  # type: ignore[union-attr]
        assert a.upper.tobytes() == b.upper.tobytes()  # type: ignore[union-attr]


@pytest.mark.parametrize("seed", range(3))
def test_a_larger_error_never_narrows(seed: int) -> None:
    body = body_with(time_error=0.05)
    body["flow"] = {**PK["flow"], "disturbance": {"lower": [0, -0.3, 0], "upper": [0, 0.3, 0]}}
    rows = simulated(body, seed)
    before: Matrix | None = None
    for error in (0.05, 0.1, 0.25, 0.6, 1.2):
        own = {**body, "event": [{**body["event"][0], "time_error": error}]}
        now = np.array([[e.lower, e.upper] for e in estimates(observer_of(own), rows, 1.0)])
        if before is not None:
            slack = 1e-9 * (1 + np.abs(before))
            assert (now[:, 0] <= before[:, 0] + slack[:, 0]).all()
            assert (now[:, 1] >= before[:, 1] - slack[:, 1]).all()
            assert (now[:, 1] - now[:, 0] > 1.05 * (before[:, 1] - before[:, 0])).any()
        before = now


def exact_hull(A: Matrix, added: Matrix, t: float, doses: list[float], error: float) -> Matrix:
    """Width (n,) of all states at t after doses whose times are off by at most the error."""
    ways = [
        np.array([expm(A * (t - d - s)) @ added for s in np.linspace(-error, error, 201)])
        for d in doses
    ]
    return np.asarray(sum(np.ptp(way, axis=0) for way in ways))


def test_doses_leave_the_exact_hull() -> None:
    """Of dose times +-15 min the plasma width is at most 1.15 times the exact one."""
    plant = load_problem("examples/oral_doses.toml").plant
    A, added, doses = plant.flow.A, np.eye(6)[0] * 100, [1.0, 7.0, 13.0]
    body = {
        "flow": {"A": A},
        "event": [
            {"name": "dose", "E": 100 * np.eye(6)[:, :1], "every": [6, 14], "time_error": 0.25}
        ],
        "sensor": [{"name": "y", "C": plant.output.C, "noise_bound": 0.02, "every": [0, 6]}],
    }
    for model, amount, state in ((A, added, 4), (np.array(PK["flow"]["A"]), np.eye(3)[0] * 100, 1)):
        observer = observer_of(body if state == 4 else PK)
        rows = [Sample(0.0)]
        for d in doses:
            rows += [dose(d), *(Sample(d + age) for age in (0.3, 2.0, 5.7499))]
        for row, width in zip(rows, widths(estimates(observer, rows)), strict=True):
            past = [d for d in doses if d + 0.25 < row.t]
            if past and not row.jump:
                hull = exact_hull(model, amount, row.t, past, 0.25)
                assert (hull * (1 - 1e-6) <= width).all()
                assert width[state] <= 1.02 * hull[state]


def test_a_jump_that_turns_the_state_is_near_its_hull() -> None:
    """G = diag(1, -.8): first and second order in the error, against 401 times."""
    A, G, drift = np.array([[0, 1], [0, 0]]), np.diag([1.0, -0.8]), np.array([0, -9.81])
    for error in (0.001, 0.01):
        body = {
            "flow": {"A": A, "disturbance": {"lower": drift, "upper": drift}},
            "event": [{"name": "hit", "G": G, "every": [1, 5], "time_error": error}],
            "sensor": [{"name": "y", "C": [[1, 0]], "noise_bound": 0.01, "every": [0, 6]}],
        }
        observer: Any = observer_of(body)
        low, high = np.array([0.0, -10.0]), np.array([0.02, -9.8])
        state = observer.init(1 - error, lower=low, upper=high)
        hit = Sample(1 + 1e-9, jump=True, events=(0,))  # its window opens just after the start
        rows = [Sample(1 - error), hit, Sample(1 + error + 2e-9)]
        (*_, last) = observer.run(state, rows)
        ends = []
        for s in np.linspace(0, 2 * error, 401):
            first = [np.array([[1, t], [0, 1]]) for t in (s, 2 * error - s)]
            push = [np.array([-9.81 * t * t / 2, -9.81 * t]) for t in (s, 2 * error - s)]
            for corner in np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(2, -1).T:
                ends.append(first[1] @ (G @ (first[0] @ corner + push[0])) + push[1])
        hull = np.ptp(np.array(ends), axis=0)
        assert (last.upper - last.lower <= 1.15 * hull + 1e-7).all()
        assert (last.upper - last.lower >= hull - 1e-7).all()


def test_samples_tell_when_an_event_happened() -> None:
    """The sample of a dose that was early ends its window: the other branch contradicts it."""
    body = {**PK, "sensor": [{"name": "depot", "C": [[1, 0, 0]], "noise_bound": 0.5, "every": 1}]}
    observer: Any = observer_of(body)
    rows = [Sample(0.0), Sample(0.9, [98.0]), dose(1.0), Sample(1.1, [80.0])]
    early = estimates(observer, rows)
    assert early[1].status == "ok"
    assert early[1].lower is not None
    assert early[1].lower[0] >= 97.4  # it has happened
    blind = estimates(observer, [row._replace(y=None) for row in rows])
    assert (widths(early)[1:, 0] < widths(blind)[1:, 0]).all()
    late = [Sample(0.0), Sample(0.9, [0.1]), dose(1.0), Sample(1.1, [0.2]), Sample(2.0)]
    after = estimates(observer, late)
    assert after[3].upper is not None
    assert after[3].upper[0] < 1.0  # not yet
    assert (
        widths(after)[4] < widths(estimates(observer, [*rows[:1], *late[2:3], late[4]]))[2]
    ).all()


def test_an_event_that_no_row_announced_is_refused() -> None:
    observer: Any = observer_of(PK)
    state, _ = observer.step(observer.init(0.0, lower=[0] * 3, upper=[0] * 3), Sample(0.9))
    with pytest.raises(ValueError, match=r"dose at 1 may have happened before the last row, 0\.9"):
        observer.step(state, dose(1.0))
    state, _ = observer.step(
        observer.init(0.0, lower=[0] * 3, upper=[0] * 3),
        Sample(0.9, ahead=(Announced(0, 1.0, np.array([1.0])),)),
    )
    _, estimate = observer.step(state, dose(1.0))
    assert estimate.status == "ok"


def test_a_second_event_of_one_stamp_is_announced_too() -> None:
    """In rows of their own: two doses are one of both; `step` refuses the second one behind it."""
    observer: Any = observer_of(PK)
    begin = observer.init(0.0, lower=[0] * 3, upper=[0] * 3)
    begin, _ = observer.step(begin, Sample(0.0))
    state, _ = observer.step(begin, dose(2.0))
    with pytest.raises(ValueError, match=r"dose at 2 may have happened before the last row, 2:"):
        observer.step(state, dose(2.0, 0.5))
    first = dose(2.0)._replace(ahead=(Announced(0, 2.0, np.array([0.5])),))
    state, _ = observer.step(begin, first)
    state, _ = observer.step(state, dose(2.0, 0.5))
    with pytest.raises(ValueError, match=r"dose at 2 may have happened"):
        observer.step(state, dose(2.0, 0.5))
    _, announced = observer.step(state, Sample(3.0))
    last = [
        estimates(observer, [Sample(0.0), *doses, Sample(3.0)])[-1]
        for doses in ([dose(2.0), dose(2.0, 0.5)], [dose(2.0, 1.5)])
    ]
    assert announced.lower.tobytes() == last[0].lower.tobytes()  # type: ignore[union-attr]
    for each in last:
        assert each.lower[0] <= 150 * np.exp(-1) <= each.upper[0]  # type: ignore[index]


def test_rows_that_come_late_give_the_same_bounds() -> None:
    observer, rows = observer_of(PK), simulated(PK, 4)
    expected = estimates(observer, rows, 1.0)
    rng = np.random.default_rng(0)
    for _ in range(5):
        state = observer.start(rows[0].t, [-1.0, 1.0] * 3)
        delayed = [row._replace(received=row.t + float(rng.uniform(0, 10))) for row in rows]
        replay = Replay(observer, state, 10.0)
        final = [
            e for row in sorted(delayed, key=lambda row: row.received or 0.0)
            for e in replay.take(row) if not e.status.startswith(PROVISIONAL)
        ]  # fmt: skip
        assert len(final) > 5
        for e, own in zip(final, expected, strict=False):
            assert e.lower.tobytes() == own.lower.tobytes()  # type: ignore[union-attr]
            assert e.status == own.status


def test_a_state_is_stored_with_its_windows_and_curves() -> None:
    problem = Problem(**PK, observer={"kind": "interval"})
    design = obsdesign.design(problem, allow_undecided=True)  # without input_bound no width
    observer: Any = from_design(design)
    rows = simulated(PK, 2)
    state = observer.init(rows[0].t, lower=[-1.0] * 3, upper=[1.0] * 3)
    stamps = [row for row in rows if row.jump]
    between = sorted([*rows, *(Sample(row.t - 0.1) for row in stamps)], key=lambda row: row.t)
    kinds = set()
    for row in between:
        ahead = tuple(
            Announced(0, x.t, x.w) for x in stamps if row.t < x.t <= row.t + 0.25
        )  # fmt: skip
        row = row._replace(ahead=ahead)
        text = state_text(design, Progress(state))
        again = progress_from_text(text, design, observer, "s").state
        state, estimate = observer.step(state, row)
        _, other = observer.step(again, row)
        assert estimate.lower.tobytes() == other.lower.tobytes()
        kinds.add((len(state.windows), state.spread is not None and len(state.spread.curves) > 1))
    assert {(1, True), (0, True)} <= kinds


def test_new_bounds_are_those_whether_the_event_happened_or_not() -> None:
    observer: Any = observer_of(PK)
    state = observer.init(0.0, lower=[0] * 3, upper=[0] * 3)
    state, _ = observer.step(state, dose(1.0))
    state = observer.reset(state, lower=[10, 0, 0], upper=[11, 1, 1])
    state, _ = observer.step(state, Sample(1.2))
    assert len(state.branches) == 2
    _, estimate = observer.step(state, Sample(1.3))
    assert estimate.lower[0] < 11 * np.exp(-0.3)
    assert estimate.upper[0] > 110 * np.exp(-0.3)


def test_an_input_above_its_bound_is_named() -> None:
    observer = observer_of(body_with(input_bound=[1]))
    statuses = [e.status for e in estimates(observer, [Sample(0.0), dose(1.0, 1.01), dose(8.0)])]
    assert statuses[1].endswith("dose: input above input_bound")
    assert "input" not in statuses[2]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time_error": 3.0}, r"event\.dose\.time_error must be below half the shortest time"),
        ({"time_error": -1}, r"time_error must be a number >= 0"),
        ({"input_bound": [1, 2]}, r"event\.dose\.input_bound must be 1 numbers >= 0"),
    ],
)
def test_errors_that_cannot_be_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Problem(**body_with(**change))


def test_a_sensor_at_an_uncertain_event_is_refused() -> None:
    sensors = [{"name": "plasma", "C": [[0, 1, 0]], "noise_bound": 0.1, "at": "dose"}]
    with pytest.raises(
        InputError, match=r"sensor\.plasma\.at must be an event whose time is known"
    ):
        Problem(**{**PK, "sensor": sensors})


def test_simulations_draw_true_times_within_the_error() -> None:
    plant = Problem(**PK).plant
    run = simulate(plant, until=40.0, initial=np.zeros(3), disturbance="zero", step=0.05)
    assert run.happened is not None
    stamps = run.t[run.happened[:, 0]]
    x1, step = run.block("x")[:, 0], 0.05
    jumps = run.t[1:][np.abs(np.diff(x1)) > 0.06 * np.abs(x1[:-1]) + 1.0]
    assert len(jumps) >= 3
    for t in jumps:  # between the row before and this one
        assert np.min(np.abs(stamps - t)) <= 0.25 + step
    assert (np.min(np.abs(stamps[:, None] - jumps), axis=0) > step).any()
    exact = Problem(**body_with(time_error=0)).plant
    other = simulate(exact, until=40.0, initial=np.zeros(3), disturbance="zero", step=0.05)
    assert np.array_equal(other.t[other.happened[:, 0]], stamps)  # type: ignore[index]
    assert not np.allclose(run.block("x"), other.block("x"))


def test_more_windows_at_once_than_can_be_told_apart_leave_no_bounds() -> None:
    event = {
        **PK["event"][0],
        "every": None,
        "E": None,
        "disturbance": {"lower": [1, 0, 0], "upper": [2, 0, 0]},
    }
    event = {key: value for key, value in event.items() if value is not None}
    observer = observer_of({**PK, "event": [event]})
    stamps = [1.0 + 0.01 * k for k in range(7)]
    for count, finite in ((5, True), (6, False)):
        rows = [Sample(0.0), *(Sample(t, jump=True, events=(0,)) for t in stamps[:count])]
        (*_, last) = estimates(observer, [*rows, Sample(2.0)])
        assert np.isfinite(last.lower).all() == finite  # type: ignore[arg-type]
        if finite:  # between five early events of 1 and five late ones of 2
            assert last.lower[0] <= 5 * np.exp(-1.22)  # type: ignore[index]
            assert last.upper[0] >= 10 * np.exp(-0.74)  # type: ignore[index]
        else:
            words = [e.status for e in estimates(observer, [*rows, Sample(2.0)])]
            assert any("more than 5 events may happen at once" in word for word in words)
            assert last.status == "bounds overflowed"


def test_a_record_at_once_is_that_of_its_rows() -> None:
    observer: Any = observer_of(PK)
    rows = simulated(PK, 3)
    expected = estimates(observer, rows, 1.0)
    batch = observer.run_batch(
        [row.t for row in rows], [row.y for row in rows], w=[row.w for row in rows],
        jump=[row.jump for row in rows], lower=[-1.0] * 3, upper=[1.0] * 3,
    )  # fmt: skip
    assert np.array_equal(batch.lower, np.array([e.lower for e in expected]))
    with pytest.raises(ValueError, match="one event and one sensor"):
        Fleet((observer, observer))
