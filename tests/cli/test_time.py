"""--time: what it ends is undecided and says so, and more of it never decides less."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.decide import dwell_gap
from lmi.decide import stability as decide
from lmi.find.window_search import Effort, find_windows
from lmi.time_budget import ended_part
from obsdesign.cli.answers import show_bracket
from obsdesign.studies.check.which_kinds import check_all
from obsdesign.studies.comparison.compare import compare
from obsdesign.studies.comparison.record import ComparisonRecord
from obsdesign.studies.search.search import search
from obsdesign.studies.sweep.axes import parse_axis
from obsdesign.studies.sweep.point import evaluate, plan_sweep
from obsdesign.studies.sweep.run import run_sweep
from obsdesign.verification.answers import reason
from tests.cli.test_commands import ROOT, command
from tests.systems.checks import check_kind

SAMPLED = ROOT / "examples" / "sampled_data.toml"
MORE = "; a longer --time may decide it"
# over when it is looked at
NOTHING = 1e-9


def sampled(kind: str) -> obsdesign.Problem:
    return obsdesign.load_problem(SAMPLED).for_kind(kind)[0]


def ends(outcome: obsdesign.Outcome) -> list[dict[str, Any]]:
    """What ended the undecided claims."""
    return [ended_part(c.evidence) for c in outcome.claims if c.verdict == "undecided"]


@pytest.mark.parametrize("kind", ["interval", "luenberger"])
def test_too_little_time_says_so_and_more_decides(kind: str) -> None:
    short = obsdesign.investigate(sampled(kind), seconds=NOTHING)
    assert short.verdict == "undecided"
    assert ends(short)
    assert all(end == {"ended_by": "time", "seconds": NOTHING} for end in ends(short))
    reasons = [reason(c) for c in short.claims if c.verdict == "undecided"]
    assert all(reason.endswith(f"the search ended after 1e-09 s{MORE}") for reason in reasons)
    assert obsdesign.investigate(sampled(kind), seconds=100.0).verdict == "proved"


def test_a_form_that_is_refuted_refutes_nothing_while_others_are_not_tried() -> None:
    """No gain makes A - L C Metzler here: of form cooperative that is a witness for all gains."""
    assert check_kind(sampled("interval"), "interval", seconds=NOTHING).verdict == "undecided"
    assert search(sampled("interval"), "longest_dwell", seconds=NOTHING).verdict == "undecided"
    body = sampled("interval").to_dict()
    body["observer"]["form"] = "cooperative"
    alone = obsdesign.Problem.from_dict(body)  # the twin: the only form that is asked for
    assert obsdesign.investigate(alone, seconds=NOTHING).verdict == "refuted"
    assert search(alone, "longest_dwell", seconds=NOTHING).verdict == "refuted"


def test_a_total_stretches_own_budgets(monkeypatch: pytest.MonkeyPatch) -> None:
    few = functools.partial(find_windows, effort=Effort(windows=3))
    monkeypatch.setattr(decide, "find_windows", few)
    own = obsdesign.investigate(sampled("luenberger"))
    assert own.verdict == "undecided"
    assert ends(own) == [{"ended_by": "windows", "limit": 3}]
    assert own.design is not None
    assert reason(own.claims[-1]).endswith(f"ended after 3 windows{MORE}")
    assert obsdesign.investigate(sampled("luenberger"), seconds=100.0).verdict == "proved"


def test_where_no_time_helps_nothing_is_said_of_it() -> None:
    zeros = [[0.0], [0.0]]
    body: dict[str, Any] = {
        "flow": {"A": [[-1, 0], [0, 0]]},  # a state that stays where it is
        "output": {"C": [[1, 0]]},
        "jump": {"dwell_time": [1, 2]},
        "observer": {"kind": "luenberger", "gains": {"L": zeros, "M": zeros}, "memory": 0},
    }
    for seconds in (None, 1000.0):  # and the latter is not spent
        outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body), seconds=seconds)
        assert outcome.verdict != "proved"
        assert not any(ends(outcome))
        assert not any(MORE in reason(c) for c in outcome.claims)


@pytest.mark.parametrize("example", ["degue_4_1", "medina_spline", "ahn_1", "mazenc_4"])
def test_less_time_never_says_otherwise(example: str) -> None:
    problem = obsdesign.load_problem(ROOT / "examples" / f"{example}.toml")
    final = obsdesign.investigate(problem).verdict
    verdicts = [obsdesign.investigate(problem, seconds=s).verdict for s in (NOTHING, 0.05, 50.0)]
    decided = [verdict for verdict in verdicts if verdict != "undecided"]
    assert set(decided) <= {final}
    assert verdicts[-1] == final
    assert verdicts == ["undecided"] * (3 - len(decided)) + decided


def test_boxes_and_exponents_and_periods_end_too() -> None:
    spline = obsdesign.load_problem(ROOT / "examples" / "medina_spline.toml")
    short = obsdesign.investigate(spline, seconds=NOTHING)
    open_claims = {c.id: ended_part(c.evidence) for c in short.claims if c.verdict == "undecided"}
    assert open_claims["strongly_observable"] == {"ended_by": "time", "seconds": NOTHING}
    pulses = obsdesign.load_problem(ROOT / "examples" / "mattsson_medvedev.toml").to_dict()
    pulses["output"]["noise_std"] = [1.0]
    body = {**pulses, "observer": {"kind": "impulsive_input", "operator": "integral"}}
    short = obsdesign.investigate(obsdesign.Problem.from_dict(body), seconds=NOTHING)
    assert "the search of exponents ended after 1e-09 s" in short.result["remarks"][0]
    period = obsdesign.load_problem(ROOT / "examples" / "mazenc_4.toml").to_dict()
    body = {**period, "observer": {"kind": "finite_time"}}
    short = search(obsdesign.Problem.from_dict(body), "longest_period", seconds=NOTHING)
    assert ended_part(short.result) == {"ended_by": "time", "seconds": NOTHING}
    longer = search(obsdesign.Problem.from_dict(body), "longest_period")
    assert longer.result["proved"] > short.result["proved"]


def test_a_bracket_says_what_ended_it_and_more_time_narrows_it() -> None:
    short = search(sampled("luenberger"), "longest_dwell", seconds=NOTHING)
    assert short.verdict == "undecided"
    assert ended_part(short.result) == {"ended_by": "time", "seconds": NOTHING}
    longer = search(sampled("luenberger"), "longest_dwell", accuracy=0.05, seconds=100.0)
    assert longer.verdict == "proved"
    assert ended_part(longer.result) == {}


def test_a_bracket_that_stays_wide_says_why(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(dwell_gap, "_EFFORT", Effort(windows=2))
    wide = search(sampled("luenberger"), "longest_dwell")
    assert wide.verdict == "undecided"
    assert ended_part(wide.result) == {"ended_by": "windows", "limit": 2}
    show_bracket("longest_dwell", wide)
    line = "the search ended after 2 windows; a longer --time may narrow the bracket"
    assert line in capsys.readouterr().out
    narrow = search(sampled("luenberger"), "longest_dwell", accuracy=2e-3, seconds=100.0)
    assert narrow.verdict == "proved"  # which two windows do not reach
    assert narrow.result["open"] < wide.result["open"]


def test_check_and_compare_and_points_of_a_sweep_say_it(tmp_path: Path) -> None:
    problem = obsdesign.load_problem(SAMPLED)
    verdict, answers = check_all(problem, seconds=NOTHING)
    assert verdict == "proved"  # of kind set_membership, which searches for nothing
    end = {"ended_by": "time", "seconds": NOTHING}
    for kind in ("interval", "luenberger"):
        assert answers[kind].verdict == "undecided"
        assert answers[kind].ended == end
        assert MORE in answers[kind].reasons[0]
    record = ComparisonRecord.from_simulation(
        problem.plant, until=3.0, rng=np.random.default_rng(0)
    )
    rows = {row.kind: row for row in compare(problem, record, seconds=NOTHING)}
    assert (rows["luenberger"].verdict, rows["luenberger"].ended) == ("undecided", end)
    assert rows["finite_time"].verdict == "does_not_apply"
    axes = [parse_axis("jump.dwell_time[1]=1.8:1.87:2")]
    for what in ("verdict", "longest_dwell"):
        plan = plan_sweep(sampled("luenberger"), axes, what, 1e-6, NOTHING)
        assert evaluate(plan, 1).to_dict().items() >= {"verdict": "undecided", **end}.items()
    run_sweep(plan, str(tmp_path / "s.jsonl"), jobs=1)
    assert json.loads((tmp_path / "s.jsonl").read_text().splitlines()[0])["time"] == NOTHING
    longer = plan_sweep(sampled("luenberger"), axes, "longest_dwell", 1e-6, 1.0)
    with pytest.raises(obsdesign.InputError, match=r"another --time: 1e-09 there, 1\.0 here"):
        run_sweep(longer, str(tmp_path / "s.jsonl"), jobs=1)


def test_commands_take_it(tmp_path: Path) -> None:
    done = command("design", SAMPLED, "--time", "1e-6", "--json", cwd=tmp_path)
    assert done.returncode == 3
    claims = json.loads(done.stdout)["claims"]
    assert {"ended_by": "time", "seconds": 1e-6}.items() <= claims[-1]["evidence"].items()
    assert not (tmp_path / "design.json").exists()
    done = command("check", SAMPLED, "--time", "1e-6", cwd=tmp_path)
    assert done.returncode == 0  # a kind that searches for nothing is possible
    assert "does not apply" in done.stdout
    assert "--time may" in " ".join(done.stdout.split())
    what = ("--for", "longest_dwell")
    done = command("search", SAMPLED, *what, "--time", "1e-6", cwd=tmp_path)
    assert done.returncode == 3
    assert "the search ended after 1e-06 s; a longer --time may decide it" in done.stdout


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "inf"])
@pytest.mark.parametrize(
    "arguments",
    [
        ("check",),
        ("design",),
        ("search", "--for", "longest_dwell"),
        ("compare",),
        ("sweep", "--over", "flow.A[0][0]=0:1:2"),
    ],
)
def test_a_time_is_positive_and_finite(arguments: tuple[str, ...], seconds: str) -> None:
    from click.testing import CliRunner

    from obsdesign.cli.commands import cli

    with pytest.raises(obsdesign.InputError, match="--time must be a positive finite number"):
        CliRunner().invoke(
            cli, [*arguments, str(SAMPLED), "--time", seconds], catch_exceptions=False
        )
