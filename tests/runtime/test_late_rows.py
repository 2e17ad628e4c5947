"""Rows that arrive late give, once final, what rows in the order of time give, bit for bit."""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.data.simulation import simulate
from obsdesign.kinds import GIVING_BOUNDS
from obsdesign.problem.problem import Problem
from obsdesign.runtime import Replay, Sample, from_design
from obsdesign.runtime.base import Estimate, rows_of
from obsdesign.runtime.late_rows import LateRows
from obsdesign.runtime.replay import PROVISIONAL
from tests.systems.clocks import DOSES, renamed, two_clocks

LAG = 2.0


@functools.cache
def recorded(kind: str) -> tuple[Any, Any, tuple[Sample, ...]]:
    """(observer, its start, samples): of several clocks with ties in t, or of one."""
    if kind == "set_membership":
        body: dict[str, Any] = {**copy.deepcopy(DOSES)}
        body["observer"] = {"kind": kind, "window": 4, "steps": 1}
    else:
        body = renamed(two_clocks()) | {"observer": {"kind": kind}}
    problem = Problem.from_dict(body)
    observer = from_design(obsdesign.design(problem))
    run = simulate(problem.plant, until=20.0, step=1.0, rng=np.random.default_rng(4))
    jump = run.happened if len(problem.plant.events) > 1 else run.happened[:, 0]  # type: ignore[index]
    w = run.block("w") if run.block("w").size else None
    samples = list(rows_of(run.t, run.block("y"), w=w, jump=jump))
    if kind == "set_membership":  # an event at the time of a sample, in a row of its own
        k = next(k for k, row in enumerate(samples) if row.jump and k > 3)
        samples[k : k + 1] = [samples[k]._replace(jump=False, events=()), samples[k]]
    initial = [-2.0, 2.0] * problem.plant.n if kind in GIVING_BOUNDS else None
    return observer, observer.start(samples[0].t, initial), tuple(samples)


def numbers(estimates: Sequence[Estimate]) -> list[Any]:
    return [
        [None if x is None else np.asarray(x).tobytes() for x in (e.t, e.x, e.lower, e.upper)]
        + [e.status]
        for e in estimates
    ]


def delayed(samples: Sequence[Sample], seed: int) -> list[Sample]:
    """The rows as they arrive, each at most LAG late; those of one time in their order."""
    waits = np.random.default_rng(seed).uniform(0.0, LAG, len(samples))
    for k in range(1, len(samples)):
        if samples[k].t == samples[k - 1].t:
            waits[k] = max(waits[k], waits[k - 1])
    stamped = [x._replace(received=x.t + wait) for x, wait in zip(samples, waits, strict=True)]
    return sorted(stamped, key=lambda sample: sample.received)  # type: ignore[arg-type, return-value]


@pytest.mark.parametrize(
    ("kind", "shuffles"), [("set_membership", 20), ("interval", 20), ("luenberger", 20)]
)
def test_final_rows_are_those_of_rows_in_time(kind: str, shuffles: int) -> None:
    observer, state, samples = recorded(kind)
    in_time = numbers(list(observer.run(state, samples)))
    late_jumps = 0
    for seed in range(shuffles):
        arrived = delayed(samples, seed)
        late_jumps += any(
            x.jump and any(o.t > x.t for o in arrived[:k]) for k, x in enumerate(arrived)
        )
        replay, final = Replay(observer, state, LAG), []
        for sample in arrived:
            taken = replay.take(sample)
            final += [e for e in taken if not e.status.startswith(PROVISIONAL)]
        assert numbers(final) == in_time[: len(final)]
        assert len(samples) - len(final) < 8
    assert late_jumps > shuffles / 3


def test_a_row_that_comes_later_than_the_lag_changes_nothing() -> None:
    """The twin: left out, and the rows behind it are those without it."""
    observer, state, samples = recorded("set_membership")
    k = next(k for k, row in enumerate(samples) if k > 4 and row.y is not None)
    replay, final = Replay(observer, state, LAG), []
    for sample in (*samples[:k], *samples[k + 1 : -2], samples[k], *samples[-2:]):
        if sample is samples[k]:
            with pytest.raises(ValueError, match=r"more than report_delay 2 later; it is skipped"):
                replay.take(sample)
            continue
        taken = replay.take(sample)
        final += [e for e in taken if not e.status.startswith(PROVISIONAL)]
    without = list(observer.run(state, [*samples[:k], *samples[k + 1 :]]))
    assert numbers(final) == numbers(without[: len(final)])
    assert numbers(final) != numbers(list(observer.run(state, samples))[: len(final)])


def test_provisional_rows_end_as_the_final_ones() -> None:
    observer, state, samples = recorded("set_membership")
    latest: dict[float, bytes] = {}
    replay = Replay(observer, state, LAG)
    for sample in delayed(samples, 3):
        for e in replay.take(sample):
            assert e.lower is not None
            if e.status.startswith(PROVISIONAL):
                latest[e.t] = e.lower.tobytes()
            elif samples[[s.t for s in samples].index(e.t) + 1].t > e.t:
                assert latest[e.t] == e.lower.tobytes()


def test_a_row_that_an_observer_cannot_take_leaves_no_trace() -> None:
    observer, state, samples = recorded("interval")
    replay, other = Replay(observer, state, LAG), Replay(observer, state, LAG)
    final: list[list[Estimate]] = [[], []]
    for k, sample in enumerate(samples):
        final[0] += replay.take(sample)
        if k == 6:
            with pytest.raises(ValueError, match=r"time must (increase|not decrease)"):
                replay.take(samples[5]._replace(y=np.array([0.0])))
        final[1] += other.take(sample)
    assert numbers(final[0]) == numbers(final[1])


Y = np.array([1.0, np.nan])


@pytest.mark.parametrize(
    ("row", "late"),
    [
        (Sample(1.0, y=Y), Sample(1.0, y=np.array([2.0, 3.0]))),
        (Sample(1.0, jump=True), Sample(1.0, events=(1,))),
        (Sample(1.0, u=np.zeros(1)), Sample(1.0, u=np.ones(1))),
        (Sample(1.0, mode="open"), Sample(1.0, mode="closed")),
    ],
)
def test_two_rows_of_one_time_that_contradict_each_other_are_refused(
    row: Sample, late: Sample
) -> None:
    rows = LateRows(LAG, may_repeat=False)
    rows.insert(row, 0)
    rows.insert(Sample(2.0), 1)
    with pytest.raises(ValueError, match=r"t must differ from row to row: two rows of 1\.0 state"):
        rows.insert(late, 2)
    assert [sample.t for sample in rows.samples] == [1.0, 2.0]
    assert rows.samples[0] == row
    assert rows.insert(Sample(1.5), 3) is not None


@pytest.mark.parametrize(
    "late",
    [
        Sample(1.0, y=np.array([np.nan, 3.0])),
        Sample(1.0, events=(0,), w=np.ones(1)),
        Sample(1.0, u=np.zeros(1)),
        Sample(1.0, mode="open"),
    ],
)
def test_a_row_fills_what_another_of_its_time_leaves_open(late: Sample) -> None:
    rows = LateRows(LAG, may_repeat=False)
    rows.insert(Sample(1.0, y=Y, u=np.zeros(1)), 0)
    rows.insert(Sample(2.0), 1)
    arrival = rows.insert(late._replace(received=2.5), 2)
    assert arrival is not None
    assert (arrival.place, arrival.since, len(arrival.samples)) == (0, 0, 2)
    both = arrival.samples[0]
    assert both.y is not None
    assert both.y.tolist()[0] == 1.0
    assert (both.events, both.mode) == (late.events, late.mode)
    rows.withdraw()
    assert rows.samples[0].events == ()
    assert rows.now == 2.0


def test_a_row_leaves_when_none_before_it_can_come() -> None:
    rows = LateRows(1.0)
    for t in (0.0, 0.4, 1.0):
        rows.insert(Sample(t), 0)
        assert rows.settled() == []
    assert rows.insert(Sample(0.2), 3) is not None
    rows.insert(Sample(1.2), 4)
    assert [sample.t for sample in rows.settled()] == [0.0]
    assert rows.insert(Sample(0.1), 5) is None
    # as late as it may be, though 0.9 + 0.3 is less than 1.2
    assert rows.insert(Sample(1.2 - 1.0), 6) is not None


def test_a_row_that_is_refused_has_never_come() -> None:
    observer, state, _ = recorded("luenberger")
    replay = Replay(observer, state, 24.0)
    y = np.zeros(int(observer.reads["y"]))
    replay.take(Sample(1.0, y))
    with pytest.raises(ValueError, match="y must have"):
        replay.take(Sample(1000.0, np.zeros(len(y) + 1)))
    assert [each.t for each in replay.take(Sample(2.0, y))] == [2.0]
