"""Rows of a plant in discrete time that are between two steps: refused in one line, or skipped."""

from __future__ import annotations

from pathlib import Path
from subprocess import CompletedProcess

import pytest

import obsdesign
from tests.systems.command_line import command
from tests.systems.designs import designed

EXAMPLE = Path(__file__).parents[2] / "examples" / "two_rates.toml"
ROWS = "t,speed,position\n0.0,0,0\n0.2,0.01,\n0.25,0.01,\n0.4,0.01,0\n"
INITIAL = "--initial=-1,1,-1,1,-1,1"


def run(
    design: Path, *options: str, rows: str = ROWS, start: str | None = INITIAL
) -> CompletedProcess[str]:
    options = options if start is None else (start, *options)
    return command("run", design, *options, cwd=design.parent, stdin=rows)


def test_a_row_between_two_steps(tmp_path: Path) -> None:
    design = tmp_path / "design.json"
    obsdesign.design(obsdesign.load_problem(EXAMPLE)).save(design)
    refused = run(design)
    assert refused.returncode == 2
    line = "line 4: time must be a multiple of flow.dt = 0.1 after 0.2; got 0.25."
    assert refused.stderr.splitlines() == [f"obsdesign: standard input {line}"]
    skipped = run(design, "--skip-bad")
    assert skipped.returncode == 0
    assert f"{line} Line 4 is skipped." in skipped.stderr
    assert [row.split(",")[0] for row in skipped.stdout.splitlines()] == ["t", "0.0", "0.2", "0.4"]


@pytest.mark.parametrize(("bad", "reason"), [
    ("0.25,0.01,", "time must be a multiple of flow.dt = 0.1 after 0.2; got 0.25."),
    ("0.2,0.02,", "t must differ from row to row: two rows of 0.2 state a sample."),
])  # fmt: skip
def test_a_row_between_two_steps_where_rows_may_be_late(
    tmp_path: Path, bad: str, reason: str
) -> None:
    """As without `report_delay`, whether it stands in its place or not; also in a later part."""
    body = obsdesign.load_problem(EXAMPLE).to_dict()
    for sensor in body["sensor"]:
        sensor["report_delay"] = 0.5
    design, state = tmp_path / "design.json", tmp_path / "state.json"
    designed(body).save(design)
    first, *lines = ["0.0,0,0", "0.2,0.01,", bad, "0.4,0.01,0", "0.3,0,"]
    rows = "\n".join(["t,speed,position", first, *lines, ""])
    refused = run(design, rows=rows)
    assert refused.returncode == 2
    assert f"standard input line 4: {reason}" in refused.stderr
    skipped = run(design, "--skip-bad", rows=rows)
    assert skipped.returncode == 0
    assert reason in skipped.stderr
    assert "Line 4 is skipped." in skipped.stderr
    times = [row.split(",")[0] for row in skipped.stdout.splitlines()]
    assert times == ["t", "0.0", "0.2", "0.3", "0.4"]
    part = run(design, "--state", str(state), rows="t,speed,position\n0.0,0,0\n0.2,0.01,\n")
    assert part.returncode == 0
    # in the second part the row before stands in the state file
    rows = f"t,speed,position\n{bad}\n0.9,0,0\n"
    again = run(design, "--skip-bad", "--state", str(state), rows=rows, start=None)
    assert again.returncode == 0
    assert reason in again.stderr
    assert "Line 2 is skipped." in again.stderr
