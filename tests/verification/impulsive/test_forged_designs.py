"""Forged, damaged and older designs of impulsive observers."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.design_file import from_dict
from obsdesign.verification.impulsive.claims import claims
from tests.systems.impulsive import SPLINE, chain, claim, first, impulsive_problem, verdicts


def verified(design: Any, **changes: Any) -> dict[str, str]:
    forged = replace(design, gains={**design.gains, **changes})
    return verdicts(obsdesign.verify(forged))


@pytest.fixture(scope="module")
def compressed() -> Any:
    return obsdesign.design(impulsive_problem(SPLINE, [0.1, 0.8]))


def test_false_gains_are_not_believed(compressed: Any) -> None:
    gains = compressed.gains
    wrong = np.array(gains["image"])
    wrong[0, 0] += 1e-3
    assert verified(compressed, image=wrong)["image"] == "undecided"
    assert verified(compressed, coimage=np.zeros((3, 4)))["image"] == "undecided"
    assert verified(compressed, window=2)["strongly_observable"] == "refuted"
    for name, value in (
        ("window", 0),
        ("window", 3.5),
        ("alpha", 1.0),
        ("alpha", "a"),
        ("strategy", "none"),
        ("image", 3),
    ):
        assert verified(compressed, **{name: value})["consistent"] == "refuted"
    assert verified(compressed, A=gains["A"] + 1)["consistent"] == "refuted"


def of_earlier_release(design: Any) -> Any:
    """The design with its margin as an earlier release stated it, of rows that are not scaled."""

    def older(claim: Any) -> Any:
        if claim.id != "strongly_observable":
            return claim
        text = claim.statement.replace(
            "in units of its rows and of usual spacings", "of that at usual spacings"
        )
        assert text != claim.statement
        return replace(claim, statement=text, evidence={**claim.evidence, "margin": 0.0017})

    return replace(design, claims=tuple(older(one) for one in design.claims))


@pytest.mark.parametrize("plant", [SPLINE, (chain(3), np.eye(3), first(3))])
def test_a_margin_in_older_words_is_unconfirmed_not_false(plant: Any) -> None:
    design = obsdesign.design(impulsive_problem(plant, [0.1, 0.8]))
    outcome = obsdesign.verify(of_earlier_release(design))
    found = verdicts(outcome)
    assert found.pop("document") == "undecided"
    assert set(found.values()) == {"proved"}
    reason = outcome.claims[-1].evidence["reason"]
    assert "'strongly_observable' is stated as by an earlier release" in reason


def test_designs_without_the_claim_of_the_shortest_spacing_verify(compressed: Any) -> None:
    """Designs of earlier releases do not have it, nor sentences that rest on it."""
    name = "shortest_spacing"
    kept = tuple(one for one in compressed.claims if one.id != name)
    rest = tuple(
        replace(one, claims=tuple(c for c in one.claims if c != name))
        for one in compressed.guarantees
    )
    older = replace(compressed, claims=kept, guarantees=rest)
    assert obsdesign.verify(older).verdict == "proved"
    # the twin: any other claim may not be missing
    kept = tuple(one for one in compressed.claims if one.id != "bounded_spacing")
    assert obsdesign.verify(replace(compressed, claims=kept)).verdict != "proved"


def test_older_words_are_no_cover(compressed: Any) -> None:
    old = of_earlier_release(compressed)
    image = np.array(old.gains["image"])
    image[0, 0] += 1e-3
    for gains in ({"window": 2}, {"A": old.gains["A"] + 1}):
        assert "refuted" in verified(old, **gains).values()
    assert verified(old, image=image)["image"] == "undecided"

    def stated(**changes: Any) -> dict[str, str]:
        told = [replace(c, **changes) if c.id == "rate" else c for c in old.claims]
        return verdicts(obsdesign.verify(replace(old, claims=tuple(told))))

    assert stated(statement="the error is zero")["document"] == "refuted"
    wider = [replace(c, statement=c.statement.replace("0.8]", "9]")) for c in old.claims]
    found = verdicts(obsdesign.verify(replace(old, claims=tuple(wider))))
    assert found["document"] == "refuted"
    # the sentence of today with numbers of then
    new = [c if c.id != "strongly_observable" else next(
        replace(n, evidence=c.evidence) for n in compressed.claims if n.id == c.id
    ) for c in old.claims]  # fmt: skip
    assert verdicts(obsdesign.verify(replace(old, claims=tuple(new))))["document"] == "undecided"


@pytest.mark.parametrize(
    ("claim", "change", "verdict"),
    [
        ("strongly_observable", {"sigma_min": 0.5}, "undecided"),
        ("strongly_observable", {"largest": 1.0}, "undecided"),
        ("rate", {"constant": 2.0}, "undecided"),
        ("strongly_observable", {"sigma_max": 0.5}, "refuted"),
        ("strongly_observable", {"asked": 1e-4}, "undecided"),
        ("strongly_observable", {"blocks": 2}, "refuted"),
        ("bounded_spacing", {"longest": 0.7}, "refuted"),
        ("shortest_spacing", {"shortest": 0.2}, "refuted"),
    ],
)
def test_bounds_of_another_course_of_the_proof_are_unconfirmed(
    compressed: Any, claim: str, change: dict[str, float], verdict: str
) -> None:
    """As sharp as their boxes, which another release cuts otherwise; all else is as it was."""
    told = [replace(c, evidence={**c.evidence, **change}) if c.id == claim else c
            for c in compressed.claims]  # fmt: skip
    outcome = obsdesign.verify(replace(compressed, claims=tuple(told)))
    assert verdicts(outcome)["document"] == verdict
    assert not outcome.guarantees


@pytest.mark.parametrize(
    "evidence",
    [{}, {"asked": "x"}, {"asked": -1.0}, {"blocks": 99}, {"witness": {"thetas": [0.4] * 3}}],
)
def test_evidence_is_checked_not_believed(compressed: Any, evidence: Any) -> None:
    changed = [
        replace(c, evidence=evidence) if c.id == "strongly_observable" else c
        for c in compressed.claims
    ]
    again = obsdesign.verify(replace(compressed, claims=tuple(changed)))
    assert verdicts(again)["strongly_observable"] == "proved"


def test_a_promise_too_good_is_corrected(compressed: Any) -> None:
    changed = [
        replace(c, evidence={**c.evidence, "constant": 2.0}) if c.id == "rate" else c
        for c in compressed.claims
    ]
    again = obsdesign.verify(replace(compressed, claims=tuple(changed)))
    assert claim(again, "rate").evidence["constant"] > 1e6


def test_quadratic_tables_are_checked() -> None:
    design = obsdesign.design(impulsive_problem(SPLINE, [0.4, 0.5], strategy="quadratic"))
    gains = design.gains
    assert verified(design, table=0 * gains["table"])["contracting"] == "undecided"
    assert verified(design, cells=gains["cells"] - 0.01)["contracting"] == "refuted"
    body = design.to_dict()
    again = from_dict(json.loads(json.dumps(body)))
    assert obsdesign.verify(again).verdict == "proved"


def test_claims_without_certificates_find_their_own() -> None:
    problem = impulsive_problem((chain(3), np.eye(3), first(3)), [0.1, 0.8])
    gains = obsdesign.design(problem).gains
    assert {c.verdict for c in claims(problem, gains, {})} == {"proved"}


def test_a_design_survives_its_file(compressed: Any, tmp_path: Any) -> None:
    compressed.save(tmp_path / "d.json")
    again = obsdesign.load_design(tmp_path / "d.json")
    again.save(tmp_path / "e.json")
    assert (tmp_path / "d.json").read_bytes() == (tmp_path / "e.json").read_bytes()
    assert obsdesign.verify(again).verdict == "proved"
