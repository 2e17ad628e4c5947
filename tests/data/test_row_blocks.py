"""Rows that are read and taken together are those of one line after the other."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

import obsdesign
from obsdesign import Problem
from obsdesign.data.layout import Layout
from obsdesign.data.plain_rows import PlainRows
from obsdesign.data.record_header import Header
from obsdesign.data.records import read_blocks, read_samples, samples_in
from obsdesign.errors import InputError
from obsdesign.runtime.base import Sample
from obsdesign.runtime.columns import Columns
from tests.data.test_run_in_parts import ran

LAYOUT = Layout(y=2, u=1, w=1, jump=True)
TITLES = "t,y1,y2,u1,w1,jump"


def plain(*lines: str, titles: str = TITLES, layout: Layout = LAYOUT) -> Columns | None:
    """Rows of lines, read together."""
    header = Header.from_line(titles, layout, "data")
    assert header.plain is not None
    return header.plain.record([line + "\n" for line in lines], -np.inf)


def as_text(samples: list[Sample]) -> list[str]:
    return [repr([None if x is None else np.asarray(x).tolist() for x in s[:5]]) for s in samples]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_block_has_the_rows_of_its_lines(end: str) -> None:
    lines = ["0,1,2,0.5,,0", " 0.1 ,1e-3,, .5,7,1", "0.25,,,0.5,3,0", "1e0,-0.0,+2,5e-1,8,1.0"]
    text = end.join([TITLES, *lines, ""])
    header = Header.from_line(TITLES, LAYOUT, "data")
    one_by_one, previous = [], -np.inf
    for number, line in enumerate(lines, start=2):
        sample = header.row(number, line + end, previous, is_first=False)
        assert sample is not None
        # a row without a jump has no use for w
        one_by_one.append(sample if sample.jump else sample._replace(w=np.array([0.0])))
        previous = sample.t
    (block,) = read_blocks(io.StringIO(text, newline=""), LAYOUT, "data")
    assert isinstance(block, Columns)
    own = [s if s.jump else s._replace(w=np.array([0.0])) for s in samples_in([block])]
    assert as_text(own) == as_text(one_by_one)


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("0.1,1_0,2,0,1,0", "y1 must be a finite number"),
        ("0.1,nan,2,0,1,0", "y1 must be a finite number"),
        ("0.1,1,-inf,0,1,0", "y2 must be a finite number"),
        ("0.1,1,2e150,0,1,0", "y2 must be at most"),
        ("0.1,1,2,0,1,0.5", "jump must be 0 or 1"),
        ("0.1,1,2,0,,1", "w1 is required at a jump"),
        ("0.1,1,2,0,1,", "jump must be 0 or 1"),
        (",1,2,0,1,0", "t must be a finite number"),
        ("0,1,2,0,1,0", "t must increase"),
        ("0.1,1,2,0,1", "6 values are required"),
        ("0.1,1,2,0,1,0,7", "6 values are required"),
        ("0.1,\u0661,2,0,1,0", "y1 must be a finite number"),
        ('0.1,"1,2,0,1,0', "not valid CSV"),
    ],
)
def test_a_line_that_is_none_is_left_to_the_reader_of_lines(line: str, complaint: str) -> None:
    text = "\n".join([TITLES, "0,1,2,0,1,0", line, "0.2,1,2,0,1,0", ""])
    assert plain("0,1,2,0,1,0", line) is None
    with pytest.raises(InputError, match=f"data line 3: {complaint}"):
        list(read_samples(io.StringIO(text), LAYOUT, "data"))
    # the twin
    assert plain("0,1,2,0,1,0", "0.1,1,2,0,1,0") is not None


@pytest.mark.parametrize("line", ["0.1,1,2,,1,0", '0.1,"1",2,0,1,0', "", "  "])
def test_a_row_that_is_none_by_itself_is_read_alone(line: str) -> None:
    """An input that holds, a cell in quotes, an empty line."""
    assert plain("0,1,2,0,1,0", line) is None
    text = "\n".join([TITLES, "0,1,2,0,1,0", line, "0.2,1,2,0,1,0", ""])
    rows = list(read_samples(io.StringIO(text), LAYOUT, "data"))
    assert [row.t for row in rows] == ([0.0, 0.1, 0.2] if line.strip() else [0.0, 0.2])


def test_columns_that_say_more_are_read_line_by_line() -> None:
    modes = Layout(y=1, modes=("open", "shut"))
    assert PlainRows.from_header(["t", "y1", "mode"], {"t": 0, "y1": 1, "mode": 2}, modes) is None
    no_jumps = Layout(y=1)
    assert plain("0,1,0", "1,1,1", titles="t,y1,jump", layout=no_jumps) is None
    assert plain("0,1,0", "1,1,0.0", titles="t,y1,jump", layout=no_jumps) is not None


ROWS = 2500  # more than two blocks


def record(*, has_jump: bool, is_regular: bool) -> list[str]:
    rng = np.random.default_rng(3)
    steps = np.full(ROWS, 0.05) if is_regular else rng.uniform(0.02, 0.08, ROWS)
    times = np.cumsum(steps)
    t, y = times.tolist(), (0.01 * rng.uniform(-1, 1, ROWS)).tolist()
    jump = np.arange(ROWS) % 17 == 16
    cells: list[str] = []
    for k in range(ROWS):
        measured = "" if k % 501 == 500 else repr(y[k])
        cells.append(f"{t[k]!r},{measured}" + (f",{int(jump[k])}" if has_jump else ""))
    return [line + "\n" for line in cells]


PUSHED = {"A": [[-1.0, 0.5], [0.3, -2.0]],
          "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]}}  # fmt: skip
PLANTS = {
    "interval": {"gains": {"L": [[1.0], [0.2]], "M": [[0.0], [0.0]]}, "form": "split"},
    "luenberger": {"gains": {"L": [[1.0], [0.2]], "M": [[0.1], [0.0]]}},
    "unknown_input": {},
}


@pytest.mark.parametrize("is_regular", [True, False])
@pytest.mark.parametrize("kind", list(PLANTS))
def test_a_file_gives_the_lines_of_a_pipe_and_of_its_parts(
    kind: str, is_regular: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    has_jump = kind != "unknown_input"
    flow = PUSHED if has_jump else {"A": PUSHED["A"], "D": [[1.0], [0.0]]}
    jump = {"G": [[0.9, 0.0], [0.0, 1.0]], "dwell_time": [0.2, 2.0]}
    problem = Problem.from_dict({
        "flow": flow, **({"jump": jump} if has_jump else {}),
        "output": {"C": [[1.0, 0.0]], "noise_bound": [0.02]},
        "observer": {"kind": kind, **PLANTS[kind]},
    })  # fmt: skip
    obsdesign.design(problem).save("d.json")
    header = "t,y1,jump\n" if has_jump else "t,y1\n"
    lines = record(has_jump=has_jump, is_regular=is_regular)
    start = ("--initial", "-1,1,-1,1") if kind == "interval" else ()
    Path("all.csv").write_text(header + "".join(lines))
    file = ran("run", "d.json", "all.csv", *start)
    assert (file.exception, file.return_value) == (None, 0)
    pipe = ran("run", "d.json", *start, stdin=header + "".join(lines))
    assert file.stdout == pipe.stdout
    parts = ""
    for k, part in enumerate((lines[:1300], lines[1300:1301], lines[1301:])):
        Path("part.csv").write_text(header + "".join(part))
        initial = () if k else start
        done = ran("run", "d.json", "part.csv", *initial, "--state", "s.json")
        assert (done.exception, done.return_value) == (None, 0)
        parts += done.stdout.split("\n", 1)[1]
    assert parts == file.stdout.split("\n", 1)[1]
