"""The kind through the command line, without solvers, with numpy alone."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import obsdesign
from obsdesign.pages.plotting.estimate import _moments
from obsdesign.pages.plotting.estimate_record import Table
from tests.systems.command_line import command
from tests.test_architecture import SOLVERS, run_blocked

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "luteinizing_hormone.toml"
RECORD = ROOT / "examples" / "luteinizing_hormone.csv"


@pytest.fixture(scope="module")
def designs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    made = []
    for name in ("luteinizing_hormone", "mattsson_medvedev"):
        path = tmp_path_factory.mktemp("design") / f"{name}.json"
        obsdesign.design(obsdesign.load_problem(ROOT / "examples" / f"{name}.toml")).save(path)
        made.append(path)
    return made


def test_verify_needs_no_solver_and_the_runtime_numpy_alone(designs: list[Path]) -> None:
    for path in designs:
        code = f"import obsdesign\nassert obsdesign.verify(obsdesign.load_design({str(path)!r})).verdict == 'proved'"
        assert run_blocked(SOLVERS, code).returncode == 0
        blocked = (*SOLVERS, "scipy", "flint", "matplotlib", "jsonschema", "click", "rich")
        code = (
            "from obsdesign.runtime import Sample, load\n"
            f"observer = load({str(path)!r})\nstate = observer.init(t=0.0)\n"
            "for k in range(1, 60):\n"
            "    state, estimate = observer.step(state, Sample(10.0 * k, y=[1.0 + k % 7]))\n"
            "assert len(observer.finish(state)) > 0\n"
        )
        done = run_blocked(blocked, code)
        assert done.returncode == 0, done.stderr


def test_a_record_through_the_command_line(designs: list[Path], tmp_path: Path) -> None:
    estimate, events = tmp_path / "est.csv", tmp_path / "events.csv"
    done = command(
        "run", designs[0], RECORD, "-o", estimate, "--initial", "0,2.4", "--events", events,
        cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader(estimate.read_text("utf-8").splitlines()))
    assert [float(row["t"]) for row in rows] == [10.0 * k for k in range(48)]
    rows = list(csv.DictReader(events.read_text("utf-8").splitlines()))
    assert list(rows[0]) == ["t", "weight", "t_std", "weight_std", "status"]
    assert [round(float(row["t"])) for row in rows] == [54, 131, 212, 263, 379, 443]
    assert all(float(row["t_std"]) > 1 for row in rows)
    # row by row on a pipe: the same answer
    text = RECORD.read_text("utf-8")
    piped = command("run", designs[0], "--initial", "0,2.4", cwd=ROOT, stdin=text)
    assert piped.stdout == estimate.read_text("utf-8")


def test_simulate_makes_records_that_the_observer_reads(
    designs: list[Path], tmp_path: Path
) -> None:
    data, true, events = (tmp_path / name for name in ("data.csv", "true.csv", "events.csv"))
    done = command("simulate", designs[1], "--until", 130, "--step", 0.05, "--initial", "4,20,60",
                   "--events", true, "-o", data, "--seed", 3, cwd=ROOT)  # fmt: skip
    assert done.returncode == 0, done.stderr
    done = command(
        "run",
        designs[1],
        data,
        "-o",
        tmp_path / "est.csv",
        "--initial",
        "4,20,60",
        "--events",
        events,
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stderr
    wanted = [
        (float(r["t"]), float(r["weight"]))
        for r in csv.DictReader(true.read_text("utf-8").splitlines())
    ]
    events = [
        (float(r["t"]), float(r["weight"]), r["t_std"])
        for r in csv.DictReader(events.read_text("utf-8").splitlines())
    ]
    assert len(events) >= 2
    for (t, g, spread), (moment, weight) in zip(events, wanted, strict=False):
        assert t == pytest.approx(moment, abs=1e-4)
        assert g == pytest.approx(weight, abs=1e-4)
        assert spread == ""


ONE = """
[flow]
A = {A}
[jump]
H = {H}
dwell_time = [6, inf]
[output]
C = {C}
measured = "periodic"
period = 0.05
{noise}
[observer]
kind = "impulsive_input"
"""


@pytest.mark.parametrize(
    ("A", "H", "C", "noise"),
    [("[[-0.5]]", "[[1]]", "[[1]]", ""),
     ("[[0, 1], [-2, -0.4]]", "[[1], [0]]", "[[1, 0]]", "noise_std = [0.01]")],
)  # fmt: skip
def test_every_event_file_can_be_drawn(A: str, H: str, C: str, noise: str, tmp_path: Path) -> None:
    names = ("one.toml", "one.json", "data.csv", "est.csv", "events.csv", "picture.svg")
    problem, design, data, estimate, events, picture = (tmp_path / name for name in names)
    problem.write_text(ONE.format(A=A, H=H, C=C, noise=noise), "utf-8")
    for words in (
        ("design", problem, "-o", design),
        ("simulate", design, "--until", 45, "-o", data, "--seed", 1),
        ("run", design, data, "-o", estimate, "--events", events),
        ("plot", estimate, data, "--events", events, "-o", picture),
    ):
        done = command(*words, cwd=ROOT)
        assert done.returncode == 0, (words, done.stderr)
    rows = list(csv.DictReader(events.read_text("utf-8").splitlines()))
    assert len(rows) >= 2
    assert all(float(row["t"]) > 0 and float(row["weight"]) != 0 for row in rows)
    # the twin: a time that is no number is refused, so that the picture proves something
    events.write_text(events.read_text("utf-8").replace(rows[0]["t"], f"time({rows[0]['t']})"))
    refused = command("plot", estimate, data, "--events", events, "-o", picture, cwd=ROOT)
    assert refused.returncode == 2
    assert "must hold numbers" in refused.stderr


def test_check_says_why_the_kind_does_not_fit(tmp_path: Path) -> None:
    from tests.systems.checks import check_kind

    fits = check_kind(obsdesign.load_problem(EXAMPLE), "impulsive_input")
    assert (fits.verdict, fits.reasons) == ("proved", ())
    other = check_kind(
        obsdesign.load_problem(ROOT / "examples" / "degue_4_1.toml"), "impulsive_input"
    )
    assert other.verdict == "does_not_apply"
    assert other.reasons == ("jump.H is required by kind 'impulsive_input'; it is missing.",)


def test_times_of_impulses_show_the_decimals_that_are_known() -> None:
    events = {
        "t": ["54.387", "10.2412", "40.02611", "80.00015", "7.5"],
        "t_std": ["2.9", "0.29", "0.021", "nan", "0.3"],
        "status": ["ok", "ok", "provisional: the record ends inside its window", "ok",
                   "does not fit one impulse in the window"],
    }  # fmt: skip
    t = np.array([float(x) for x in events["t"]])
    assert _moments(t, Table("events.csv", events)) == ["54", "10.2", "40.03", "80", "7.5 ?"]
