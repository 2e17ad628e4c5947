"""What `check` says of each kind, and what it advises: what `design` says, and why."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import pytest

import obsdesign
from benchmarks.glance_is_fast import plants
from obsdesign.errors import DoesNotApply
from obsdesign.kinds import KINDS
from obsdesign.studies.check import advice
from obsdesign.studies.check.which_kinds import check_all
from obsdesign.verification.kind import verification_of
from tests.long.check_agrees import designed, disagreements
from tests.systems.checks import check_kind

ROOT = Path(__file__).parents[3]
EXAMPLES = sorted(path.stem for path in (ROOT / "examples").glob("*.toml"))
# observers of other kinds than their own take seconds: `tests.long.check_agrees` has all
HARD = ("dose_times", "doses_and_samples", "gantry_crane", "gantry_crane_bounds",
        "mattsson_medvedev_open", "medina_spline", "medina_subsystem", "oral_doses",
        "spring_damper", "two_rooms")  # fmt: skip


def load(name: str) -> obsdesign.Problem:
    return obsdesign.load_problem(ROOT / "examples" / f"{name}.toml")


def body_of(**blocks: Any) -> dict[str, Any]:
    plain: dict[str, Any] = {"flow": {"A": [[-1, 0], [1, -2]]}, "output": {"C": [[0, 1]]}}
    for name, entries in blocks.items():
        plain[name] = {**plain.get(name, {}), **entries}
    return plain


@pytest.mark.parametrize("example", ["degue_4_1", "ahn_1", "luteinizing_hormone"])
def test_every_kind_has_an_answer_and_the_examples_own_is_possible(example: str) -> None:
    problem = load(example)
    verdict, answers = check_all(problem)
    assert verdict == "proved"
    assert tuple(answers) == KINDS
    assert problem.kind is not None
    assert answers[problem.kind].verdict == "proved"
    for kind, entry in answers.items():
        assert (entry.verdict == "proved") == (not entry.reasons)
        if entry.verdict == "proved":
            assert f"--kind {kind}" in entry.next_step


@pytest.mark.parametrize("example", [name for name in EXAMPLES if name not in HARD])
def test_check_says_what_design_says(example: str) -> None:
    assert disagreements(load(example)) == []


def test_check_says_what_design_says_of_a_plant_with_a_parameter() -> None:
    body = body_of(flow={"A": [[0.1]]}, output={"C": [[1]], "noise_bound": [0.1]})
    body |= {"parameter": [{"name": "rate", "range": [-0.1, 0.1], "A": [[1]]}],
             "state": {"lower": [-1], "upper": [1]}}  # fmt: skip
    assert disagreements(obsdesign.Problem.from_dict(body)) == []


def test_a_kind_that_takes_a_while_is_not_given_up() -> None:
    """An impulsive observer that half a second of searching finds."""
    problem = next(itertools.islice(plants(), 22, None))
    assert check_kind(problem, "impulsive").verdict == designed(problem, "impulsive") == "proved"


APPLIES: list[tuple[str, dict[str, Any], str]] = [
    ("interval", body_of(flow={"D": [[1], [0]]}), "flow.D is refused by kind 'interval'"),
    ("interval", body_of(jump={"H": [[1], [0]], "dwell_time": [1, 2]}), "jump.H is refused"),
    ("interval", body_of(output={}), "output.noise_bound is required"),
    ("interval", body_of(jump={"G": [[1, 0], [0, 1]]}, output={"noise_bound": [0.0]}),
     "jump.dwell_time = [shortest, longest]"),
    ("luenberger", body_of(output={"measured": "periodic", "period": 0.1}), "output.measured"),
    ("luenberger", body_of(jump={"G": [[1, 0], [0, 1]]}), "jump.dwell_time = [shortest, longest]"),
    ("impulsive", body_of(), "output.measured must be at_jumps"),
    ("impulsive", body_of(jump={"G": [[1, 0], [0, 1]]}, output={"measured": "at_jumps"}),
     "jump.dwell_time = [shortest, longest] is required by kind 'impulsive'; it is missing."),
    ("finite_time", body_of(), "output.measured must be periodic"),
    ("impulsive_input", body_of(), "jump.H is required"),
    ("impulsive_input", body_of(jump={"H": [[1], [0]]}), "jump.dwell_time = [shortest, longest]"),
    ("impulsive_input", body_of(jump={"H": [[1], [0]], "G": [[2, 0], [0, 1]], "dwell_time": [1, 2]}),
     "jump.G must be the identity"),
    ("impulsive_input", body_of(jump={"H": [[1], [0]], "E": [[1], [0]], "dwell_time": [1, 2]}),
     "jump.E is refused"),
    ("impulsive_input",
     body_of(jump={"H": [[1], [0]], "dwell_time": [1, 2]}, output={"measured": "at_jumps"}),
     "output.measured must be continuous or periodic"),
    ("unknown_input", body_of(), "flow.D is required"),
    ("unknown_input", body_of(flow={"D": [[1], [0]]}, jump={"dwell_time": [1, 2]}), "[jump] and [[event]] must be"),
    ("unknown_input",
     body_of(flow={"D": [[0], [1]]}, jump={"dwell_time": [1, 2]}, output={"measured": "at_jumps"}),
     "[jump] and [[event]] must be absent"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "body", "text"), APPLIES)
def test_a_kind_that_does_not_apply_names_what_it_needs(
    kind: str, body: dict[str, Any], text: str
) -> None:
    problem = obsdesign.Problem.from_dict(body)
    entry = check_kind(problem, kind)
    assert entry.verdict == "does_not_apply"
    assert text in entry.reasons[0]
    with pytest.raises(DoesNotApply) as refused:  # bad input for `design`: exit code 2
        obsdesign.investigate(problem.for_kind(kind)[0])
    assert str(refused.value) == entry.reasons[0]
    agreement, *_ = verification_of(kind).claims(problem.for_kind(kind)[0], {}, {})
    assert agreement.verdict == "refuted"
    assert agreement.evidence["witness"] == {"entry": "problem", "reason": entry.reasons[0]}


def test_impossible_has_a_witness() -> None:
    # x2 grows, and nothing shows it
    hidden = body_of(flow={"A": [[-1, 0], [0, 1]]}, output={"C": [[1, 0]]})
    entry = check_kind(obsdesign.Problem.from_dict(hidden), "luenberger")
    assert entry.verdict == "refuted"
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(hidden).for_kind("luenberger")[0])
    assert any(c.verdict == "refuted" and "witness" in c.evidence for c in outcome.claims)


def test_an_option_that_is_refused_is_no_witness() -> None:
    body = body_of(observer={"kind": "luenberger", "poles": [-1, -2, -3]})
    entry = check_kind(obsdesign.Problem.from_dict(body), "luenberger")
    assert entry.verdict == "undecided"
    assert "observer.poles must give 2 poles" in entry.reasons[0]


def test_the_whole_is_proved_or_open_or_refuted() -> None:
    nothing = body_of(output={"measured": "at_jumps"}, jump={"G": [[1, 0], [0, 1]]})
    verdict, answers = check_all(obsdesign.Problem.from_dict(nothing))
    assert {entry.verdict for entry in answers.values()} == {"does_not_apply"}
    assert verdict == "refuted"


def test_advice_speaks_of_claims_that_exist() -> None:
    """A claim that is renamed must not lose its advice in silence."""
    files = (ROOT / "obsdesign" / "verification").rglob("*.py")
    text = "".join(path.read_text("utf-8") for path in files)
    missing = [claim for claim in advice._CLAIMS if f'"{claim}"' not in text]
    assert not missing


def test_advice_answers_what_failed() -> None:
    body = load("degue_4_1").to_dict()
    body["jump"]["dwell_time"] = [0.5, "inf"]  # shorter than ln 2, with the gains of the file
    _, answers = check_all(obsdesign.Problem.from_dict(body))
    assert answers["interval"].verdict == "refuted"
    assert "shortest_dwell" in answers["interval"].next_step
    assert "jump.H" in answers["impulsive_input"].next_step
    periodic = obsdesign.Problem.from_dict(body_of(output={"measured": "periodic", "period": 0.1}))
    assert 'measured = "at_jumps"' in check_kind(periodic, "luenberger").next_step
    assert "output.measured" in check_kind(periodic, "impulsive").next_step
    refused = obsdesign.Problem.from_dict(body_of(flow={"D": [[1], [0]]}))
    assert check_kind(refused, "interval").next_step == ""  # the reason says it all


def test_advice_for_an_end_of_the_dwell_times_names_that_end() -> None:
    """A mode hidden at spacing 0 is no reason to measure more where 0 is what a file left open."""
    for dwell, place, verdict in (([0.0, 0.8], 0, "undecided"), ([0.1, "inf"], 1, "refuted")):
        body = load("medina_spline").to_dict()
        body["jump"]["dwell_time"] = dwell
        answer = check_kind(obsdesign.Problem.from_dict(body), "impulsive")
        assert answer.verdict == verdict
        assert f"jump.dwell_time[{place}]" in answer.next_step


def test_a_kind_beyond_the_budget_of_memory_is_undecided(monkeypatch: pytest.MonkeyPatch) -> None:
    large = obsdesign.Problem.from_dict({
        "flow": {"A": [[-1, 1], [0, -2]]},
        "output": {"C": [[1, 0]], "measured": "periodic", "period": 0.1},
    })  # fmt: skip
    assert check_kind(large, "finite_time").verdict == "proved"
    monkeypatch.setattr("lmi.memory.BUDGET_BYTES", 32)
    entry = check_kind(large, "finite_time")
    assert entry.verdict == "undecided"
    assert len(entry.reasons) == 1
    assert "of memory, and the budget is 3.052e-05 MiB: a shorter window is" in entry.reasons[0]
