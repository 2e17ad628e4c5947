"""Rows of discrete time: one for each step, on stamps that are fine enough; `sees` of sensors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.data.layout import Layout
from obsdesign.data.records import read_samples
from obsdesign.document import digest
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design, load
from obsdesign.runtime.base import Observer, Sample
from tests.systems.designs import designed
from tests.systems.discrete_time import turning

LEVEL = {"name": "level", "C": [[1]], "noise_bound": 0.1, "every": 1}
HALVES = {"dt": 1, "A": [[0.5]], "disturbance": {"lower": [-0.1], "upper": [0.1]}}


def two_events(kind: str = "interval") -> dict[str, Any]:
    """A load of any size up to 5, and a reset to zero behind it, in every step."""
    return {
        "flow": HALVES,
        "event": [
            {"name": "load", "disturbance": {"lower": [-5], "upper": [5]}, "every": 1},
            {"name": "zero", "G": [[0]], "every": 1},
        ],
        "sensor": [{**LEVEL, "noise_bound": 100, "every": [0, 1]}],
        "observer": {"kind": kind},
    }


def two_sensors(kind: str = "interval") -> dict[str, Any]:
    """Outputs x1 and x1 + x2: the strip of the sum is narrow behind that of x1 alone."""
    flow = {"dt": 1, "A": [[0.5, 0], [0, 0.5]]}
    flow["disturbance"] = {"lower": [-10, -10], "upper": [10, 10]}
    one, both = {**LEVEL, "name": "one", "C": [[1, 0]]}, {**LEVEL, "name": "sum", "C": [[1, 1]]}
    return {"flow": flow, "sensor": [one, both], "observer": {"kind": kind}}


def reset_behind_a_sample(kind: str = "interval") -> dict[str, Any]:
    return {
        "flow": {**HALVES, "A": [[2]]},
        "event": [{"name": "reset", "G": [[0.1]], "every": 1}],
        "sensor": [{**LEVEL, "noise_bound": 10, "every": [1, 1]}],
        "observer": {"kind": kind},
    }


# rows of a plant: of the first step, of every later one whole, and of such a step in two rows
PARTS = [
    (two_events(), Sample(0.0, [0.0]), Sample(0.0, [0.0], events=(0, 1)),
     [Sample(0.0, [0.0], events=(1,)), Sample(0.0, events=(0,))]),
    (two_sensors(), Sample(0.0, [0.0, 0.0]), Sample(0.0, [0.0, 0.0]),
     [Sample(0.0, [np.nan, 0.0]), Sample(0.0, [0.0, np.nan])]),
    (reset_behind_a_sample(), Sample(0.0, [0.0]), Sample(0.0, [0.0], events=(0,)),
     [Sample(0.0, [0.0]), Sample(0.0, events=(0,))]),
]  # fmt: skip


@pytest.mark.parametrize("kind", ["interval", "set_membership"])
@pytest.mark.parametrize(("body", "first", "whole", "split"), PARTS)
def test_a_step_has_one_row(
    body: dict[str, Any], first: Sample, whole: Sample, split: list[Sample], kind: str
) -> None:
    """Claims fix one order within a step: a second row is refused, whole rows keep the width."""
    problem = Problem.from_dict({**body, "observer": {"kind": kind}})
    outcome = obsdesign.design(problem)
    observer, n = from_design(outcome), problem.plant.n
    begun = observer.init(0.0, lower=[-1] * n, upper=[1] * n)
    begun, _ = observer.step(begun, first)
    state, row = begun, None
    for t in range(1, 30):
        state, row = observer.step(state, whole._replace(t=float(t)))
        assert row.status == "ok"
    if kind == "interval":
        always = next(c for c in outcome.claims if c.id == "event_width").evidence["always"]
        assert (row.upper - row.lower <= np.array(always) * (1 + 1e-6) + 1e-9).all()
    part, _ = observer.step(begun, split[0]._replace(t=1.0))
    for t in (1.0, np.nextafter(1.0, 2.0)):
        with pytest.raises(ValueError, match=r"all samples and events of a step stand in one row"):
            observer.step(part, split[1]._replace(t=float(t)))


def test_events_of_a_row_keep_their_order() -> None:
    """In another order the load would stand behind the reset: wider than is proved."""
    observer = from_design(designed(two_events()))
    state = observer.init(0.0, lower=[-1], upper=[1])
    state, _ = observer.step(state, Sample(0.0, [0.0]))
    with pytest.raises(ValueError, match="in the order of the design in discrete time"):
        observer.step(state, Sample(1.0, [0.0], events=(1, 0)))
    _, row = observer.step(state, Sample(1.0, [0.0], events=(0, 1)))
    assert row.upper - row.lower < 1e-9


@pytest.mark.parametrize("clock", [{"dt": 1.0}, {}], ids=["discrete", "continuous"])
def test_an_event_stands_in_a_row_once(clock: dict[str, float]) -> None:
    """Twice it would act twice, and count once for its clock."""
    body = two_events()
    body["flow"] = {"A": [[0.5 if clock else -0.5]]} | clock
    observer = from_design(obsdesign.investigate(Problem.from_dict(body)).design)
    state = observer.init(0.0, lower=[-1], upper=[1])
    state, _ = observer.step(state, Sample(0.0, [0.0]))
    with pytest.raises(ValueError, match=r"events of a row must differ; got \(0, 0\)"):
        observer.step(state, Sample(1.0, [0.0], events=(0, 0)))
    _, row = observer.step(state, Sample(1.0, [0.0], events=(0, 1)))
    assert np.isfinite(row.upper).all()


KINDS = ["interval", "set_membership", "luenberger", "finite_time"]


def observer_of(kind: str, start: float) -> tuple[Observer, Any]:
    observer = from_design(designed(turning(kind)))
    bounds = {"lower": [-1, -1], "upper": [1, 1]}
    bounds = bounds if kind in ("interval", "set_membership") else {}
    return observer, observer.init(start, **bounds)


@pytest.mark.parametrize("kind", KINDS)
def test_two_rows_of_one_step_are_refused_by_every_kind(kind: str) -> None:
    observer, state = observer_of(kind, 0.0)
    state, _ = observer.step(state, Sample(0.0, [0.0], [0.0]))
    state, _ = observer.step(state, Sample(0.1, [0.0]))
    with pytest.raises(ValueError, match="all samples and events of a step stand in one row"):
        observer.step(state, Sample(float(np.nextafter(0.1, 1.0)), [0.0]))


@pytest.mark.parametrize("kind", KINDS)
def test_stamps_that_are_coarse_beside_a_step_are_refused(kind: str) -> None:
    """With 0.125 between floats, stamps 1.125 apart would count as steps of 1."""
    start = 0.1 * 2.0**50
    observer, state = observer_of(kind, start)
    with pytest.raises(ValueError, match=r"too coarse to count steps of flow\.dt = 0\.1"):
        observer.step(state, Sample(start, [0.0], [0.0]))
    observer, state = observer_of(kind, 1.7e9)  # seconds since 1970
    observer.step(state, Sample(1.7e9, [0.0], [0.0]))


def test_a_record_names_the_line(tmp_path: Path) -> None:
    """Of the first row too, before anything is written; likewise of a second row of a step."""
    design = designed(turning("interval"))
    layout = Layout.from_design(design, from_design(design))
    for rows, words in (
        ("1.7e18,0,0\n", "y.csv line 2: time 1.7e[+]18 is too coarse to count steps"),
        ("0,0,0\n0,0,0\n", "y.csv line 3: time 0.0 is in the step of the row before, 0.0: in disc"),
    ):
        record = tmp_path / "y.csv"
        record.write_text("t,u1,y1\n" + rows)
        with record.open() as stream, pytest.raises(InputError, match=words):
            list(read_samples(stream, layout, "y.csv"))


SEEING = [
    {"flow": HALVES, "output": {"C": [[1]], "noise_bound": 0.1, "jump_measurement": "after"}},
    {"flow": HALVES, "output": {"C": [[1]], "noise_bound": 0.1, "jump_measurement": "none"}},
    {"flow": HALVES, "sensor": [{**LEVEL, "sees": "after"}]},
    {"flow": HALVES, "event": [{"name": "kick", "every": [1, 3]}],
     "sensor": [{"name": "level", "C": [[1]], "noise_bound": 0.1, "at": "kick", "sees": "after"}]},
]  # fmt: skip


@pytest.mark.parametrize("body", SEEING)
def test_what_a_sensor_sees_is_that_of_the_problem(body: dict[str, Any], tmp_path: Path) -> None:
    """A design runs from its file; the twin, a file with another `sees`, is refused."""
    problem = Problem.from_dict({**body, "observer": {"kind": "interval"}})
    path = tmp_path / "d.json"
    obsdesign.design(problem).save(path)
    observer, events = load(path), (0,) if "event" in body else ()
    state = observer.init(0.0, lower=[-1], upper=[1])
    state, _ = observer.step(state, Sample(0.0, None if events else [0.0]))
    _, row = observer.step(state, Sample(1.0, [0.0], events=events))
    assert row.status == "ok"
    assert row.upper - row.lower <= 0.2 + 1e-9
    stored = json.loads(path.read_text())
    stored["gains"]["sensors"][0]["sees"] = "before"
    del stored["digest"]
    path.write_text(json.dumps(stored | {"digest": digest(stored)}))
    with pytest.raises(InputError, match=r"gains.sensors.sees differ from problem"):
        load(path)
