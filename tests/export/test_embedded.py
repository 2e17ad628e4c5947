"""The small project of examples/embedded: designed, exported, compiled and run."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import obsdesign
from obsdesign.export.folder import write_code
from obsdesign.export.manifest import Options
from obsdesign.export.timing import Steps
from tests.systems.compiled import STRICT, require

EXAMPLE = Path(__file__).parents[2] / "examples" / "embedded"
LINE = re.compile(
    r"^ *([\d.]+) s  load +(-?[\d.]+) in +(-?[\d.]+) \.\. +(-?[\d.]+) K  status (\d+)$", re.M
)


def test_the_oven_runs(tmp_path: Path) -> None:
    problem = obsdesign.load_problem(EXAMPLE / "oven.toml")
    design = obsdesign.design(problem)
    shutil.copytree(EXAMPLE, tmp_path, dirs_exist_ok=True)
    write_code(design, tmp_path / "oven", Options("float", Steps(error=1e-4), "oven"))
    words = [require("gcc"), *STRICT, "-O2", "-Ioven", "main.c", "oven/oven.c", "-o", "loop"]
    subprocess.run(words, cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "loop"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    rows = LINE.findall(done.stdout)
    assert [int(status) for *_, status in rows] == [0] * 5 + [1, 4] + [0] * 9
    assert all(float(low) <= float(load) <= float(high) for _, load, low, high, _ in rows)
    assert "heater 0" in done.stdout
    assert "heater 10" in done.stdout
    readme = (EXAMPLE / "README.md").read_text("utf-8")
    assert "--step-error 1e-4 --prefix oven -o oven" in readme
