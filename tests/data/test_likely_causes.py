"""Complaints about data and files that name the likely cause."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from obsdesign.cli.commands import cli
from obsdesign.errors import InputError
from obsdesign.notebook import run
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


SENSOR: dict[str, Any] = {
    "flow": {"A": [[-1.0]], "disturbance": {"lower": [-0.1], "upper": [0.1]}},
    "sensor": [
        {"name": "level", "C": [[1.0]], "noise_bound": 0.1, "every": 0.5, "losses": 2},
    ],
    "observer": {"kind": "interval"},
}


@pytest.fixture(scope="module")
def of_sensor(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("sensor") / "s.json"
    designed(SENSOR).save(path)
    return str(path)


def sensed(folder: Path, *lines: str) -> str:
    path = folder / "sensed.csv"
    path.write_text("\n".join(["t,level", *lines]) + "\n")
    return str(path)


@pytest.mark.parametrize(("factor", "is_remarked"), [(1, False), (3, False), (60, True)])
def test_samples_of_a_sensor_in_another_unit_of_time(
    of_sensor: str, tmp_path: Path, factor: float, is_remarked: bool
) -> None:
    rows = [f"{0.5 * k * factor},0.0" for k in range(12)]
    done = ran("run", of_sensor, sensed(tmp_path, *rows), "--initial=-1,1")
    words = "samples of level are 30 apart and sensor.level.every is 0.5. Are the time stamps"
    assert (words in done.stderr) is is_remarked


@pytest.mark.parametrize(("first", "spike"), [("9.0", "0.0"), ("0.0", "9.0")])
def test_void_bounds_name_what_happened(
    of_sensor: str, tmp_path: Path, first: str, spike: str
) -> None:
    """The first sample against --initial, or a later one against all before it."""
    rows = [f"2.5,{first}", f"3,{spike}", *(f"{3.5 + 0.5 * k},0.0" for k in range(8))]
    done = ran("run", of_sensor, sensed(tmp_path, *rows), "--initial=-1,1")
    is_first = first != "0.0"
    assert ("the first row, t = 2.5, contradicts --initial" in done.stderr) is is_first
    later = "the last before t = 3.5. Is its sample an outlier (leave the cell empty)"
    assert (later in done.stderr) is not is_first


def test_late_rows_and_a_slip_in_rename(of_sensor: str, tmp_path: Path) -> None:
    done = ran("run", of_sensor, sensed(tmp_path, "0,0", "1,0", "0.5,0"), "--initial=-1,1")
    assert "A row that arrives late needs report_delay" in str(done.exception)
    path = tmp_path / "named.csv"
    path.write_text("t,temp\n0,0\n")
    words = ("run", of_sensor, str(path), "--initial=-1,1", "--rename")
    done = ran(*words, "temp=lvel")
    assert "--rename names a column 'lvel'" in str(done.exception)
    assert ran(*words, "temp=level").exception is None


@pytest.mark.parametrize("initial", [[[-1.0], [1.0]], {"level": 1.0}, ["a", "b"], 3.0])
def test_initial_that_is_no_list_of_numbers(of_sensor: str, initial: Any) -> None:
    with pytest.raises(InputError, match="initial must be a list of numbers"):
        run(of_sensor, {"t": [0.0], "level": [0.0]}, initial=initial)
    assert run(of_sensor, {"t": [0.0], "level": [0.0]}, initial=[-1.0, 1.0]).status == ["ok"]
