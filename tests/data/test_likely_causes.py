"""Complaints about data and files that name the likely cause."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from obsdesign.cli.commands import cli
from obsdesign.errors import InputError
from tests.systems.designs import designed

PROBLEM: dict[str, Any] = {
    "flow": {"A": [[-1, 0], [1, -2]]},
    "jump": {"G": [[0.5, 0], [0, 0.5]], "dwell_time": [0.7, 2]},
    "output": {"C": [[0, 1]], "noise_bound": [0.03]},
    "observer": {"kind": "interval"},
}


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("design") / "d.json"
    designed(PROBLEM).save(path)
    return str(path)


def ran(*words: str) -> Any:
    return CliRunner().invoke(cli, [*words], standalone_mode=False)


def record(folder: Path, *lines: str) -> str:
    path = folder / "data.csv"
    path.write_text("\n".join(["t,y1,jump", *lines]) + "\n")
    return str(path)


@pytest.mark.parametrize(
    ("line", "cause"),
    [
        ("2026-01-01T00:00:00,0.1,0",
         "Times are numbers in the time unit of flow.A, not dates or clock times."),
        ("09:30:00,0.1,0",
         "Times are numbers in the time unit of flow.A, not dates or clock times."),
        ('0,"0,1",0', "Decimals have a point."),
        ("0,0,1,0", "3 values are required, one per column; got 4. Is the decimal sign a comma?"),
        ("abc,0.1,0", "t must be a finite number; got 'abc'."),
    ],
)  # fmt: skip
def test_a_cell_that_is_no_number(design: str, tmp_path: Path, line: str, cause: str) -> None:
    done = ran("run", design, record(tmp_path, line), "--initial", "0,1,0,1")
    assert isinstance(done.exception, InputError)
    assert str(done.exception).endswith(cause)


@pytest.mark.parametrize(("factor", "is_remarked"), [(1, False), (20, False), (1000, True)])
def test_time_stamps_in_another_unit(
    design: str, tmp_path: Path, factor: float, is_remarked: bool
) -> None:
    lines = [f"{factor * k / 4},0.1,{int(k % 4 == 0)}" for k in range(20)]
    done = ran("run", design, record(tmp_path, *lines), "--initial", "0,1,0,1")
    remark = (
        f"data.csv: jumps are {factor:g} apart and jump.dwell_time is [0.7, 2]. Are the time "
        "stamps in the time unit of flow.A?"
    )
    assert (remark in done.stderr) is is_remarked


def test_a_period_in_another_unit(tmp_path: Path) -> None:
    body = PROBLEM | {"output": {**PROBLEM["output"], "measured": "periodic", "period": 0.1}}
    body = {key: entry for key, entry in body.items() if key != "jump"}
    design = tmp_path / "p.json"
    designed(body).save(design)
    slow, right = ([f"{step * k:g},0.1,0" for k in range(9)] for step in (100, 0.1))
    for lines, count in ((slow, 1), (right, 0)):
        done = ran("run", str(design), record(tmp_path, *lines), "--initial", "0,1,0,1")
        text = "rows are 100 apart and output.period is 0.1. Are the time stamps in the time unit"
        assert done.stderr.count(text) == count


def test_a_problem_file_and_a_design_file_are_told_apart(design: str, tmp_path: Path) -> None:
    toml, plain = tmp_path / "p.toml", tmp_path / "p.json"
    toml.write_text("[flow]\nA = [[-1]]\n[output]\nC = [[1]]\n")
    plain.write_text(json.dumps(PROBLEM))
    for path in (toml, plain):
        line = f"{path}: a design file is required; this is a problem file. `obsdesign design {path}` designs it."
        assert str(ran("verify", str(path)).exception) == line
    line = f"{design}: a problem file is required; this is a design. `obsdesign verify {design}` proves it again."
    assert str(ran("check", design).exception) == line


def test_a_kind_that_is_nearly_right(tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    path.write_text(json.dumps(PROBLEM))
    near, far = (str(ran("design", str(path), "--kind", k).exception) for k in ("luenburger", "x"))
    assert near.endswith("got 'luenburger'. Did you mean 'luenberger'?")
    assert far.endswith("got 'x'.")
