"""Observers of plants with modes at run time: enclosure, the guard, states between parts."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from obsdesign.data.execution import execute
from obsdesign.data.simulation import simulate
from obsdesign.document import digest
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.base import samples_of
from obsdesign.runtime.bounds import Bounds
from obsdesign.runtime.columns import Columns
from obsdesign.runtime.interval.modes import SwitchedIntervalObserver
from obsdesign.runtime.progress import Progress
from obsdesign.runtime.stored_state import progress_from_text, state_text
from obsdesign.workflow import design, investigate
from tests.systems.switched import random_switched, valve


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_bounds_hold_whatever_maps_outputs_and_inputs_modes_have(seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem = random_switched(rng, "interval")
    made = investigate(problem).design
    assert made is not None
    observer = from_design(made)
    for disturbance in ("extreme", "random", "sine"):
        run = simulate(problem.plant, disturbance=disturbance, rng=rng, until=10, step=0.05)
        y, x = run.block("y").copy(), run.block("x")
        y[rng.random(len(y)) < 0.1] = np.nan
        batch = observer.run_batch(
            run.t, y, run.block("u"), mode=run.mode, lower=x[0] - 1, upper=x[0] + 0.5
        )
        room = 1e-12 * (1 + np.abs(x))
        assert (batch.lower <= x + room).all()
        assert (x - room <= batch.upper).all()


def test_an_unreported_change_of_mode_is_contradicted() -> None:
    made = design(valve())
    run = simulate(valve().plant, until=60, step=0.05, initial=[30, 20])
    x = run.block("x")
    fixed = ["open"] + [None] * (len(run.t) - 1)
    batch = from_design(made).run_batch(
        run.t, run.block("y"), mode=fixed, lower=x[0] - 1, upper=x[0] + 1
    )
    outside = (batch.lower > x) | (x > batch.upper)
    assert outside.any()
    assert batch.status[-1] != "ok"


@pytest.mark.parametrize("kind", ["interval", "luenberger"])
def test_modes_that_differ_in_name_alone_are_no_modes(kind: str) -> None:
    A, L = [[-0.6, 0.1], [0.5, -0.4]], [[0.1], [2]]
    box = {"lower": [-0.01, -0.01], "upper": [0.01, 0.01]}
    output = {"C": [[0, 1]], "noise_bound": 0.01}
    observer = {"kind": kind, "gains": {"L": L}}
    flow = {"A": A, "disturbance": box}
    plain = Problem(flow=flow, output=output, observer=observer)
    modes = [{"name": name, "every": [1, 3]} for name in ("one", "two")]
    named = Problem(flow=flow, output=output, observer=observer, mode=modes)
    run = simulate(named.plant, until=20, step=0.05)
    start = {"x": [0, 0]} if kind == "luenberger" else {"lower": [0, 0], "upper": [2, 2]}
    assert len(set(run.mode or ())) == 2
    single = from_design(design(plain)).run_batch(run.t, run.block("y"), **start)
    several = from_design(design(named)).run_batch(run.t, run.block("y"), mode=run.mode, **start)
    for name in ("x", "lower", "upper"):
        first, second = getattr(single, name), getattr(several, name)
        assert (first is None) == (second is None)
        if first is not None:
            np.testing.assert_array_equal(first, second)
    assert set(several.status) == {"ok"}


def test_new_bounds_end_a_refutation_in_the_mode_that_holds() -> None:
    observer = from_design(design(valve()))
    assert isinstance(observer, SwitchedIntervalObserver)
    run = simulate(valve().plant, until=60, step=0.05, initial=[30, 20])
    samples = list(samples_of(Columns.from_arrays(run.t, run.block("y"), mode=run.mode)))
    x, place = run.block("x"), (run.mode or []).index("closed") + 5
    state = observer.init(0.0, lower=x[0] - 20, upper=x[0] - 10)  # x is outside
    for sample in samples[: place + 1]:
        state, estimate = observer.step(state, sample)
    assert "void since" in estimate.status
    again = observer.reset(state, lower=x[place] - 1, upper=x[place] + 1)
    assert again._replace(inner=state.inner) == state  # the mode and the time of entry
    outside, statuses = [], set()
    for sample, truth in zip(samples[place + 1 :], x[place + 1 :], strict=True):
        state, refuted = observer.step(state, sample)
        assert "void since" in refuted.status
        again, estimate = observer.step(again, sample)
        assert estimate.lower is not None
        assert estimate.upper is not None
        statuses.add(estimate.status)
        outside.append(((estimate.lower > truth) | (truth > estimate.upper)).any())
    assert not any(outside)
    assert statuses == {"ok"}
    with pytest.raises(ValueError, match="exceeds upper"):
        observer.reset(again, lower=[1, 1], upper=[0, 0])


@pytest.mark.parametrize("kind", ["interval", "luenberger"])
def test_guard_of_stays_and_successors(kind: str) -> None:
    body = valve(kind=kind).to_dict()
    third = {**body["mode"][0], "name": "half", "next": ["open"]}
    body["mode"] = [{**body["mode"][0], "next": ["closed"]}, body["mode"][1], third]
    made = design(Problem.from_dict(body))
    observer = from_design(made)
    modes = [
        (0.0, "open"), (0.5, "closed"), (1.0, "open"), (5.0, "half"), (9.0, None), (15.5, None),
        (16.0, "open"), (17.0, "open"), (18.5, "closed"),
    ]  # fmt: skip
    start = {"x": [0, 0]} if kind == "luenberger" else {"lower": [-9, -9], "upper": [9, 9]}
    state = observer.init(0.0, **start)  # type: ignore[attr-defined]
    statuses = []
    for t, mode in modes:
        state, estimate = observer.step(state, Sample(t, [0.0], mode=mode))
        statuses.append([x for x in estimate.status.split("; ") if "stay" in x or "follow" in x])
    assert statuses[0] == statuses[1] == []  # how long the first one lasted is not known
    assert statuses[2] == ["stay 0.5 in closed below 1"]
    assert statuses[3] == ["half does not follow open"]
    assert statuses[4] == []
    assert statuses[5] == ["stay 10.5 in half above 10"]
    assert statuses[6] == ["stay 11 in half above 10"]
    assert statuses[7] == []  # the same mode written again is no change
    assert statuses[8] == []
    # the stay in which a record begins has lasted that long at least
    state = observer.init(0.0, **start)  # type: ignore[attr-defined]
    for t in (0.0, 10.0, 10.5):
        state, estimate = observer.step(state, Sample(t, [0.0], mode="open"))
        assert ("stay 10.5 in open above 10" in estimate.status) == (t > 10)
    with pytest.raises(ValueError, match="bounds of a row"):
        observer.step(state, Sample(11.0, [0.0], bounds=Bounds()))


def test_modes_that_a_design_does_not_have() -> None:
    observer = from_design(design(valve()))
    state = observer.start(0.0, [-1, 1, -1, 1])
    with pytest.raises(ValueError, match="the first sample must name its mode"):
        observer.step(state, Sample(0.0, [0.0]))
    with pytest.raises(ValueError, match="mode must be one of open, closed; got 'ajar'"):
        observer.step(state, Sample(0.0, [0.0], mode="ajar"))


@pytest.mark.parametrize("kind", ["interval", "luenberger"])
def test_a_run_in_parts_gives_the_same_rows(tmp_path: Path, kind: str) -> None:
    from obsdesign.data.csv_text import table_text

    made, path = design(valve(kind=kind)), tmp_path / "design.json"
    made.save(path)
    run = simulate(valve().plant, until=40, step=0.5)
    lines = table_text(run.columns).splitlines()
    header, rows = lines[0], lines[1:]
    initial = [-2, 2, -2, 2] if kind == "interval" else None
    # the mode is written where it changes alone
    names = [row.rsplit(",", 1) for row in rows]
    before = [None, *(name for _, name in names)]
    rows = [
        f"{cells},{'' if name == last else name}"
        for (cells, name), last in zip(names, before, strict=False)
    ]
    (tmp_path / "all.csv").write_text("\n".join([header, *rows]) + "\n")
    execute(str(path), str(tmp_path / "all.csv"), str(tmp_path / "all_est.csv"), initial, None)
    whole = (tmp_path / "all_est.csv").read_text().splitlines()
    parts, state = [whole[0]], tmp_path / "state.json"
    for k, part in enumerate((rows[:33], rows[33:])):
        (tmp_path / "part.csv").write_text("\n".join([header, *part]) + "\n")
        execute(
            str(path), str(tmp_path / "part.csv"), str(tmp_path / "est.csv"),
            None if k else initial, None, state=str(state),
        )  # fmt: skip
        parts += (tmp_path / "est.csv").read_text().splitlines()[1:]
    assert parts == whole


@pytest.mark.parametrize(
    ("entry", "other"),
    [
        ("A", [[-1.2, 0.1], [0.5, -0.4]]), ("every", [2.0, 11.0]), ("next", "closed+open"),
        ("G", [[0.5, 0.0], [0.0, 0.5]]), ("noise_bound", [0.001]), ("flow_upper", [0.0, 0.0]),
    ],
)  # fmt: skip
def test_gains_of_other_modes_do_not_run(entry: str, other: object) -> None:
    made = design(valve())
    gains = {"modes": [dict(mode) for mode in made.gains["modes"]]}
    gains["modes"][0][entry] = other
    with pytest.raises(ValueError, match=r"gains\.modes differ from problem\.mode"):
        from_design(replace(made, gains=gains))


def test_gains_of_the_stated_modes_run_however_they_are_stated() -> None:
    body = valve(kind="luenberger").to_dict()
    (sensor,) = body["sensor"]
    sensor["noise_bound"] = [[-0.01, 0.03]]
    body["mode"][0] |= {"G": [[1, 0], [0, 1]], "next": ["closed"]}
    body["mode"][1] |= {"every": [2, "inf"], "next": [], "A": [[-0.1, 0], [0, -0.3]],
                        "disturbance": {"lower": [-1, 0], "upper": [0, 1]}}  # fmt: skip
    assert from_design(design(Problem.from_dict(body))).names == ("x1", "x2")


@pytest.mark.parametrize("place", [-1, 2])
def test_a_stored_mode_is_one_of_the_design(place: int) -> None:
    made = design(valve())
    observer = from_design(made)
    state, _ = observer.step(observer.start(0.0, [-1, 1, -1, 1]), Sample(0.0, [0.0], mode="closed"))
    body = json.loads(state_text(made, Progress(state)))
    assert body["progress"][0]["mode"] == 1
    body["progress"][0]["mode"] = place
    text = json.dumps(body | {"digest": digest(body)})
    with pytest.raises(InputError, match=r"state\.mode must be from 0 to below 2; got"):
        progress_from_text(text, made, observer, "s.json")
