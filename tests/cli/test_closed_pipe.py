"""A reader that leaves: exit code 141 as of other tools, never one of the verdicts."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("designs") / "design.json"
    assert code_of("design", EXAMPLES / "degue_4_1.toml", "-o", path, is_read=True) == 0
    return path


def code_of(*arguments: object, is_read: bool) -> int:
    """Exit code of a command whose output is read to its end, or by nobody."""
    command = [sys.executable, "-m", "obsdesign", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        if not is_read:
            process.stdout.close()
        else:
            process.stdout.read()
        return process.wait()


@pytest.mark.parametrize("command", ["verify", "check", "compare", "schema", "verify --json"])
def test_a_reader_that_leaves_is_no_verdict(command: str, design: Path) -> None:
    name, *options = command.split()
    source = {"verify": [design], "schema": ["design"]}.get(name, [EXAMPLES / "degue_4_1.toml"])
    assert code_of(name, *source, *options, is_read=False) == 141
    assert code_of(name, *source, *options, is_read=True) == 0


def test_a_design_is_written_although_nobody_reads_the_answer(tmp_path: Path) -> None:
    path = tmp_path / "design.json"
    assert code_of("design", EXAMPLES / "degue_4_1.toml", "-o", path, is_read=False) == 141
    assert code_of("verify", path, is_read=True) == 0
