"""Numbers of each state in the answers of `design` and `verify`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from obsdesign.cli.main import main

PROBLEM = """
[flow]
A = [[-1, 0], [1, -2]]
disturbance = { lower = [-0.1, -0.1], upper = [0.1, 0.1] }
[output]
C = [[0, 2]]
noise_bound = [0.03]
measured = "periodic"
period = 0.1
[observer]
kind = "set_membership"
window = 8
"""


def _answer(capsys: pytest.CaptureFixture[str], *words: str) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["obsdesign", *words])
        with pytest.raises(SystemExit) as ended:
            main()
    assert not ended.value.code
    return capsys.readouterr().out


def test_both_commands_give_the_same_numbers_of_each_state(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    problem, design = tmp_path / "problem.toml", tmp_path / "design.json"
    problem.write_text(PROBLEM)
    first = json.loads(_answer(capsys, "design", str(problem), "-o", str(design), "--json"))
    again = json.loads(_answer(capsys, "verify", str(design), "--json"))
    rows = first["result"]["states"]
    assert rows == again["result"]["states"]
    assert [row["name"] for row in rows] == ["x1", "x2"]
    assert [row["strip"] for row in rows] == [None, 0.03]
    assert {"name", "unit", "strip", "width", "typical", "best"} < set(rows[0])
    assert all(row["best"] <= row["width"] for row in rows)
    shown = _answer(capsys, "design", str(problem), "-o", str(design))
    assert "set_membership, window of 8 stages" in shown
    assert f"{rows[0]['width']:.3g}" in shown
    assert "observable_window" not in shown
    shown = _answer(capsys, "--verbose", "verify", str(design))
    assert shown.index("sensor strip") < shown.index("observable_window")
    assert len(_answer(capsys, "verify", str(design)).splitlines()) == 1


def test_a_point_observer_has_the_typical_error_of_each_state(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    problem = tmp_path / "problem.toml"
    text = PROBLEM.replace("set_membership", "luenberger").replace("window = 8", "poles = [-3, -4]")
    problem.write_text(text.replace('measured = "periodic"\nperiod = 0.1', ""))
    command = ["design", str(problem), "-o", str(tmp_path / "d.json"), "--json"]
    rows = json.loads(_answer(capsys, *command))["result"]["states"]
    assert [row["name"] for row in rows] == ["x1", "x2"]
    assert all(row["width"] is row["strip"] is None and 0 < row["typical"] < 0.1 for row in rows)
