"""Events within modes at run time: enclosure, inputs, guards, records and states."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest

from obsdesign.data.csv_text import table_text
from obsdesign.data.layout import Layout
from obsdesign.data.records import read_samples
from obsdesign.data.simulation import simulate
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.progress import Progress
from obsdesign.runtime.stored_state import progress_from_text, state_text
from obsdesign.workflow import design, investigate
from tests.systems.switched import random_strokes, valve

START = {"interval": {"lower": [-9, -9], "upper": [9, 9]}, "luenberger": {"x": [0, 0]}}


@pytest.mark.parametrize("seed", [2, 7])
def test_bounds_hold_whatever_events_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem = random_strokes(rng, "interval")
    made = investigate(problem).design
    assert made is not None
    run = simulate(problem.plant, disturbance="extreme", rng=rng, until=15, step=0.05)
    assert run.happened is not None
    assert run.happened.any()
    y, x = run.block("y").copy(), run.block("x")
    y[rng.random(len(y)) < 0.1] = np.nan
    batch = from_design(made).run_batch(
        run.t, y, run.block("u"), run.block("w"), run.happened, mode=run.mode,
        lower=x[0] - 1, upper=x[0] + 0.5,
    )  # fmt: skip
    room = 1e-12 * (1 + np.abs(x))
    assert (batch.lower <= x + room).all()
    assert (x - room <= batch.upper).all()
    late = run.happened.copy()
    late[:] = False  # events that are not reported
    if problem.plant.events[0].lower.any() or problem.plant.events[0].E is not None:
        blind = from_design(made).run_batch(
            run.t, run.block("y"), run.block("u"), None, late, mode=run.mode,
            lower=x[0] - 1e-3, upper=x[0] + 1e-3,
        )  # fmt: skip
        assert ((blind.lower > x) | (x > blind.upper)).any() or "void" in "".join(blind.status)


def two_events(kind: str, sees: str = "before") -> Problem:
    """The valve with a stroke of known size while it is open, and a leak at any time."""
    body = valve(kind=kind, strokes=True).to_dict()
    body["sensor"][0]["sees"] = sees
    body["event"][0] |= {"E": [[1, 0], [0, 2]], "disturbance": {"lower": [0, 0], "upper": [0, 0]}}
    leak = {"lower": [-0.2, 0], "upper": [-0.2, 0]}
    body["event"].append({"name": "leak", "every": [1, 3], "disturbance": leak})
    return Problem.from_dict(body)


@pytest.mark.parametrize("sees", ["before", "after"])
@pytest.mark.parametrize("kind", ["interval", "luenberger"])
def test_events_of_a_row_act_in_turn_and_then_the_mode_changes(kind: str, sees: str) -> None:
    observer = from_design(design(two_events(kind, sees)))
    state = observer.init(0.0, **START[kind])  # type: ignore[attr-defined]
    state, _ = observer.step(state, Sample(0.0, [0.0], mode="open"))
    without, _ = observer.step(state, Sample(1.0, [0.5], mode="closed"))
    row = Sample(1.0, [0.5], w=[0.5, 0.25], jump=True, events=(0, 1), mode="closed")
    after, estimate = observer.step(state, row)
    assert estimate.status == "ok"
    assert after.mode == without.mode
    moved = [0.5 - 0.2, 0.5]
    if sees == "before":
        inner, plain = after.inner, without.inner
        for name in ("x",) if kind == "luenberger" else ():
            np.testing.assert_allclose(getattr(inner, name), getattr(plain, name) + moved)
        if kind == "interval":
            shift = [*moved, *np.negative(moved)]
            np.testing.assert_allclose(inner.box, plain.box + shift, atol=1e-12)
    elif kind == "interval":  # y = 0.5 +- 0.01 is of the state after both
        np.testing.assert_allclose([estimate.lower[1], estimate.upper[1]], [0.49, 0.51])


@pytest.mark.parametrize("kind", ["interval", "luenberger"])
def test_guards_of_events(kind: str) -> None:
    observer = from_design(design(valve(kind=kind, strokes=True)))
    state = observer.init(0.0, **START[kind])  # type: ignore[attr-defined]
    rows = [(0.0, "open", True), (4.0, None, True), (5.0, "closed", False), (10.0, None, True),
            (12.0, "open", False), (14.9, None, True), (20.5, None, True)]  # fmt: skip
    statuses = []
    for t, mode, jump in rows:
        state, estimate = observer.step(state, Sample(t, [0.0], jump=jump, mode=mode))
        statuses.append([x for x in estimate.status.split("; ") if x.startswith("stroke")])
    assert statuses[1] == ["stroke: dwell time 4 below 5"]
    assert statuses[3] == ["stroke: does not happen in closed"]
    assert statuses[5] == ["stroke: dwell time 4.9 below 5"]
    assert [statuses[k] for k in (0, 2, 4, 6)] == [[]] * 4
    with pytest.raises(ValueError, match="events must be places among stroke"):
        observer.step(state, Sample(21.0, [0.0], jump=True, events=(1,)))


def test_a_state_keeps_the_guards_of_events() -> None:
    made = design(valve(strokes=True))
    observer = from_design(made)
    state = observer.start(0.0, [-1, 1, -1, 1])
    state, _ = observer.step(state, Sample(0.0, [0.0], jump=True, mode="open"))
    text = state_text(made, Progress(state))
    again = progress_from_text(text, made, observer, "s.json").state
    row = Sample(1.0, [0.0], jump=True)
    assert observer.step(again, row)[1].status == observer.step(state, row)[1].status
    assert "stroke: dwell time 1 below 5" in observer.step(again, row)[1].status


def test_a_record_has_columns_of_mode_and_event() -> None:
    made = design(valve(strokes=True))
    run = simulate(valve(strokes=True).plant, until=30, step=0.5)
    layout = Layout.from_design(made, from_design(made))
    samples = list(read_samples(io.StringIO(table_text(run.columns)), layout, "d.csv"))
    assert run.happened is not None
    assert [bool(sample.events) for sample in samples] == run.happened[:, 0].tolist()
    assert [sample.mode for sample in samples] == run.mode


@pytest.mark.parametrize(("name", "value"), [("modes", "closed"), ("dwell_time", [4.0, "inf"])])
def test_gains_of_other_events_do_not_run(name: str, value: object) -> None:
    body = design(valve(strokes=True)).to_dict()
    body["gains"]["events"][0][name] = value
    made = replace(design(valve(strokes=True)), gains=body["gains"])
    with pytest.raises(InputError, match=r"gains\.modes differ from problem\.mode"):
        from_design(made)
