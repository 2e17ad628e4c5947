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


@pytest.mark.parametrize("command", ["verify", "check", "schema", "verify --json"])
def test_a_reader_that_leaves_is_no_verdict(command: str, design: Path, tmp_path: Path) -> None:
    name, *options = command.split()
    plant = tmp_path / "plant.toml"  # of which all observers are found at once
    plant.write_text("[flow]\nA = [[-1]]\n[output]\nC = [[1]]\nnoise_bound = [0.1]\n")
    source = {"verify": [design], "schema": ["design"]}.get(name, [plant])
    assert code_of(name, *source, *options, is_read=False) == 141
    assert code_of(name, *source, *options, is_read=True) == 0


def test_a_design_is_written_although_nobody_reads_the_answer(tmp_path: Path) -> None:
    path = tmp_path / "design.json"
    assert code_of("design", EXAMPLES / "degue_4_1.toml", "-o", path, is_read=False) == 141
    assert code_of("verify", path, is_read=True) == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.parametrize("broken", ["full", "closed"])
def test_messages_that_nobody_gets_change_no_exit_code(
    broken: str, design: Path, tmp_path: Path
) -> None:
    """Standard error on a full disk, or with its reader gone."""

    def code(*arguments: object) -> int:
        command = [sys.executable, "-m", "obsdesign", *map(str, arguments)]
        if broken == "full":
            with open("/dev/full", "w") as full:
                return subprocess.run(command, stderr=full, stdout=subprocess.DEVNULL).returncode
        with subprocess.Popen(
            command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL
        ) as process:
            assert process.stderr is not None
            process.stderr.close()
            return process.wait()

    data = tmp_path / "data.csv"
    data.write_text("t,y1,jump\n0,1,0\n0.1,0.9,0\n")
    assert code("verify", tmp_path / "none.json") == 2
    assert code("run", design, tmp_path / "none.csv") == 2
    estimate = tmp_path / "estimate.csv"
    assert code("run", design, data, "--initial", "-2,2,-2,2", "-o", estimate) == 0
    assert len(estimate.read_text().splitlines()) == 3
