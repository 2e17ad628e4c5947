"""Windows of dwell times from problem to design file: proved, verified, searched; and twins."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import obsdesign
from obsdesign.studies.search.search import search
from obsdesign.verification.luenberger.claims import claims
from tests.verification.luenberger.test_claims import sampled_data, sampled_data_problem


def claim_of(outcome: obsdesign.Outcome, name: str) -> Any:
    return next(claim for claim in outcome.claims if claim.id == name)


def test_windows_of_dwell_times_prove_what_a_common_p_cannot(tmp_path: Path) -> None:
    design = obsdesign.design(sampled_data_problem(1.8885))
    design.save(tmp_path / "design.json")
    stored = obsdesign.load_design(tmp_path / "design.json")
    again = obsdesign.verify(stored)
    assert again.verdict == "proved"
    assert "windows" in claim_of(again, "dwell_stability").evidence
    confirmed = obsdesign.verify(stored, paranoid=True)
    assert confirmed.verdict == "proved"
    evidence = claim_of(confirmed, "dwell_stability").evidence
    assert evidence["confirmed_by"]["method"] == "chords"
    rates = claim_of(again, "rates")
    assert 0.99 < rates.evidence["per_jump"] < 1
    assert "window" in rates.statement


def test_a_design_with_false_windows_is_not_verified() -> None:
    design = obsdesign.design(sampled_data_problem(1.87))
    body = json.loads(json.dumps(design.to_dict()))
    evidence = next(c for c in body["claims"] if c["id"] == "dwell_stability")["evidence"]
    first, second = evidence["windows"][:2]
    first["P"], second["P"] = second["P"], first["P"]
    forged = replace(design, claims=tuple(type(design.claims[0])(**c) for c in body["claims"]))
    outcome = obsdesign.verify(forged)
    assert claim_of(outcome, "dwell_stability").verdict == "undecided"
    assert outcome.verdict == "undecided"
    assert claim_of(outcome, "document").evidence["reason"] == (
        "what the document says of dwell_stability, rates could not be confirmed"
    )


@pytest.mark.parametrize(
    ("place", "verdict"),
    [
        ("lmi/windows_proof.py", "proved"),
        ("lmi/prove/windows_proof.py", "proved"),
        ("lmi/chords.py", "refuted"),
    ],
)
def test_a_source_as_an_earlier_release_names_it(place: str, verdict: str) -> None:
    design = obsdesign.design(sampled_data_problem(1.87))
    older = tuple(
        replace(claim, source=claim.source.replace("docs/windows.md", place))
        for claim in design.claims
    )
    assert older != design.claims
    assert obsdesign.verify(replace(design, claims=older)).verdict == verdict


def test_limited_jitter_is_part_of_the_claim() -> None:
    design = obsdesign.design(sampled_data_problem(2.0, 0.2))
    claim = next(c for c in design.claims if c.id == "dwell_stability")
    assert "[0.4, 2.0] that change by at most 0.2 from one to the next" in claim.statement
    assert any("change by at most 0.2" in g.statement for g in design.guarantees)
    assert obsdesign.verify(design).verdict == "proved"
    assert sampled_data(2.0).verdict == "refuted"
    # the same windows do not serve a plant whose dwell times may change more
    wider = sampled_data_problem(2.0, 0.6)
    certificates = {"dwell_stability": claim.evidence}
    gains = design.gains | {"dwell_jitter": 0.6}
    assert claims(wider, gains, certificates)[-1].verdict == "undecided"
    # nor does a witness refute a plant whose dwell times may not change so much
    alternating = {"dwell_stability": {"witness": {"thetas": [2.0, 0.4]}}}
    assert claims(sampled_data_problem(2.0), design.gains, alternating)[-1].verdict == "refuted"
    slow = sampled_data_problem(2.0, 0.2)
    assert claims(slow, design.gains, alternating)[-1].verdict == "undecided"


def test_search_closes_the_gap_that_a_common_p_leaves() -> None:
    outcome = search(sampled_data_problem(1.5), "longest_dwell", 1e-4)
    result = outcome.result
    assert outcome.verdict == "proved"
    assert result["common_P"] == pytest.approx(1.8276, abs=1e-3)
    assert 1.8887 < result["proved"] < result["not_proved"] < 1.8891
    assert result["not_proved_verdict"] == "refuted"
    assert result["open"] <= 1e-4
    plain = search(sampled_data_problem(1.5, memory=0), "longest_dwell", 1e-4).result
    assert plain["proved"] == pytest.approx(1.8276, abs=1e-3)
    assert plain["common_P"] is None


def test_a_sentence_promises_no_more_than_was_proved() -> None:
    design = obsdesign.design(sampled_data_problem(1.5))
    rates = claim_of(obsdesign.verify(design), "rates").evidence
    sentence = next(g.statement for g in design.guarantees if "shrinks" in g.statement)
    factor = float(re.search(r"to at most (\S+) of itself", sentence)[1])
    rate = float(re.search(r"e\^\(-(\S+) t\)", sentence)[1])
    assert rates["per_jump"] <= factor < rates["per_jump"] * (1 + 2e-5)
    assert rates["in_time"] * (1 - 2e-5) < rate <= rates["in_time"]


@pytest.mark.parametrize(
    "certificate",
    [{"thetas": [0.5]}, {"thetas": [0.5], "multipliers": "no"}, {"thetas": [0.5], "multipliers": [[[None]]]},
     {"thetas": [0.5], "multipliers": []}, {"multipliers": [[[1.0]]]}, [], None],
)  # fmt: skip
def test_a_dual_certificate_that_is_none_shows_nothing(certificate: Any) -> None:
    problem = sampled_data_problem(1.87)
    gains = obsdesign.design(problem).gains
    results = claims(problem, gains, {"dwell_stability": {"no_common_P": certificate}})
    stability = next(claim for claim in results if claim.id == "dwell_stability")
    assert stability.verdict == "undecided"
    assert "dual certificate" not in str(stability.evidence)
