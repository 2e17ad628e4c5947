"""Columns of named events and sensors: blank where nothing happened."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from obsdesign.cli.commands import cli
from obsdesign.data.clock_columns import ClockColumns
from obsdesign.data.csv_text import table_text
from obsdesign.data.layout import Layout
from obsdesign.data.records import read_samples
from obsdesign.data.simulation import simulate
from obsdesign.errors import InputError
from obsdesign.kinds import TAKING_CLOCKS
from obsdesign.problem.problem import Problem
from obsdesign.runtime.base import Sample
from tests.systems.clocks import DOSES
from tests.systems.designs import designed

HEADER = "t,plasma,tissue,dose,bolus\n"


def samples(text: str, *, may_repeat: bool = True) -> list[Sample]:
    clocks = ClockColumns.from_problem(DOSES)
    layout = Layout(2, 0, 1, True, clocks=clocks, may_repeat=may_repeat)
    return list(read_samples(io.StringIO(text), layout, "data"))


def test_a_row_holds_what_happened() -> None:
    rows = samples(HEADER + "0,,,,\n1,0.5,,,\n2,,3,-0.25,\n3,,,,1\n4,1,2,0,1\n")
    assert [row.jump for row in rows] == [False, False, True, True, True]
    assert [row.events for row in rows] == [(), (), (0,), (1,), (0, 1)]
    assert rows[0].y is None
    assert np.array_equal(np.array([r.y for r in rows[1:3]]), [[0.5, np.nan], [np.nan, 3]], True)
    assert [np.asarray(row.w).tolist() for row in rows[2::2]] == [[-0.25], [0.0]]


def test_events_may_be_named_in_a_column() -> None:
    header = "t,event,plasma,tissue,dose\n"
    rows = samples(header + "0,bolus,,,\n1,dose+bolus,,,2\n2,,,,3\n")
    assert [row.events for row in rows] == [(1,), (0, 1), (0,)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEADER + "0,,,,2\n", "line 2: bolus must be 1 at the event and empty elsewhere; got 2"),
        (HEADER + "0,,,x,\n", "line 2: dose must be a finite number"),
        (HEADER + "1,,,,\n0,,,,\n", "line 3: t must increase"),
        ("t,plasma,dose,bolus\n0,,,\n", "column 'tissue' is required"),
        ("t,event,plasma,tissue,dose\n0,meal,,,\n", "event must be one of dose, bolus; got 'meal'"),
        ("t,event,plasma,tissue,dose\n0,dose,,,\n", "dose must hold numbers at the event dose"),
    ],
)
def test_a_line_that_no_event_makes_is_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        samples(text)


def test_rows_may_share_a_time_where_several_clocks_run() -> None:
    text = HEADER + "0,,,,\n1,0.5,,,\n1,,,,1\n1,,3,,\n"
    assert [row.t for row in samples(text)] == [0.0, 1.0, 1.0, 1.0]
    with pytest.raises(InputError, match="t must increase"):
        samples(text, may_repeat=False)


def test_columns_like_those_of_sensors_are_remarked_on(tmp_path: Path) -> None:
    remarks: list[str] = []
    layout = Layout(2, 0, 1, True, clocks=ClockColumns.from_problem(DOSES))
    text = "t,plasma,tissue,dose,bolus,plasm,y1,x1,status\n0,,,,,1,1,1,ok\n"
    list(read_samples(io.StringIO(text), layout, "data", remark=remarks.append))
    assert len(remarks) == 1
    assert "plasm, y1 of the header are not used" in remarks[0]


def test_a_simulated_record_is_read_back(tmp_path: Path) -> None:
    run = simulate(Problem.from_dict(DOSES).plant, rng=np.random.default_rng(5))
    rows = samples(table_text(run.columns))
    y = [np.full(2, np.nan) if row.y is None else np.asarray(row.y) for row in rows]
    assert np.array_equal(np.array(y), run.block("y"), equal_nan=True)
    assert run.happened is not None
    assert [row.events for row in rows] == [tuple(np.flatnonzero(row)) for row in run.happened]


@pytest.mark.parametrize("kind", TAKING_CLOCKS)
def test_every_command_knows_named_clocks_or_refuses_them_in_a_line(
    kind: str, tmp_path: Path
) -> None:
    body = {**DOSES, "observer": {"kind": kind}}
    design = designed(body, allow_undecided=True)
    path = {name: str(tmp_path / name) for name in ("d.json", "p.json", "a.csv", "e.csv", "r.mat")}
    design.save(path["d.json"])
    Path(path["p.json"]).write_text(json.dumps(body), encoding="utf-8")
    start = "--initial=-2,2,-2,2,-2,2"
    commands: list[tuple[list[str], int]] = [
        (["verify", path["d.json"]], 0),
        (["simulate", path["p.json"], "--until", "60", "-o", path["a.csv"]], 0),
        (["run", path["d.json"], path["a.csv"], start, "-o", path["e.csv"], "--strict"], 0),
        (["plot", path["e.csv"], path["a.csv"], "--design", path["d.json"],
          "-o", str(tmp_path / "e.svg")], 0),
        (["export", path["d.json"], "-o", path["r.mat"]], 0),
        (["report", path["d.json"], "--data", path["a.csv"], start,
          "-o", str(tmp_path / "r.html")], 0),
        (["sweep", path["p.json"], "--over", "event[0].every[0]=6:6:1",
          "-o", str(tmp_path / "s.jsonl")], 0),
        (["compare", path["p.json"], "--data", path["a.csv"], "--kinds", kind], 0),
        (["check", path["p.json"], "--time", "1"], 0),
        (["design", path["p.json"], "--kind", "luenberger", "-o", path["d.json"]], 2),
        (["search", path["p.json"], "--for", "shortest_dwell"], 2),
    ]  # fmt: skip
    for arguments, code in commands:
        done = CliRunner().invoke(cli, arguments)
        if code == 0:
            assert done.exit_code == 0, (arguments, done.output)
        else:
            assert isinstance(done.exception, InputError)
            assert "\n" not in str(done.exception)
    assert "2 events (dose, bolus)" in (tmp_path / "r.html").read_text("utf-8")
