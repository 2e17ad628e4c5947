"""Lines of data: their ends are one thing in files and pipes, and their length is bounded."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

import obsdesign
from obsdesign.data.layout import Layout
from obsdesign.data.records import read_samples
from obsdesign.errors import InputError
from tests.systems.command_line import command

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_pipe_is_read_as_a_file_is(tmp_path: Path, end: str) -> None:
    design, data = tmp_path / "d.json", tmp_path / "d.csv"
    obsdesign.design(obsdesign.load_problem(EXAMPLES / "degue_4_1.toml")).save(design)
    text = end.join(["t,y1,jump", "0,1,0", "0.1,0.9,0", "0.2,0.8,0", ""]).encode()
    data.write_bytes(text)
    bounds = ("--initial", "-2,2,-2,2")
    file = command("run", design, data, *bounds, cwd=tmp_path)
    pipe = command("run", design, *bounds, cwd=tmp_path, stdin=text)
    assert (file.returncode, pipe.returncode) == (0, 0)
    assert file.stdout == pipe.stdout
    assert len(file.stdout.splitlines()) == 4


class Endless(io.TextIOBase):
    """A stream of one line that never ends; it counts what is taken from it."""

    taken = 0

    def readline(self, size: int = -1) -> str:  # type: ignore[override]
        assert size > 0, "a limit must be asked for"
        self.taken += size
        return "1" * size


def test_a_line_without_an_end_is_refused_soon() -> None:
    layout = Layout(y=1)
    stream = Endless()
    with pytest.raises(InputError, match="lines of at most 1048576 characters are required"):
        next(read_samples(stream, layout, "data.csv"))
    assert stream.taken < 2**21
    # the twin: a row of many unused columns is read
    wide = ",".join(["t", "y1", *(f"z{k}" for k in range(20_000))])
    rows = io.StringIO(wide + "\n" + ",".join(["0", "1", *["0.123456789"] * 20_000]) + "\n")
    assert next(read_samples(rows, layout, "data.csv")).t == 0.0
