"""Impulsive observers from the command line: exit codes and exact lines."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.systems.command_line import command

DOUBLE: dict[str, Any] = {
    "name": "double integrator",
    "flow": {"A": [[0, 1], [0, 0]]},
    "jump": {"dwell_time": [0.5, 1.5]},
    "output": {"C": [[1, 0]], "measured": "at_jumps"},
    "observer": {"kind": "impulsive"},
}


def written(tmp_path: Path, **changes: Any) -> Path:
    body = json.loads(json.dumps(DOUBLE))
    for place, value in changes.items():
        block, _, key = place.partition("__")
        if value is None:
            del body[block][key]
        else:
            body[block][key] = value
    (tmp_path / "p.json").write_text(json.dumps(body))
    return tmp_path / "p.json"


def test_from_file_to_estimate(tmp_path: Path) -> None:
    written(tmp_path)
    assert command("design", "p.json", cwd=tmp_path).returncode == 0
    assert command("verify", "design.json", "--paranoid", cwd=tmp_path).returncode == 0
    simulated = command("simulate", "p.json", "--until", "8", "--initial", "3,-1", "--disturbance", "zero", "-o", "d.csv", cwd=tmp_path)  # fmt: skip
    assert simulated.returncode == 0, simulated.stderr
    done = command("run", "design.json", "d.csv", "-o", "e.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    truth = [row.split(",") for row in (tmp_path / "d.csv").read_text().splitlines()]
    rows = [row.split(",") for row in (tmp_path / "e.csv").read_text().splitlines()]
    assert rows[0] == ["t", "x1", "x2", "status"]
    places = [truth[0].index(name) for name in ("x1", "x2")]
    for have, want in zip(rows[3:], truth[3:], strict=True):
        assert [float(have[1]), float(have[2])] == pytest.approx(
            [float(want[p]) for p in places], abs=1e-9
        )
        assert have[3] == "ok"


@pytest.mark.parametrize(
    ("changes", "code", "line"),
    [
        ({"output__measured": "continuous"}, 2, "obsdesign: p.json: output.measured must be at_jumps for kind 'impulsive'; got 'continuous'."),
        ({"jump__dwell_time": None}, 2, "obsdesign: p.json: jump.dwell_time = [shortest, longest] is required by kind 'impulsive'; it is missing."),
        ({"observer__alpha": 1}, 2, "obsdesign: p.json: observer.alpha must be a number > 1; got 1."),
        ({"observer__window": 0}, 2, "obsdesign: p.json: observer.window must be a whole number >= 1; got 0."),
        ({"observer__strategy": "best"}, 2, "obsdesign: p.json: observer.strategy must be one of full, compressed, subspace, quadratic, auto; got 'best'."),
        ({"observer__noise_target": [1.0]}, 2, "obsdesign: p.json: observer.noise_target must have 2 entries, one per state; got 1."),
        ({"observer__strategy": "quadratic", "observer__window": 3}, 2, "obsdesign: p.json: observer.window means nothing to strategy 'quadratic', which has no window; drop one of the two."),
        ({"jump__dwell_time": [0, 0]}, 2, "obsdesign: p.json: jump.dwell_time: the longest dwell time must be > 0; got [0, 0]."),
        ({"jump__dwell_time": [0.5, "inf"]}, 1, ""),
        ({"observer__window": 1}, 1, ""),
        ({"jump__dwell_time": [0, 1], "observer__strategy": "full"}, 1, ""),
    ],
)  # fmt: skip
def test_what_is_refused(changes: dict[str, Any], code: int, line: str, tmp_path: Path) -> None:
    done = command("design", written(tmp_path, **changes).name, "--json", cwd=tmp_path)
    assert (done.returncode, done.stderr.rstrip()) == (code, line)
    assert not (tmp_path / "design.json").exists()
    if code in (1, 3):
        assert json.loads(done.stdout)["verdict"] == {1: "refuted", 3: "undecided"}[code]
    else:
        assert done.stdout == ""


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        ("0.5,1,1\n0.5,1,1\n", "d.csv line 3: t must increase; got 0.5 after 0.5. Are the rows sorted, without repeats?"),
        ("0.9,1,1\n0.5,1,1\n", "d.csv line 3: t must increase; got 0.5 after 0.9. Are the rows sorted, without repeats? A row that arrives late needs report_delay of its [[event]] or [[sensor]]."),
    ],
)  # fmt: skip
def test_repeated_and_unsorted_impulses(rows: str, line: str, tmp_path: Path) -> None:
    written(tmp_path)
    command("design", "p.json", cwd=tmp_path)
    (tmp_path / "d.csv").write_text("t,y1,jump\n" + rows)
    done = command("run", "design.json", "d.csv", "-o", "e.csv", cwd=tmp_path)
    assert (done.returncode, done.stderr.rstrip()) == (2, f"obsdesign: {line}")
    assert not (tmp_path / "e.csv").exists()


def test_a_record_shorter_than_the_window_and_a_gap_in_it(tmp_path: Path) -> None:
    written(tmp_path, observer__window=8)
    command("design", "p.json", cwd=tmp_path)
    (tmp_path / "d.csv").write_text("t,y1,jump\n0.5,1,1\n1.5,,1\n2.5,3,1\n")
    done = command("run", "design.json", "d.csv", cwd=tmp_path)
    assert done.returncode == 0
    statuses = [row.rpartition(",")[2] for row in done.stdout.splitlines()[1:]]
    assert statuses == [
        "ok",
        "missing sample",
        "window contains a missing sample or an uncertified spacing",
    ]


def test_check_knows_the_kind(tmp_path: Path) -> None:
    reply = json.loads(command("check", written(tmp_path).name, "--json", cwd=tmp_path).stdout)
    assert reply["result"]["impulsive"].items() >= {"verdict": "proved", "reasons": []}.items()
