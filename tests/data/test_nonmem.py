"""NONMEM data sets as data files: doses, samples, infusions, resets, subjects."""

from __future__ import annotations

import copy
import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

import obsdesign
from obsdesign import InputError
from obsdesign.cli.commands import cli
from obsdesign.data.csv_text import table_text
from obsdesign.problem.problem import Problem
from tests.systems.clocks import DOSES

# absorption, plasma, tissue; a dose into x1, an infusion into x2, two assays
PK: dict[str, Any] = copy.deepcopy(DOSES)
PK["flow"]["B"] = [[0], [1], [0]]
PK["event"] = PK["event"][:1]
NAN = ""


@pytest.fixture(autouse=True)
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("pk.json").write_text(json.dumps(PK), encoding="utf-8")
    return tmp_path


def converted(text: str, *arguments: str) -> Result:
    Path("nm.csv").write_text(text, encoding="utf-8")
    return CliRunner().invoke(cli, ["convert", "nm.csv", *arguments], standalone_mode=False)


def table(path: str = "data.csv") -> list[list[str]]:
    return list(csv.reader(io.StringIO(Path(path).read_text())))


def refusal(text: str, *arguments: str) -> str:
    done = converted(text, *arguments)
    assert isinstance(done.exception, InputError), done.exception
    assert not Path("data.csv").exists()
    assert "\n" not in str(done.exception)
    return str(done.exception)


HAND = """\
ID,TIME,EVID,AMT,RATE,CMT,DV,DVID,MDV,ADDL,II,WT
1,0,1,100,.,1,.,.,1,2,12,70
1,2,0,.,.,.,3.5,1,0,.,.,70
1,2,0,.,.,.,1.25,2,0,.,.,70
1,5,0,.,.,.,9,1,1,.,.,70
1,12,0,.,.,.,2.5,1,0,.,.,70
1,13,1,30,20,2,.,.,1,.,.,70
1,14,1,10,10,2,.,.,1,.,.,70
1,20,2,.,.,.,.,.,1,.,.,70
"""


def test_a_set_made_by_hand() -> None:
    """Additional doses at 12 and 24, before the sample of 12; infusions of 1.5 and 1 hours."""
    done = converted(HAND, "--problem", "pk.json")
    assert done.exception is None, done.exception
    titles, *rows = table()
    assert titles == ["t", "plasma", "tissue", "u1", "dose"]
    assert rows == [
        ["0.0", NAN, NAN, "0.0", "100.0"],
        ["2.0", "3.5", "1.25", "0.0", NAN],
        ["5.0", NAN, NAN, "0.0", NAN],
        ["12.0", NAN, NAN, "0.0", "100.0"],
        ["12.0", "2.5", NAN, "0.0", NAN],
        ["13.0", NAN, NAN, "20.0", NAN],
        ["14.0", NAN, NAN, "30.0", NAN],
        ["14.5", NAN, NAN, "10.0", NAN],
        ["15.0", NAN, NAN, "0.0", NAN],
        ["20.0", NAN, NAN, "0.0", NAN],
        ["24.0", NAN, NAN, "0.0", "100.0"],
    ]


def test_without_a_plant_columns_are_numbered() -> None:
    assert converted(HAND).exception is None
    assert table()[0] == ["t", "dv1", "dv2", "u1", "dose"]
    lean = "TIME,AMT,DV\n0,5,.\n1,.,2\n1.5,0,2.5\n"
    assert converted(lean).exception is None
    assert table() == [["t", "dv", "dose"], ["0.0", NAN, "5.0"], ["1.0", "2.0", NAN],
                       ["1.5", "2.5", NAN]]  # fmt: skip


def test_subjects_and_resets_have_files_of_their_own() -> None:
    text = (
        "ID,TIME,EVID,AMT,DV,ADDL,II\n1,0,1,5,.,9,10\n1,12,0,.,1,.,.\n1,25,3,.,.,.,.\n"
        "# a comment\n1,26,0,.,2,.,.\n2,0,1,7,.,.,.\n2,1,0,.,3,.,.\n2,0,4,8,.,.,.\n2,2,0,.,4,.,.\n"
    )
    done = converted(text, "-o", "out.csv")
    assert done.exception is None
    own = {p.name: [row[0] for row in table(p.name)[1:]] for p in Path().glob("out*.csv")}
    assert own == {
        "out_1.csv": ["0.0", "10.0", "12.0", "20.0"],  # the reset ends what was to be given
        "out_1_2.csv": ["25.0", "26.0"],
        "out_2.csv": ["0.0", "1.0"],
        "out_2_2.csv": ["0.0", "2.0"],
    }
    assert table("out_2_2.csv")[1] == ["0.0", NAN, "8.0"]


def test_a_sample_behind_a_dose_has_a_row_of_its_own() -> None:
    """Before it, it shares the row, unless its sensor sees the state after events."""
    head = "TIME,EVID,AMT,DV,DVID,CMT\n"
    before = "1,0,.,3,{},.\n1,1,5,.,.,1\n"
    converted(head + before.format(1), "--problem", "pk.json")
    assert table()[1:] == [["1.0", "3.0", NAN, "0.0", "5.0"]]
    converted(head + before.format(2), "--problem", "pk.json")
    assert table()[1:] == [["1.0", NAN, "3.0", "0.0", NAN], ["1.0", NAN, NAN, "0.0", "5.0"]]
    converted(head + "1,1,5,.,.,1\n1,0,.,3,1,.\n", "--problem", "pk.json")
    assert table()[1:] == [["1.0", NAN, NAN, "0.0", "5.0"], ["1.0", "3.0", NAN, "0.0", NAN]]


def test_a_plant_of_jump_and_output() -> None:
    body = {
        "name": "x", "flow": {"A": [[-1, 0], [1, -1]]},
        "jump": {"E": [[1, 0], [0, 1]], "dwell_time": [1, 9]},
        "output": {"C": [[0, 1]], "noise_bound": 0.1},
    }  # fmt: skip
    Path("p.json").write_text(json.dumps(body), encoding="utf-8")
    head = "TIME,EVID,AMT,DV,CMT\n"
    assert converted(head + "0,1,5,.,2\n1,0,.,3,.\n", "--problem", "p.json").exception is None
    assert table() == [
        ["t", "y1", "w1", "w2", "jump"],
        ["0.0", NAN, "0.0", "5.0", "1"],
        ["1.0", "3.0", NAN, NAN, "0"],
    ]
    Path("data.csv").unlink()
    line = refusal(head + "0,1,5,.,2\n0,0,.,3,.\n", "--problem", "p.json")
    assert line.startswith("nm.csv line 3: one row at t = 0 is required")


def test_a_simulation_that_goes_the_long_way_gives_the_same_estimates() -> None:
    """simulate, written as a NONMEM set by hand, converted: the same columns, the same bounds."""
    options = {"kind": "set_membership", "window": 4, "steps": 1}
    problem = Problem.from_dict(PK | {"flow": DOSES["flow"], "observer": options})
    obsdesign.design(problem).save("d.json")
    run = obsdesign.simulate(problem.plant, until=60.0, rng=np.random.default_rng(2))
    run.columns["dose"] = np.abs(run.columns["dose"])
    lines = ["ID,TIME,EVID,AMT,RATE,CMT,DV,DVID,MDV"]
    columns = {name: own.tolist() for name, own in run.columns.items()}
    for k, t in enumerate(columns["t"]):
        lines.append(f"7,{t!r},2,.,.,.,.,.,1")
        for dvid, name in enumerate(("plasma", "tissue"), 1):
            if columns[name][k] == columns[name][k]:
                lines.append(f"7,{t!r},0,.,.,.,{columns[name][k]!r},{dvid},0")
        if columns["dose"][k] == columns["dose"][k]:
            lines.append(f"7,{t!r},1,{columns['dose'][k]!r},.,1,.,.,1")
    assert converted("\n".join(lines) + "\n", "--problem", "d.json").exception is None
    assert np.isfinite(run.columns["dose"]).sum() > 3
    kept = {name: run.columns[name] for name in ("t", "plasma", "tissue", "dose")}
    assert Path("data.csv").read_text() == table_text(kept)
    done = CliRunner().invoke(cli, ["run", "d.json", "data.csv", "--initial=-2,2,-2,2,-2,2",
                                    "-o", "e.csv"], standalone_mode=False)  # fmt: skip
    assert done.exception is None
    assert len(table("e.csv")) == len(run.t) + 1


HEAD = "ID,TIME,EVID,AMT,RATE,CMT,DV,DVID,SS,ADDL,II\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "column TIME is required; the header has nothing"),
        ("ID,TIME,AMT\n1,0,5\n", "column DV is required"),
        ("ID,DATE,TIME,DV\n1,1-1-99,0,5\n", "DATE is not converted"),
        ("TIME,DV,DV\n0,1,1\n", "column DV stands 2 times"),
        ("TIME,DV\n", "at least one line of data is required"),
        ("TIME,DV\n0,1\n0,1,2\n", "line 3: 2 values are required, one per column; got 3"),
        ("TIME,DV\n10:30,1\n", "line 2: TIME must be a number; got '10:30'"),
        ("TIME,DV\n.,1\n", "line 2: TIME must be a number; it is empty"),
        (
            "TIME,DVID,DV\n2,1,1\n1,1,1\n",
            "line 3: TIME must not decrease for a subject; got 1 after 2",
        ),
        (HEAD + "1,0,5,.,.,.,.,.,.,.,.\n", "line 2: EVID must be 0, 1, 2, 3 or 4; got 5"),
        (HEAD + "1,0,0.5,.,.,.,.,.,.,.,.\n", "line 2: EVID must be a whole number >= 0; got 0.5"),
        (HEAD + "1,0,0,5,.,1,.,.,.,.,.\n", "EVID must be 1 or 4 where AMT or RATE is given; got 0"),
        (HEAD + "1,0,1,5,-2,1,.,.,.,.,.\n", "RATE must be >= 0; got -2: rates that a model states"),
        (HEAD + "1,0,1,0,5,1,.,.,.,.,.\n", "AMT must be positive; got 0"),
        (HEAD + "1,0,1,-5,.,1,.,.,.,.,.\n", "AMT must be >= 0; got -5"),
        (HEAD + "1,0,1,5,.,1,.,.,1,.,12\n", "doses at steady state (SS) are not converted"),
        (HEAD + "1,0,0,.,.,2,5,.,.,.,.\n1,1,0,.,.,3,7,.,.,.,.\n", "DVID is required where"),
        (HEAD + "1,0,1,5,.,1,.,.,.,3,.\n", "II must be positive where ADDL is; got 0"),
        (HEAD + "1,0,1,5,.,3,.,.,.,.,.\n", "CMT must be one of the plant's inputs of events (1)"),
        (HEAD + "1,0,1,5,2,1,.,.,.,.,.\n", "CMT must be one of the plant's inputs u of infusions"),
        (HEAD + "1,0,0,.,.,.,5,3,.,.,.\n", "DVID must be one of the plant's outputs (1, 2); got 3"),
        (HEAD + "1,0,0,.,.,.,5,.,.,.,.\n", "DVID must be one of the plant's outputs (1, 2); got n"),
    ],
)
def test_a_line_that_cannot_be_converted_is_named(text: str, words: str) -> None:
    assert words in refusal(text, "--problem", "pk.json")


def test_nothing_is_overwritten_that_is_read() -> None:
    assert "one of the files that are read" in refusal(HAND, "-o", "nm.csv")
    assert "cannot be read" in str(
        CliRunner().invoke(cli, ["convert", "none.csv"], standalone_mode=False).exception
    )
    Path("bad.csv").write_bytes(b"TIME,DV\n\xff,1\n")
    done = CliRunner().invoke(cli, ["convert", "bad.csv"], standalone_mode=False)
    assert "a text file with commas is required" in str(done.exception)
