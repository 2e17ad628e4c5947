"""Benchmarks, without running them: all are listed, and a line states times in a unit that fits."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.__main__ import CLAIMS
from benchmarks.cases import report

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
    assert f"ours {words:>10s} " in line
    assert f"ratio {ratio:8.2f} " in line
    assert held == (ratio > 2.0) == line.endswith("  ok\n")


def test_a_ratio_is_the_median_of_pairs(capsys: pytest.CaptureFixture[str]) -> None:
    assert report("memory", [1.0, 2.0, 40.0], [5.0, 10.0, 40.0], 5.0, unit="MB")
    assert "ours    2.00 MB   theirs   10.00 MB " in capsys.readouterr().out
