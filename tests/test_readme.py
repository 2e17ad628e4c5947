"""Everything in the README is executed: its commands, its Python, its two set-up lines."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from docs.figures.demo import numbers
from obsdesign.pages.plotting.estimate_record import Table
from tests.systems.command_line import command
from tests.test_figures import is_same_picture

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
    runs = {f"{kind}.{end}" for kind in ("set_membership", "interval") for end in ("json", "csv")}
    assert made == runs | {"problem.toml", "data.csv", "bounds.png"}
    rows = re.findall(r"(\d+) rows of data, guarantee held on (\d+)", done.stdout)
    assert len(rows) == 2
    for count, kept in rows:
        assert int(count) == int(kept) > 100
    check_caption(folder)
    assert is_same_picture(folder / "bounds.png", ROOT / "docs" / "demo.png")


def check_caption(folder: Path) -> None:
    """The numbers below the picture are those of its files, whose bounds contain the state."""
    text = " ".join(README.split())
    narrower = re.search(r"on average ([\d.]+) times narrower for x₁ and ([\d.]+) times", text)
    share = re.search(r"on ([\d.]+) % of the rows the blue bounds", text)
    stated = [*map(float, narrower.groups()), float(share.group(1)) / 100]
    assert numbers(folder) == pytest.approx(stated, rel=0.02)
    truth = Table.from_file(str(folder / "data.csv"))
    for kind in ("set_membership", "interval"):
        bounds = Table.from_file(str(folder / f"{kind}.csv"))
        for name in ("x1", "x2"):
            assert (bounds.numbers(f"{name}_lo") <= truth.numbers(name)).all()
            assert (truth.numbers(name) <= bounds.numbers(f"{name}_hi")).all()


def test_console_block(tmp_path: Path) -> None:
    commands = re.findall(r"^\$ obsdesign (.*)$", block("console"), flags=re.MULTILINE)
    assert len(commands) == 12
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for line in commands:
        done = command(*shlex.split(line), cwd=tmp_path)
        assert done.returncode == 0, (line, done.stderr)
    assert (tmp_path / "estimate.png").exists()
    assert (tmp_path / "both.png").exists()


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
