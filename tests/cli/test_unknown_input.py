"""Shipped examples and the command line, from file to estimate."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest

import obsdesign
from docs.figures.unknown_input import fault, record, road
from obsdesign.data.simulation import simulate
from obsdesign.runtime import from_design
from tests.systems.checks import check_kind
from tests.systems.command_line import command

ROOT = Path(__file__).parents[2]
EXAMPLES = [ROOT / "examples" / f"{name}.toml" for name in ("ahn_1", "ahn_2", "quarter_car")]


def cli(*arguments: str, data: str | None = None) -> CompletedProcess[str]:
    return command(*arguments, cwd=ROOT, stdin=data or "")


def table(text: str) -> dict[str, list[str]]:
    rows = list(csv.reader(io.StringIO(text)))
    return {name: [row[i] for row in rows[1:]] for i, name in enumerate(rows[0])}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_an_example_recovers_state_and_input(path: Path) -> None:
    problem = obsdesign.load_problem(path)
    design = obsdesign.design(problem)
    assert obsdesign.verify(design, paranoid=True).verdict == "proved"
    period = problem.plant.output.period
    record = simulate(problem.plant, until=200 * period, disturbance="zero")
    gone = simulate(problem.plant, until=2000 * period, disturbance="zero")
    for run, tolerance in ((record, None), (gone, 0.02)):
        inputs = run.block("u") if problem.plant.flow.B is not None else None
        batch = from_design(design).run_batch(run.t, run.block("y"), inputs)
        assert set(batch.status) == {"ok"}
        if tolerance:
            off = np.abs(batch.x - run.block("x"))[-100:].max()
            assert off < tolerance * max(1.0, np.abs(run.block("x")).max())


def test_the_fault_of_a_quarter_car_is_found() -> None:
    columns = record(
        "quarter_car", [0.0] * 4, lambda t: [fault(t)],
        lambda t: [road(t), 0.3 * float(np.sin(2 * np.pi * 1.5 * t))], 0.001, 5.0,
    )  # fmt: skip
    design = obsdesign.design(obsdesign.load_problem(EXAMPLES[2]))
    y, u = (np.column_stack([columns[f"{c}1"], columns[f"{c}2"]]) for c in "yu")
    batch = from_design(design).run_batch(columns["t"], y, u)
    off = batch.d[1:, 0] - columns["d1"][:-1]  # d is held from a row on
    quiet = (columns["t"][1:] > 0.1) & (np.abs(columns["t"][1:] - 2) > 0.05)
    assert np.sqrt(np.mean(off[quiet] ** 2)) < 0.02  # kN, of a fault of 0.4
    alarm = columns["t"][1:][np.abs(batch.d[1:, 0]) > 0.2]
    late = alarm[alarm > 0.05]  # the very first intervals have no past to be smoothed with
    assert 1.98 < late[0] < 2.02
    # without the observer's model of the road the same threshold would be crossed all the time
    plain = np.gradient(y[:, 0], 0.001) * 0.3  # mass times acceleration, kN
    assert np.mean(np.abs(plain) > 0.2) > 0.5


def test_the_command_line(tmp_path: Path) -> None:
    design, data, estimate, png = (
        str(tmp_path / name) for name in ("d.json", "data.csv", "est.csv", "e.png")
    )
    made = cli("--verbose", "design", str(EXAMPLES[0]), "-o", design)
    assert made.returncode == 0, made.stderr
    assert "invariant zeros -4" in " ".join(made.stdout.split())
    assert cli("verify", design).returncode == 0
    assert (
        cli("simulate", design, "--until", "3", "--disturbance", "sine", "-o", data).returncode == 0
    )
    done = cli("run", design, data, "-o", estimate)
    assert done.stderr == "31 rows: 31 ok\n"
    rows = table(Path(estimate).read_text())
    assert list(rows) == ["t", "x1", "x2", "x3", "d1", "d2", "status"]
    assert rows["d1"][0] == rows["d2"][0] == ""
    truth = table(Path(data).read_text())
    off = abs(float(rows["x1"][-1]) - float(truth["x1"][-1]))
    assert off < 1e-2
    assert cli("plot", estimate, data, "-o", png).returncode == 0
    piped = cli("run", design, data=Path(data).read_text())
    assert piped.stdout == Path(estimate).read_text()


def test_missing_cells_and_a_short_record(tmp_path: Path) -> None:
    design = str(tmp_path / "d.json")
    obsdesign.design(obsdesign.load_problem(EXAMPLES[0])).save(design)
    done = cli("run", design, data="t,y1,y2\n0,1,2\n0.1,,2\n0.2,1,2\n")
    rows = table(done.stdout)
    assert rows["status"] == ["ok", "missing sample", "ok"]
    assert [cell == "" for cell in rows["d1"]] == [True, True, False]
    assert done.stderr == "3 rows: 2 ok, 1 missing sample (at t = 0.1)\n"
    single = cli("run", design, data="t,y1,y2\n0,1,2\n")
    assert single.returncode == 0
    assert len(table(single.stdout)["t"]) == 1


BAD = [
    ("t,y1\n0,1\n", [], "obsdesign: standard input: column 'y2' is required; the header has t, y1.\n"),
    ("t,y1,y2\n0,1,2\n0,1,2\n", [], "obsdesign: standard input line 3: t must increase; got 0.0 after 0.0. Are the rows sorted, without repeats?\n"),
    ("t,y1,y2\n0,1,2\n", ["--initial", "1"], "obsdesign: --initial must be the 3 finite numbers x1,x2,x3; got 1 numbers.\n"),
]  # fmt: skip


@pytest.mark.parametrize(("data", "options", "message"), BAD)
def test_bad_data(data: str, options: list[str], message: str, tmp_path: Path) -> None:
    design = str(tmp_path / "d.json")
    obsdesign.design(obsdesign.load_problem(EXAMPLES[0])).save(design)
    done = cli("run", design, *options, data=data)
    assert (done.returncode, done.stderr) == (2, message)


def test_check_names_what_stands_in_the_way() -> None:
    body = obsdesign.load_problem(EXAMPLES[0]).to_dict()
    del body["observer"]
    assert check_kind(obsdesign.Problem.from_dict(body), "unknown_input").verdict == "proved"
    single = body | {"output": {"C": [[1, 0, 1]]}}
    answer = check_kind(obsdesign.Problem.from_dict(single), "unknown_input")
    assert answer.verdict == "refuted"
    assert answer.reasons[0].startswith("rank: rank(C D) = 1, 2 is needed")
    jumps = body | {"jump": {"dwell_time": [1, 2]}}
    answer = check_kind(obsdesign.Problem.from_dict(jumps), "unknown_input")
    assert answer.reasons[0].startswith(
        "[jump] and [[event]] must be absent for kind 'unknown_input'"
    )
    no_d = {"flow": {"A": body["flow"]["A"]}, "output": body["output"]}
    answer = check_kind(obsdesign.Problem.from_dict(no_d), "unknown_input")
    assert answer.verdict == "does_not_apply"
    assert answer.reasons == ("flow.D is required by kind 'unknown_input'; it is missing.",)
    assert answer.next_step == "If an unknown input acts, give its matrix flow.D."
