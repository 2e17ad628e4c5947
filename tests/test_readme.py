"""Everything in the README is executed: its commands, its Python, its two set-up lines."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text("utf-8")
SETUP = re.findall(r"^    (python3 .*)$", README, flags=re.MULTILINE)


def block(language: str) -> str:
    return "\n".join(re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL))


def test_two_commands_do_all_set_up() -> None:
    # CI runs the second one as it stands; here: both make the environment they use
    assert len(SETUP) == 2
    for line in SETUP:
        assert line.startswith("python3 -m venv .venv && .venv/bin/pip install -q -e ")
    assert SETUP[0].endswith("&& .venv/bin/obsdesign demo")
    assert "pytest" in SETUP[1]


def test_the_demo_makes_what_it_says(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", "from obsdesign.cli.main import main; main()", "demo"],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "obsdesign-demo"
    made = {path.name for path in folder.iterdir()}
    assert made == {"problem.toml", "design.json", "data.csv", "estimate.csv", "estimate.png"}
    rows, kept = map(
        int, re.search(r"(\d+) rows of data, guarantee held on (\d+)", done.stdout).groups()
    )
    assert rows == kept > 100


def test_console_block(tmp_path: Path) -> None:
    commands = re.findall(r"^\$ obsdesign (.*)$", block("console"), flags=re.MULTILINE)
    assert len(commands) == 9
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for line in commands:
        done = subprocess.run(
            [sys.executable, "-c", "from obsdesign.cli.main import main; main()", *shlex.split(line)],
            cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300,
        )  # fmt: skip
        assert done.returncode == 0, (line, done.stderr)
    assert (tmp_path / "estimate.png").exists()


def test_python_block(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(ROOT)
    exec(compile(block("python"), "README.md", "exec"), {})
    assert capsys.readouterr().out.endswith("ok\n")


def test_the_plant_file_is_the_example() -> None:
    import tomllib

    shown = tomllib.loads(block("toml"))
    example = tomllib.loads((ROOT / "examples" / "degue_4_1.toml").read_text("utf-8"))
    for name in ("flow", "jump", "output"):
        assert shown[name] == example[name]
    assert shown["observer"]["gains"] == example["observer"]["gains"]


def test_the_links_lead_somewhere() -> None:
    targets = re.findall(r"\]\(([^)#]+)\)", README)
    assert len(targets) > 5
    for target in targets:
        assert (ROOT / target).exists(), target


def test_the_claim_about_the_paper(tmp_path: Path) -> None:
    growth = float(re.search(r"the width grows by ([\d.]+) %", README).group(1))
    import numpy as np
    from scipy.linalg import expm

    cycle = expm(np.array([[-1.0, 0], [1, -3]]) * 0.658) @ np.array([[2, 0], [1, 0.2]])
    radius = max(abs(np.linalg.eigvals(cycle)))
    assert growth == pytest.approx(100 * (radius - 1), abs=0.05)
