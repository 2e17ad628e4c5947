"""Rows of a plant in discrete time that are between two steps: refused in one line, or skipped."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import obsdesign

EXAMPLE = Path(__file__).parents[2] / "examples" / "two_rates.toml"
ROWS = "t,speed,position\n0.0,0,0\n0.2,0.01,\n0.25,0.01,\n0.4,0.01,0\n"
INITIAL = "--initial=-1,1,-1,1,-1,1"


def run(design: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "obsdesign", "run", str(design), INITIAL, *options]
    return subprocess.run(command, input=ROWS, capture_output=True, text=True, check=False)


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
