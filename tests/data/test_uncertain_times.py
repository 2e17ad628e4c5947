"""Commands on events at uncertain times: files, pipes, parts, late rows, pages."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from tests.cli.test_commands import ROOT
from tests.data.test_late_rows import cells, ran, text

START = "--initial=-2,2,-2,2,-2,2"
EXAMPLE = ROOT / "examples" / "dose_times.toml"


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The design of the example, a record, and its estimates."""
    monkeypatch.chdir(tmp_path)
    # doses are sampled often, so that rows fall into the windows
    Path("p.toml").write_text(
        EXAMPLE.read_text("utf-8")
        .replace("every = [0, 5]", "every = [0.1, 1]")
        .replace("report_delay = 24", "report_delay = 2"),
        "utf-8",
    )
    assert ran("design", "p.toml", "-o", "d.json").return_value == 0
    assert (
        ran("simulate", "p.toml", "--until", 40, "--initial=0,0,0", "-o", "data.csv").exit_code == 0
    )
    done = ran("run", "d.json", "data.csv", START, "-o", "e.csv", "--events", "events.csv")
    assert (done.exception, done.return_value) == (None, 0)
    return tmp_path


def final(path: str) -> list[str]:
    return [line for line in Path(path).read_text().splitlines() if "provisional" not in line]


def test_the_state_is_inside_its_bounds(desk: Path) -> None:
    titles, *rows = cells("data.csv")
    x = np.array([[float(row[titles.index(f"x{i}")]) for i in (1, 2, 3)] for row in rows])
    _, *estimates = cells("e.csv")
    ends = np.array([[float(cell) for cell in row[1:7]] for row in estimates]).reshape(-1, 3, 2)
    in_time = np.argsort([float(row[0]) for row in rows], kind="stable")
    assert (ends[..., 0] <= x[in_time] + 1e-9).all()
    assert (x[in_time] - 1e-9 <= ends[..., 1]).all()
    assert {line.rsplit(",")[-1] for line in final("e.csv")[1:]} == {"ok"}
    assert Path("events.csv").read_text().count("dose") >= 3


def test_parts_and_pipes_are_the_whole(desk: Path) -> None:
    titles, *rows = cells("data.csv")
    k = titles.index("received")
    arrived = sorted(rows, key=lambda row: float(row[k]))
    Path("arrived.csv").write_text(text(titles, arrived))
    piped = ran("run", "d.json", START, stdin=Path("arrived.csv").read_text())
    assert piped.stdout == Path("e.csv").read_text()
    lines: list[str] = []
    for first, last in itertools.pairwise((0, 13, 30, len(arrived))):
        Path("part.csv").write_text(text(titles, arrived[first:last]))
        start = [] if first else [START]
        done = ran("run", "d.json", "part.csv", *start, "--state", "s.json", "-o", "part_e.csv")
        assert done.exception is None
        lines += Path("part_e.csv").read_text().splitlines()[bool(first) :]
    assert lines == final("e.csv")


def test_rows_before_a_stamp_are_provisional_until_it_may_not_come(desk: Path) -> None:
    done = ran("run", "d.json", "data.csv", START, "-o", "f.csv", "--provisional", "latest.csv")
    assert done.exception is None
    assert Path("f.csv").read_text().splitlines() == final("e.csv")
    latest: dict[str, str] = {}
    for line in Path("latest.csv").read_text().splitlines()[1:]:
        latest[line.split(",")[0]] = line.replace("provisional; ", "").replace("provisional", "ok")
    for line in final("f.csv")[1:]:
        assert latest[line.split(",")[0]] == line


def test_a_late_stamp_changes_rows_before_it(desk: Path) -> None:
    """The twin: without the event the same rows have other bounds."""
    titles, *rows = cells("data.csv")
    stamps = [row for row in rows if row[titles.index("dose")]]
    without = [row for row in rows if row is not stamps[1]]
    Path("without.csv").write_text(text(titles, without))
    ran("run", "d.json", "without.csv", START, "-o", "g.csv")
    stamp = float(stamps[1][0])
    other = {line.split(",")[0]: line for line in final("g.csv")}
    differs = {
        float(line.split(",")[0])
        for line in final("e.csv")[1:]
        if other.get(line.split(",")[0]) != line
    } - {stamp}
    assert min(differs) >= stamp - 0.25 - 1e-9
    between = [float(row[0]) for row in rows if stamp - 0.25 < float(row[0]) < stamp]
    assert set(between) <= differs


def test_pages_and_comparisons_know_them(desk: Path) -> None:
    for arguments in (
        ["plot", "e.csv", "data.csv", "--design", "d.json", "-o", "e.png"],
        ["report", "d.json", "--data", "data.csv", START, "-o", "r.html"],
        ["export", "d.json", "-o", "d.mat"],
        ["verify", "d.json"],
        ["compare", "p.toml", "--data", "data.csv", "--kinds", "interval,luenberger"],
        ["sweep", "p.toml", "--over", "event[0].time_error=0.2:0.2:1", "-o", "s.jsonl"],
    ):
        done = ran(*arguments)
        assert done.exception is None, arguments
        assert done.return_value in (0, None), arguments
    for kind in ("set_membership", "luenberger"):
        done = ran("design", "p.toml", "--kind", kind, "-o", "k.json")
        assert "event.dose.time_error: kind" in str(done.exception)
