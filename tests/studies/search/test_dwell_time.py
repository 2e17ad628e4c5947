"""`obsdesign search`: brackets around published and exact dwell times, from the command line."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.studies.search.search import search
from tests.cli.test_commands import ROOT, command

ACCURACY = 1e-6


def plant(A: Any, J: Any, dwell: list[Any]) -> obsdesign.Problem:
    """Stability of the plant itself: kind luenberger with both gains zero."""
    zeros = np.zeros((len(A), 1)).tolist()
    return obsdesign.Problem(
        flow={"A": A}, jump={"G": J, "dwell_time": dwell}, output={"C": np.eye(1, len(A))},
        observer={"kind": "luenberger", "gains": {"L": zeros, "M": zeros}},
    )  # fmt: skip


ACADEMIC = ([[-1, 0], [1, -2]], [[2, 1], [1, 3]])
RANGED = ([[-1, 0.1], [0, 1.2]], [[1.2, 0], [0, 0.5]])

PUBLISHED = [
    (plant(*ACADEMIC, [0.1, "inf"]), "shortest_dwell", 1.1405277855),
    (plant(*RANGED, [0.1, 0.5]), "shortest_dwell", math.log(1.2)),
    (plant(*RANGED, [0.2, 0.5]), "longest_dwell", math.log(2) / 1.2),
    (plant([[1, 3], [-1, 2]], [[0.5, 0], [0, 0.5]], [0, 1]), "longest_dwell", math.log(2) / 1.5),
]


@pytest.mark.parametrize(("problem", "what", "limit"), PUBLISHED)
def test_published_limits_are_bracketed(
    problem: obsdesign.Problem, what: str, limit: float
) -> None:
    outcome = search(problem, what)
    good, bad = outcome.result["proved"], outcome.result["not_proved"]
    assert outcome.verdict == "proved"
    assert outcome.result["not_proved_verdict"] == "refuted"
    assert min(good, bad) <= limit <= max(good, bad)
    assert abs(good - bad) <= ACCURACY * limit * 1.01
    assert (good > bad) == (what == "shortest_dwell")
    # the two ends disagree when they are asked for themselves
    for end, verdict in ((good, "proved"), (bad, "refuted")):
        low, high = problem.require_dwell_time()
        ends = (end, high) if what == "shortest_dwell" else (low, end)
        assert obsdesign.investigate(problem.with_dwell_time(*ends)).verdict == verdict


@pytest.mark.parametrize("kind", ["interval", "luenberger"])
@pytest.mark.parametrize(
    ("A", "G", "dwell", "proved"),
    [(1, 2, [0, 0.5], False), (-1, 1, [0, "inf"], False), (-1, -1, [0, 1], False), (1, 0.5, [0, 1], True)],
)  # fmt: skip
def test_a_range_that_ends_at_zero_is_refuted_by_its_jump(
    kind: str, A: float, G: float, dwell: list[Any], proved: bool
) -> None:
    zero = [[0.0]]
    problem = obsdesign.Problem(
        flow={"A": [[A]]}, jump={"G": [[G]], "dwell_time": dwell},
        output={"C": [[1]], "noise_bound": [0.0]},
        observer={"kind": kind, "gains": {"L": zero, "M": zero}},
    )  # fmt: skip
    outcome = search(problem, "longest_dwell")
    assert (outcome.verdict == "proved") == proved
    if proved:
        assert outcome.result["proved"] == pytest.approx(math.log(2), rel=1e-5)
    else:
        assert outcome.result["not_proved"] == 0.0


@pytest.mark.parametrize(
    ("name", "limit"), [("degue_4_1", math.log(2)), ("degue_4_3", 2.8221351564360697)]
)
def test_limits_of_the_papers_examples(name: str, limit: float, tmp_path: Path) -> None:
    done = command(
        "search",
        ROOT / "examples" / f"{name}.toml",
        "--for",
        "shortest_dwell",
        "--json",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)["result"]
    assert result["not_proved"] <= limit <= result["proved"]
    assert result["proved"] - result["not_proved"] <= ACCURACY * limit * 1.01


def test_the_minimal_split_reaches_further() -> None:
    body = obsdesign.load_problem(ROOT / "examples" / "degue_4_3.toml").to_dict()
    for name in ("D0", "D1", "Gp", "Gn"):
        del body["observer"]["gains"][name]
    outcome = search(obsdesign.Problem.from_dict(body), "shortest_dwell")
    assert outcome.result["proved"] == pytest.approx(1.8841283020, rel=2e-6)


def test_everything_proved_has_no_other_side() -> None:
    outcome = search(plant([[-1, 0], [0, -2]], [[0.5, 0], [0, 0.5]], [1, 2]), "longest_dwell")
    assert (outcome.result["proved"], outcome.result["not_proved"]) == (math.inf, None)
    outcome = search(plant([[-1, 0], [0, -2]], [[0.5, 0], [0, 0.5]], [1, 2]), "shortest_dwell")
    assert (outcome.result["proved"], outcome.result["not_proved"]) == (0.0, None)


def test_nothing_admissible_is_refuted() -> None:
    outcome = search(plant([[1, 0], [0, 1]], [[2, 0], [0, 2]], [1, 2]), "shortest_dwell")
    assert outcome.verdict == "refuted"
    assert outcome.result["proved"] is None
    endless = search(plant([[1, 0], [0, 1]], [[0.1, 0], [0, 0.1]], [1, "inf"]), "shortest_dwell")
    assert endless.verdict == "refuted"


def test_missing_gains_are_found_first() -> None:
    problem = obsdesign.Problem(
        flow={"A": ACADEMIC[0]}, jump={"G": ACADEMIC[1], "dwell_time": [0.5, "inf"]},
        output={"C": [[1, 0]]}, observer={"kind": "luenberger"},
    )  # fmt: skip
    outcome = search(problem, "shortest_dwell")
    assert outcome.result["proved"] <= 0.5
    assert np.any(outcome.result["gains"]["M"])


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("--for", "peace"), "--for must be one of shortest_dwell, longest_dwell, longest_period, shortest_window, largest_time_error, largest_uncertainty; got 'peace'."),
        (("--for", "longest_period"), "--for longest_period is not available for kind 'interval' in this version."),
        (("--for", "shortest_dwell", "--accuracy", "0"), "--accuracy must be a number from 1e-12 to 1; got 0.0."),
    ],
)  # fmt: skip
def test_searches_that_make_no_sense(tmp_path: Path, arguments: Any, line: str) -> None:
    problem = ROOT / "examples" / "degue_4_1.toml"
    done = command("search", problem, *arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"obsdesign: {problem}: {line}\n"


def test_a_decay_rate_must_hold_over_the_range_that_is_found() -> None:
    problem = plant(*ACADEMIC, [0.1, "inf"])
    slow = search(problem, "shortest_dwell").result["proved"]
    body = problem.to_dict()
    body["observer"]["decay_rate"] = 0.5
    outcome = search(obsdesign.Problem.from_dict(body), "shortest_dwell")
    assert outcome.verdict == "proved"
    assert {c.id: c.verdict for c in outcome.claims}["decay_rate"] == "proved"
    assert outcome.result["proved"] > slow + 0.1


def test_a_limit_at_zero_is_open() -> None:
    outcome = search(plant([[-1, 0], [0, -1]], [[1, 0], [0, 1]], [1, 2]), "shortest_dwell")
    # the radius is 1 at dwell time 0 only: whatever is left open is next to it
    assert outcome.result["not_proved_verdict"] in ("refuted", "undecided")
    assert 0 <= outcome.result["not_proved"] < outcome.result["proved"] < 1e-6


@pytest.mark.parametrize("kind", ["luenberger", "interval"])
def test_gains_that_were_searched_for_refute_no_range(kind: str) -> None:
    """Shorter dwell times than those of the answer have an observer: other gains have it."""
    shorter: dict[str, Any] = {
        "flow": {"A": [[-1.2, 0.8], [0.3, -2.8]]},
        "jump": {"G": [[1.4, 0.7], [-0.8, 0.9]], "dwell_time": [0.0, "inf"]},
        "output": {"C": [[0.4, 0.3]], "noise_bound": [0.1]},
        "observer": {"kind": kind},
    }
    if kind == "interval":  # in the plant's coordinates, which the twin has as well
        shorter["observer"] = {"kind": kind, "objective": "feasible"}
    designed = obsdesign.design(obsdesign.Problem.from_dict(shorter))
    given = {**shorter, "jump": {**shorter["jump"], "dwell_time": [0.5, "inf"]}}
    answer = search(obsdesign.Problem.from_dict(given), "shortest_dwell", 1e-3)
    assert answer.verdict == "proved"
    assert answer.result["proved"] > designed.gains["dwell_time"][0] == 0
    assert answer.result["not_proved_verdict"] == "undecided"
    assert answer.result["witness"] is None
    assert "thetas" in answer.result["these_gains"]["witness"]
    assert answer.result["reason"].startswith("other gains may do; for these, ")
    # the twin: the same gains, given by the file, are refuted by the same witness
    gains = {name: np.asarray(answer.result["gains"][name]).tolist() for name in ("L", "M")}
    fixed = {**given, "observer": {"kind": kind, "gains": gains}}
    again = search(obsdesign.Problem.from_dict(fixed), "shortest_dwell", 1e-3)
    assert again.result["not_proved_verdict"] == "refuted"
    assert again.result["witness"] == answer.result["these_gains"]["witness"]


# the error of these gains shrinks, but in the plant's own coordinates its width may grow
OBLIQUE: dict[str, Any] = {
    "flow": {"A": [[0.4, -1.0], [0.7, -0.6]]},
    "jump": {"G": [[0.4, 1.3], [0, 0]], "dwell_time": [0.1, 0.2]},
    "output": {"C": [[0.2, 1.0]], "noise_bound": 0.1, "measured": "at_jumps",
               "jump_measurement": "after"},
    "observer": {"kind": "interval", "gains": {"M": [[-0.5], [0.3]]}},
}  # fmt: skip
MIRRORED: dict[str, Any] = {
    "flow": {"A": [[-1]]},
    "jump": {"G": [[-0.5]], "dwell_time": [0.3, "inf"]},
    "output": {"C": [[1]], "noise_bound": 0.1, "jump_measurement": "none"},
    "observer": {"kind": "interval"},
}


def changed(body: dict[str, Any], block: str, **entries: Any) -> obsdesign.Problem:
    return obsdesign.Problem.from_dict({**body, block: {**body[block], **entries}})


def test_a_form_that_was_chosen_refutes_no_range() -> None:
    problem = obsdesign.Problem.from_dict(OBLIQUE)
    answer = search(problem, "longest_dwell", 1e-3).result
    assert answer["not_proved"] < 0.45
    assert answer["not_proved_verdict"] == "undecided"
    assert answer["reason"].startswith("other forms may do; for these, ")
    assert obsdesign.investigate(problem.with_dwell_time(0.1, 0.45)).verdict == "proved"
    # the twin: with the form of the file the witness is against the problem
    named = search(changed(OBLIQUE, "observer", form="split"), "longest_dwell", 1e-3).result
    assert named["not_proved_verdict"] == "refuted"
    assert named["witness"] == answer["these_gains"]["witness"]


def test_a_range_that_no_coordinates_have_is_refuted() -> None:
    """The error itself does not shrink there: forms that are open do not matter."""
    body = {
        "flow": {"A": [[-1.3, 0.0], [-0.8, -2.0]]},
        "jump": {"G": [[1.3, 0.9], [0.8, -0.8]], "dwell_time": [0.3, 3.0]},
        "output": {"C": [[-0.8, -0.6]], "noise_bound": 0.1, "measured": "at_jumps"},
        "observer": {"kind": "interval", "gains": {"M": [[0.2], [0.3]]}},
    }
    problem = obsdesign.Problem.from_dict(body)
    answer = search(problem, "shortest_dwell", 1e-3).result
    assert answer["form"] == "coordinates"
    assert answer["proved"] < 0.6469  # below is the limit of the plant's own coordinates
    assert answer["not_proved_verdict"] == "refuted"
    for end, verdict in ((answer["proved"], "proved"), (answer["not_proved"], "refuted")):
        assert obsdesign.investigate(problem.with_dwell_time(end, 3.0)).verdict == verdict


@pytest.mark.parametrize("what", ["shortest_dwell", "longest_dwell"])
def test_a_refuted_form_does_not_end_the_search(what: str) -> None:
    answer = search(obsdesign.Problem.from_dict(MIRRORED), what, 1e-3)
    assert (answer.verdict, answer.result["form"]) == ("proved", "split")
    # the twins: the form of the file is refuted, and so is a jump that no form lets shrink
    assert search(changed(MIRRORED, "observer", form="cooperative"), what).verdict == "refuted"
    growing = changed({**MIRRORED, "flow": {"A": [[1]]}}, "jump", G=[[-2]], dwell_time=[0.3, 1])
    given = {"kind": "interval", "gains": {"L": [[0]], "M": [[0]]}}
    growing = obsdesign.Problem.from_dict({**growing.to_dict(), "observer": given})
    assert search(growing, what).verdict == "refuted"


@pytest.mark.parametrize("what", ["shortest_dwell", "longest_dwell"])
@pytest.mark.parametrize("kind", ["luenberger", "interval"])
def test_a_plant_at_rest_has_dwell_times_too(kind: str, what: str) -> None:
    resting = {"flow": {"A": [[0]]}, "jump": {"G": [[0.5]], "dwell_time": [1, "inf"]},
               "output": {"C": [[1]], "noise_bound": 0.1}, "observer": {"kind": kind}}  # fmt: skip
    answer = search(obsdesign.Problem.from_dict(resting), what)
    assert answer.verdict == "proved"
    assert answer.result["proved"] == (0.0 if what == "shortest_dwell" else math.inf)
    # the twin: without its gain nothing shrinks at rest
    given = {"kind": kind, "gains": {"L": [[0]], "M": [[0]]}}
    unmoved = obsdesign.Problem.from_dict({**resting, "observer": given})
    assert search(unmoved, what).result["proved"] != answer.result["proved"]


def test_gains_refuted_for_an_endless_range_are_open_for_others() -> None:
    """No M serves an endless range of a growing flow, and M = 1 serves every finite one."""
    body: dict[str, Any] = {
        "flow": {"A": [[0.5]]},
        "jump": {"dwell_time": [0.1, "inf"]},
        "output": {"C": [[1]]},
        "observer": {"kind": "luenberger", "gains": {"L": [[0.2]]}},
    }
    answer = search(obsdesign.Problem.from_dict(body), "longest_dwell", 1e-3)
    assert answer.result["not_proved_verdict"] != "refuted"
    body["jump"] = {"dwell_time": [0.1, 2 * answer.result["proved"]]}
    assert obsdesign.investigate(obsdesign.Problem.from_dict(body)).verdict == "proved"
    # the twin: M of the file
    body["jump"] = {"dwell_time": [0.1, "inf"]}
    body["observer"]["gains"]["M"] = [[0.9]]
    answer = search(obsdesign.Problem.from_dict(body), "longest_dwell", 1e-3)
    assert answer.result["not_proved_verdict"] == "refuted"


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-9, 1e-12, 1e9])
def test_the_longest_dwell_time_is_that_of_any_clock(unit: float) -> None:
    """x' = u x, x+ = x/2: the limit is ln 2 / u, whatever the unit of time."""
    problem = obsdesign.Problem(
        flow={"A": [[unit]]},
        jump={"G": [[0.5]], "dwell_time": [0.01 / unit, 0.1 / unit]},
        output={"C": [[1]], "measured": "at_jumps"},
        observer={"kind": "luenberger", "gains": {"L": [[0]], "M": [[0]]}},
    )
    outcome = search(problem, "longest_dwell")
    assert outcome.verdict == "proved"
    assert outcome.result["proved"] * unit == pytest.approx(math.log(2), rel=1e-5)
    assert outcome.result["not_proved"] * unit >= math.log(2) * (1 - 1e-9)
