"""How much wider all ranges of parameters may be: both sides of the bracket."""

from __future__ import annotations

import pytest

from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.studies.search.search import search
from tests.systems.parameters import Body, spring
from tests.verification.luenberger.test_robust_stability import spring as free_spring

WHAT = "largest_uncertainty"


def two_limits(**entries: object) -> Body:
    """x2 grows by 1.2 +- 0.1 and is halved at jumps, every 0.3 to 0.5: e^(0.5 (1.2 + 0.1 f)) = 2."""
    body: Body = {
        "flow": {"A": [[-1, 0.1], [0, 1.2]]},
        "jump": {"G": [[1.2, 0], [0, 0.5]], "dwell_time": [0.3, 0.5]},
        "output": {"C": [[0, 1]]},
        "parameter": [{"name": "growth", "range": [-0.1, 0.1], "A": [[0, 0], [0, 1]]}],
        "observer": {"kind": "luenberger"},
    }
    return body | entries


def test_the_exact_factor_is_met_from_both_sides() -> None:
    outcome = search(Problem.from_dict(two_limits()), WHAT, 1e-3)
    assert outcome.verdict == "proved"
    assert outcome.result["proved"] == pytest.approx(1.86294, rel=1e-3)
    assert outcome.result["not_proved"] == pytest.approx(1.86294, rel=1e-3)
    assert outcome.result["not_proved_verdict"] == "refuted"
    assert outcome.result["witness"]["p"] == [1.0]
    claim = outcome.claims[0]
    assert claim.verdict == "proved"
    assert "times as wide around the middle" in claim.statement


def test_a_gap_is_undecided_and_both_sides_are_stated() -> None:
    outcome = search(Problem.from_dict(free_spring(0.1)), WHAT, 0.05)
    assert outcome.verdict == "undecided"
    assert 1.3 < outcome.result["proved"] < 1.45
    assert 1.85 < outcome.result["not_proved"] < 2.0
    assert outcome.result["open"] > 0.05


def test_an_unstable_middle_is_refuted() -> None:
    body = two_limits()
    body["flow"] = {"A": [[-1, 0.1], [0, 1.5]]}
    outcome = search(Problem.from_dict(body), WHAT, 1e-3)
    assert outcome.verdict == "refuted"
    assert outcome.result["proved"] is None
    assert "growth = 0 for ever" in outcome.claims[0].evidence["witness"]["reason"]


def test_time_ends_the_search() -> None:
    outcome = search(Problem.from_dict(free_spring(0.1)), WHAT, 1e-6, seconds=0.5)
    assert outcome.verdict == "undecided"
    assert outcome.result["ended_by"] == "time"


@pytest.mark.parametrize(
    ("body", "what", "message"),
    [
        ({k: v for k, v in two_limits().items() if k != "parameter"}, WHAT, r"\[\[parameter\]\] is required"),
        (two_limits(observer={"kind": "interval"}), WHAT, "is not available for kind 'interval'"),
        (two_limits(), "longest_dwell", "is not available for kind 'luenberger' with parameters"),
        (two_limits(jump={"G": [[1, 0], [0, 0.5]], "dwell_time": [0.3, 0.5], "dwell_jitter": 0.1}),
         WHAT, "is not available with jump.dwell_jitter"),
        (two_limits(jump={"G": [[1, 0], [0, 0.5]]}), WHAT, "jump.dwell_time"),
    ],
)  # fmt: skip
def test_what_has_no_such_limit_is_refused(body: Body, what: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        search(Problem.from_dict(body), what)


def test_accuracy_is_checked() -> None:
    with pytest.raises(InputError, match="--accuracy"):
        search(Problem.from_dict(two_limits()), WHAT, 2.0)
    assert spring()["observer"]["kind"] == "interval"
