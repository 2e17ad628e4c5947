"""Every command on a plant in discrete time, for every kind that takes one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from obsdesign.cli.commands import cli
from obsdesign.kinds import GIVING_BOUNDS, KINDS, TAKING_DISCRETE_TIME

PLANT = """
[flow]
dt = 0.1
A = [[0.9, 0.2], [-0.1, 0.95]]
B = [[0], [1]]
D = [[1], [0.5]]
d_bounds = { lower = [-1], upper = [1], rate = [2] }
disturbance = { lower = [-0.01, 0], upper = [0.01, 0.02] }

[[sensor]]
name = "level"
C = [[1, 0], [0, 1]]
noise_bound = [0.05, [-0.02, 0.04]]
every = "continuous"

[observer]
kind = "KIND"
"""


def command(*words: object) -> Result:
    result = CliRunner().invoke(cli, [str(word) for word in words])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


def check_parts(folder: Path, initial: list[str]) -> None:
    """The record in two parts, with a state file between them: the same estimates."""
    rows = (folder / "y.csv").read_text().splitlines()
    parts = [folder / "first.csv", folder / "second.csv"]
    parts[0].write_text("\n".join(rows[:12]) + "\n")
    parts[1].write_text("\n".join([rows[0], *rows[12:]]) + "\n")
    lines = list[str]()
    for part, start in zip(parts, (initial, []), strict=True):
        own = ["--state", folder / "s.state", "-o", folder / "part.csv"]
        assert command("run", folder / "d.json", part, *start, *own).exit_code == 0
        lines += (folder / "part.csv").read_text().splitlines()[bool(lines) :]
    assert lines == (folder / "x.csv").read_text().splitlines()


@pytest.mark.parametrize("kind", TAKING_DISCRETE_TIME)
def test_from_text_to_page(kind: str, tmp_path: Path) -> None:
    problem, design, data = (tmp_path / name for name in ("p.toml", "d.json", "y.csv"))
    problem.write_text(PLANT.replace("KIND", kind))
    assert command("design", problem, "-o", design).exit_code == 0
    assert command("verify", design).exit_code == 0
    assert command("simulate", problem, "--until", 3, "-o", data).exit_code == 0
    assert len(data.read_text().splitlines()) == 32
    estimate, page, picture = (tmp_path / name for name in ("x.csv", "d.html", "x.png"))
    initial = ["--initial", "-2,2,-2,2"] if kind in GIVING_BOUNDS else []
    result = command("run", design, data, "-o", estimate, *initial)
    assert result.exit_code == 0
    assert len(estimate.read_text().splitlines()) == 32
    check_parts(tmp_path, initial)
    assert command("report", design, "--data", data, "-o", page, *initial).exit_code == 0
    assert command("plot", estimate, data, "--design", design, "-o", picture).exit_code == 0
    assert picture.stat().st_size > 10_000


def test_check_and_compare_name_all_kinds(tmp_path: Path) -> None:
    problem = tmp_path / "p.toml"
    problem.write_text(PLANT.replace("KIND", "interval"))
    answer = json.loads(command("check", problem, "--json").stdout)
    verdicts = {kind: one["verdict"] for kind, one in answer["result"].items()}
    assert verdicts == {
        kind: "proved" if kind in TAKING_DISCRETE_TIME else "does_not_apply" for kind in KINDS
    }
    table = command("compare", problem, "--until", 3)
    assert table.exit_code == 0
    for kind in TAKING_DISCRETE_TIME:
        assert kind.replace("_", " ") in table.stdout
