"""Benchmarks, without running them: all are listed, and a line states times in a unit that fits."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.__main__ import CLAIMS
from benchmarks.cases import header, report, row

FOLDER = Path(__file__).parent.parent / "benchmarks"


def test_every_claim_is_listed() -> None:
    claims = {path.stem for path in FOLDER.glob("*.py") if "\ndef main(" in path.read_text("utf-8")}
    assert sorted(CLAIMS) == sorted(claims - {"__main__"})


@pytest.mark.parametrize(
    ("ours", "words"),
    [
        (4.2e-8, "0.04 us"), (3.456e-5, "34.56 us"), (0.99e-3, "990.00 us"), (1e-3, "1.00 ms"),
        (0.25, "250.00 ms"), (1.0, "1.00 s"), (125.0, "125.00 s"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("ratio", [3.0, 0.5])
def test_times_have_a_unit_that_shows_them(
    ours: float, words: str, ratio: float, capsys: pytest.CaptureFixture[str]
) -> None:
    held = report("a step", [ours] * 3, [ratio * ours] * 3, 2.0)
    line = capsys.readouterr().out
    assert f" {words:>10s} " in line
    assert f" x {ratio:.2f}       >= 2 " in line
    assert held == (ratio > 2.0) == line.endswith("  ok\n")


def test_a_row_stands_under_its_titles(capsys: pytest.CaptureFixture[str]) -> None:
    header()
    assert row("a step", "1.00 ms", "", "1.00 ms", "<= 2 ms", True)
    assert not row("a step", "3.00 ms", "", "3.00 ms", "<= 2 ms", False)
    assert row("another, without a claim", "", "", "x 0.50", "", True)
    titles, kept, missed, shown = capsys.readouterr().out.splitlines()
    ends = {title: titles.index(title) + len(title) for title in ("ours", "measured", "required")}
    for line, own in ((kept, "1.00 ms"), (missed, "3.00 ms")):
        assert line[: ends["ours"]].endswith(own)
        assert line[: ends["measured"]].endswith(own)
        assert line[: ends["required"]].endswith("<= 2 ms")
    assert (kept[-4:], missed[-13:], shown[-3:]) == ("  ok", "DOES NOT HOLD", "  -")


def test_a_ratio_is_the_median_of_pairs(capsys: pytest.CaptureFixture[str]) -> None:
    assert report("memory", [1.0, 2.0, 40.0], [5.0, 10.0, 40.0], 5.0, unit="MB")
    assert "    2.00 MB   10.00 MB     x 5.00 " in capsys.readouterr().out
