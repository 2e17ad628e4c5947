"""Rows with some of their outputs: used where a kind can, missing as a whole where it cannot."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.arrays import Matrix
from obsdesign.data.execution import execute
from obsdesign.data.layout import Layout
from obsdesign.data.records import read_samples
from obsdesign.data.simulation import simulate
from obsdesign.data.stream import estimates_of
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.studies.comparison.compare import compare_with_kalman
from obsdesign.studies.comparison.record import ComparisonRecord

PERIOD, ROWS, PARTIAL = 0.1, 40, (7, 8, 21, 33)
FLOW: dict[str, Any] = {
    "A": [[-1, 0.4], [1, -2]],
    "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]},
}
OUTPUT: dict[str, Any] = {
    "C": [[1, 0], [0, 1]], "noise_bound": 0.05, "measured": "periodic", "period": PERIOD,
}  # fmt: skip
PULSES: dict[str, Any] = {
    "flow": {"A": [[-0.5, 0], [1, -0.8]]},
    "jump": {"H": [[1], [0]], "dwell_time": [2.5, "inf"]},
    "output": OUTPUT | {"noise_bound": 0.0},
    "observer": {
        "kind": "impulsive_input", "poles": [-1, -2], "window": 2.0, "margin": 0.5,
        "exponents": [-2, -3, -4, -5],
    },
}  # fmt: skip
# of every kind a plant with two outputs
PLANTS: dict[str, dict[str, Any]] = {
    "set_membership": {"observer": {"kind": "set_membership", "window": 8, "fixed_lag": 2}},
    "interval": {"observer": {"kind": "interval", "gains": {"L": [[0.1, 0], [0, 0.1]]}}},
    "luenberger": {
        "output": {"C": [[1, 0], [0, 1]]},
        "observer": {"kind": "luenberger", "poles": [-3, -4]},
    },
    "finite_time": {"observer": {"kind": "finite_time", "window": 0.5}},
    "impulsive": {
        "jump": {"dwell_time": [PERIOD, PERIOD]},
        "output": {"C": [[1, 0], [0, 1]], "measured": "at_jumps"},
        "observer": {"kind": "impulsive", "window": 2},
    },
    "impulsive_input": PULSES,
    "unknown_input": {
        "flow": {"A": FLOW["A"], "D": [[1], [0]]},
        "observer": {"kind": "unknown_input", "poles": [-2]},
    },
}


def problem_of(kind: str) -> Problem:
    return Problem.from_dict({"flow": FLOW, "output": OUTPUT, **PLANTS[kind]})


def record_of(problem: Problem, *, partial: str) -> str:
    """A data file; partial: y1 and y2 of some rows as they stand there, "" for all there is."""
    run = simulate(problem.plant, until=PERIOD * ROWS, step=PERIOD, rng=np.random.default_rng(2))
    names = ["t", "y1", "y2", *(["jump"] if "jump" in run.columns else [])]
    lines = [",".join(names)]
    for k, row in enumerate(zip(*(run.columns[name].tolist() for name in names), strict=True)):
        t, y1, y2, *jump = ("" if np.isnan(value) else repr(value) for value in row)
        if k in PARTIAL and partial:
            y1, y2 = partial.replace("y1", y1).replace("y2", y2).split(",")
        lines.append(",".join([t, y1, y2, *jump]))
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A design of every kind, KIND.json."""
    path = tmp_path_factory.mktemp("partial")
    for kind in PLANTS:
        problem = problem_of(kind)
        obsdesign.design(problem, allow_undecided=True).save(path / f"{kind}.json")
    return path


def initial(kind: str) -> list[float] | None:
    return [-1.0, 1.0] * 2 if kind in ("interval", "set_membership") else None


def ran(folder: Path, kind: str, text: str, state: str | None = None) -> list[str]:
    """Lines of the estimate file of a data file."""
    (folder / "data.csv").write_text(text)
    start = None if state is not None and Path(state).exists() else initial(kind)
    design, data, out = (str(folder / x) for x in (f"{kind}.json", "data.csv", "est.csv"))
    execute(design, data, out, start, None, state=state)
    return (folder / "est.csv").read_text().splitlines()


@pytest.mark.parametrize("partial", ["y1,", ",y2"])
@pytest.mark.parametrize("kind", [kind for kind in PLANTS if kind != "set_membership"])
def test_other_kinds_miss_the_sample_as_a_whole(folder: Path, kind: str, partial: str) -> None:
    problem = problem_of(kind)
    part, none = (record_of(problem, partial=x) for x in (partial, ","))
    assert part != none
    own = ran(folder, kind, part)
    assert own == ran(folder, kind, none)
    assert own != ran(folder, kind, record_of(problem, partial=""))


def bounds_of(lines: list[str]) -> tuple[Matrix, list[str]]:
    cells = [line.split(",") for line in lines[1:]]
    return np.array([[float(x) for x in row[1:5]] for row in cells]), [row[-1] for row in cells]


@pytest.mark.parametrize(("partial", "absent"), [("y1,", "y2"), (",y2", "y1")])
def test_bounds_use_the_outputs_that_are_there(folder: Path, partial: str, absent: str) -> None:
    kind = "set_membership"
    problem = problem_of(kind)
    text = record_of(problem, partial=partial)
    own, statuses = bounds_of(ran(folder, kind, text))
    whole, _ = bounds_of(ran(folder, kind, record_of(problem, partial="")))
    none, _ = bounds_of(ran(folder, kind, record_of(problem, partial=",")))
    assert {k for k, status in enumerate(statuses) if status != "ok"} == set(PARTIAL)
    assert {statuses[k] for k in PARTIAL} == {f"missing sample of {absent}"}
    here, rows = (0 if partial == "y1," else 1), list(PARTIAL)
    width, without = (x[rows, 1::2] - x[rows, ::2] for x in (own, none))
    assert (width <= without * (1 + 1e-3)).all()
    assert width[:, here].mean() < 0.9 * without[:, here].mean()
    assert (whole[rows, 1::2] - whole[rows, ::2] <= width * (1 + 1e-3)).all()
    for k in range(len(own)):  # both contain the state
        assert (np.maximum(own[k, ::2], whole[k, ::2]) <= np.minimum(
            own[k, 1::2], whole[k, 1::2])).all()  # fmt: skip


def test_every_door_reads_them_alike(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file, which is what `report` runs on, a pipe, a record in parts, and `compare`."""
    kind = "set_membership"
    problem, design = problem_of(kind), obsdesign.load_design(folder / f"{kind}.json")
    text = record_of(problem, partial="y1,")
    own = ran(folder, kind, text)
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    with redirect_stdout(io.StringIO()) as printed:
        execute(str(folder / f"{kind}.json"), None, None, initial(kind), None)
    assert printed.getvalue().splitlines() == own
    head, lines = text.splitlines()[0], text.splitlines()[1:]
    state = str(tmp_path / "state.json")
    parts = []
    for rows in (lines[:8], lines[8:]):
        parts += ran(folder, kind, "\n".join([head, *rows]) + "\n", state)[1:]
    assert parts == own[1:]
    path = tmp_path / "data.csv"
    path.write_text(text)
    record = ComparisonRecord.from_file(str(path), problem)
    assert [k for k, x in enumerate(record.samples) if np.isnan(x.y).any()] == list(PARTIAL)
    start = [-1.0, 1.0] * 2
    row, filtered = compare_with_kalman([design], record, start)
    statuses = [line.split(",")[-1] for line in own[1:]]
    assert row.without == sum(status != "ok" for status in statuses)
    assert filtered.seconds is not None


def samples(text: str) -> Iterator[Any]:
    return read_samples(io.StringIO(text), Layout(2), "data")


def test_a_row_without_any_output_has_none(folder: Path) -> None:
    first, second, third = samples("t,y1,y2\n0,,\n1,2,\n2, ,3\n")
    assert first.y is None
    assert np.array_equal(second.y, [2, np.nan], equal_nan=True)
    assert np.array_equal(third.y, [np.nan, 3], equal_nan=True)
    design = obsdesign.load_design(folder / "interval.json")
    observer = from_design(design)
    state = observer.start(0.0, [-1.0, 1.0] * 2)
    rows = samples("t,y1,y2\n0,0,0\n0.1,0,\n")
    assert [e.status for e in estimates_of(observer, state, rows)] == ["ok", "missing sample"]
