"""One rule for the numbers of options and of text files; names of outputs; initial times."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import obsdesign
from obsdesign.cli.commands import cli
from obsdesign.runtime import from_design
from tests.cli.test_commands import ROOT

# beside plain numbers Python takes groups of digits, digits of other scripts, and blanks
ODD = ("1_0", "\u0661", "0x10", " 1", "")
PROBLEM = str(ROOT / "examples" / "degue_4_1.toml")
OPTIONS: dict[str, tuple[str, ...]] = {
    "--until": ("simulate", PROBLEM),
    "--step": ("compare", PROBLEM),
    "--seed": ("simulate", PROBLEM),
    "--time": ("design", PROBLEM),
    "--accuracy": ("search", PROBLEM, "--for", "shortest_dwell"),
    "--jobs": ("sweep", PROBLEM, "--over", "flow.A[0][0]=0:1:2"),
}


def refusal(*arguments: str) -> str:
    """The message of a call that is refused."""
    done = CliRunner().invoke(cli, arguments)
    assert isinstance(done.exception, SystemExit | obsdesign.InputError)
    assert done.exit_code in (1, 2)  # 1: an InputError, which `main` turns into 2
    return " ".join(f"{done.stderr} {done.exception}".split())


@pytest.mark.parametrize("text", ODD)
@pytest.mark.parametrize("option", OPTIONS)
def test_numbers_of_options_are_plain(option: str, text: str) -> None:
    assert repr(text) in refusal(*OPTIONS[option], option, text)


@pytest.mark.parametrize("text", ["1_0", "\u0661", "0x10"])
def test_lists_axes_and_files_of_numbers_follow_the_same_rule(text: str, tmp_path: Path) -> None:
    assert text in refusal("simulate", PROBLEM, "--initial", f"1,{text}")
    assert text in refusal("simulate", PROBLEM, "--dwell", text)
    for ends in (f"0:{text}:2", f"0:1:{text}"):
        assert text in refusal("sweep", PROBLEM, "--over", f"flow.A[0][0]={ends}")
    (tmp_path / "dwell.csv").write_text(f"1\n{text}\n", encoding="utf-8")
    assert "line 2" in refusal("simulate", PROBLEM, "--dwell", str(tmp_path / "dwell.csv"))
    (tmp_path / "dwell.json").write_text(f'["{text}"]', encoding="utf-8")
    assert "positive dwell times" in refusal(
        "simulate", PROBLEM, "--dwell", str(tmp_path / "dwell.json")
    )
    (tmp_path / "e.csv").write_text(f"t,x1,status\n0,{text},ok\n1,2,ok\n", encoding="utf-8")
    assert "must hold numbers" in refusal(
        "plot", str(tmp_path / "e.csv"), "-o", str(tmp_path / "p.svg")
    )
    header = "t,y1,jump,x1,x2"
    (tmp_path / "d.csv").write_text(f"{header}\n0,0,0,{text},1\n1,0,0,1,1\n", encoding="utf-8")
    assert "must hold numbers" in refusal("compare", PROBLEM, "--data", str(tmp_path / "d.csv"))


def test_plain_numbers_are_taken(tmp_path: Path) -> None:
    for number in ("2", "+2", "2.", "2e0", ".2E+1"):
        done = CliRunner().invoke(
            cli, ["simulate", PROBLEM, "--until", number, "--initial", "1, 2",
                  "-o", str(tmp_path / "d.csv")],
        )  # fmt: skip
        assert done.exit_code == 0, done.output


@pytest.mark.parametrize("command", ["simulate", "design", "report", "export", "sweep", "run"])
def test_an_output_without_a_name_is_refused(command: str, academic_design: Path) -> None:
    more = {"sweep": ("--over", "flow.A[0][0]=0:1:2"), "run": ("--initial", "0,1,0,1")}
    source = PROBLEM if command in ("simulate", "design", "sweep") else str(academic_design)
    assert "must have a name" in refusal(command, source, *more.get(command, ()), "-o", "")


@pytest.mark.parametrize("t", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("example", ["degue_4_1", "sampled_data", "ahn_1", "mattsson_medvedev"])
def test_a_state_begins_at_a_finite_time(example: str, t: float) -> None:
    problem = obsdesign.load_problem(ROOT / "examples" / f"{example}.toml")
    observer: Any = from_design(obsdesign.design(problem, seconds=1))
    box = {"lower": [0.0] * observer.n, "upper": [1.0] * observer.n}
    more = box if example == "degue_4_1" else {}
    with pytest.raises(ValueError, match="time must be finite"):
        observer.init(t=t, **more)
    assert observer.init(t=0.0, **more).t == 0.0
