"""What `check` says of each kind, and what it advises."""

from __future__ import annotations

from pathlib import Path

import pytest

import obsdesign
from obsdesign import advice
from obsdesign.check import check_all
from obsdesign.kinds import KINDS

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize("example", ["degue_4_1", "ahn_1", "luteinizing_hormone", "medina_spline"])
def test_every_kind_has_an_answer_and_the_examples_own_is_possible(example: str) -> None:
    problem = obsdesign.load_problem(ROOT / "examples" / f"{example}.toml")
    verdict, found = check_all(problem)
    assert verdict == "proved"
    assert tuple(found) == KINDS
    assert problem.kind is not None
    assert found[problem.kind]["verdict"] == "proved"
    for kind, entry in found.items():
        assert (entry["verdict"] == "proved") == (not entry["reasons"])
        if entry["verdict"] == "proved":
            assert f"--kind {kind}" in entry["next"]


def test_advice_speaks_of_claims_that_exist() -> None:
    """A claim that is renamed must not lose its advice in silence."""
    files = (ROOT / "obsdesign" / "verification").glob("*.py")
    text = "".join(path.read_text("utf-8") for path in files)
    missing = [claim for claim in advice._CLAIMS if f'"{claim}"' not in text]
    assert not missing


def test_advice_answers_what_failed() -> None:
    body = obsdesign.load_problem(ROOT / "examples" / "degue_4_1.toml").to_dict()
    body["jump"]["dwell_time"] = [0.5, "inf"]  # shorter than ln 2, with the gains of the file
    _, found = check_all(obsdesign.Problem.from_dict(body))
    assert found["interval"]["verdict"] == "refuted"
    assert "shortest_dwell" in found["interval"]["next"]
    assert "jump.H" in found["impulsive_input"]["next"]
