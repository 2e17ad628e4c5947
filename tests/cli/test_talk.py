"""Quiet, verbose, colourless; what a shell is told."""

from __future__ import annotations

import json
import os
import pty
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from obsdesign.cli.commands import cli

ROOT = Path(__file__).parents[2]
ACADEMIC = str(ROOT / "examples" / "degue_4_1.toml")
MAIN = "from obsdesign.cli.main import main; main()"


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(cli, [str(a) for a in arguments], standalone_mode=False)


def test_quiet_leaves_files_exit_codes_and_what_was_asked_for(
    tmp_path: Path, academic_design: Path
) -> None:
    out, data, estimate = (tmp_path / name for name in ("d.json", "data.csv", "e.csv"))
    for arguments in (
        ["design", ACADEMIC, "-o", out],
        ["verify", out],
        ["check", ACADEMIC],
        ["simulate", ACADEMIC, "--until", "2", "-o", data],
        ["run", out, data, "--initial", "0,2,0,2", "-o", estimate],
        ["plot", estimate, data, "-o", tmp_path / "e.png"],
        ["report", out, "-o", tmp_path / "r.html"],
    ):
        done = invoke("-q", *arguments)
        assert (done.return_value, done.output) == (0, ""), arguments
        assert invoke(*arguments).output != "", arguments  # the twin: it talks when it may
    assert all((tmp_path / name).exists() for name in ("d.json", "e.csv", "e.png", "r.html"))
    reply = json.loads(invoke("-q", "verify", out, "--json").stdout)
    assert reply["verdict"] == "proved"
    # the estimate on standard output is no talk
    done = invoke("-q", "run", out, data, "--initial", "0,2,0,2")
    assert done.stdout == estimate.read_text()
    assert done.stderr == ""


def test_quiet_keeps_refusals(tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text(Path(ACADEMIC).read_text().replace("[0.7, inf]", "[0.658, inf]"))
    done = invoke("-q", "design", bad, "-o", tmp_path / "d.json")
    assert (done.return_value, done.output) == (1, "")
    bad.write_text("[flow]")
    assert "output" in str(invoke("-q", "design", bad).exception)


def test_verbose_shows_the_numbers_behind_a_claim(academic_design: Path) -> None:
    plain, wordy = (invoke(*flag, "verify", academic_design).output for flag in ([], ["-v"]))
    assert "Taylor-Bernstein boxes" in wordy
    assert "Taylor-Bernstein boxes" not in plain
    assert "exclude" in str(invoke("-q", "-v", "verify", academic_design).exception)


def test_no_color_is_respected(academic_design: Path) -> None:
    shown = {}
    for name, extra in (("plain", {"NO_COLOR": "1"}), ("coloured", {})):
        environment = {k: v for k, v in os.environ.items() if k != "NO_COLOR"}
        environment |= {"FORCE_COLOR": "1", "TERM": "xterm-256color", **extra}
        done = subprocess.run(
            [sys.executable, "-c", MAIN, "verify", str(academic_design)],
            cwd=ROOT, env=environment, capture_output=True, text=True, check=True,
        )  # fmt: skip
        shown[name] = done.stdout
    assert "\x1b[1;32m" in shown["coloured"]
    assert "\x1b[3" not in shown["plain"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [("obsdesign ver", "plain,verify"), ("obsdesign design --kind imp", "plain,impulsive_input")],
)
def test_a_shell_is_told_what_fits(words: str, expected: str) -> None:
    environment = os.environ | {
        "_OBSDESIGN_COMPLETE": "bash_complete",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split()) - 1),
    }
    done = subprocess.run(
        [sys.executable, "-c", MAIN], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert expected in done.stdout.splitlines()


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts_are_what_the_shell_reads(shell: str) -> None:
    done = invoke("completion", shell)
    assert done.return_value == 0
    assert f"_OBSDESIGN_COMPLETE={shell}_complete" in done.output
    if shutil.which(shell):
        subprocess.run([shell, "-n"], input=done.output, text=True, check=True)


SLOW = """
import time
from obsdesign.cli import talk
talk._WHILE = 0.05
with talk.progress_message("thinking"):
    time.sleep(0.5)
"""


@pytest.mark.parametrize("is_terminal", [True, False])
def test_a_terminal_shows_what_takes_long_and_nothing_else_does(is_terminal: bool) -> None:
    outer, inner = pty.openpty()
    environment = {k: v for k, v in os.environ.items() if k != "NO_COLOR"} | {"TERM": "xterm"}
    done = subprocess.run(
        [sys.executable, "-c", SLOW], cwd=ROOT, env=environment, stdout=subprocess.PIPE,
        stderr=inner if is_terminal else subprocess.PIPE, check=True,
    )  # fmt: skip
    os.close(inner)
    shown = os.read(outer, 10_000) if is_terminal else done.stderr
    os.close(outer)
    assert done.stdout == b""
    assert (b"thinking" in shown) is is_terminal
    assert is_terminal or not shown
