"""A sentence is guaranteed where every claim it rests on was proved in this very run, or nowhere."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner

import obsdesign
from obsdesign.cli.commands import cli
from obsdesign.cli.summary import show_details
from obsdesign.design_file import from_dict
from obsdesign.document import digest
from obsdesign.pages.curves import curve_of
from obsdesign.problem.problem import Problem
from obsdesign.verification.document import _pairs, sentences_from
from obsdesign.verification.same_evidence import ROUNDED_WIDTHS
from tests.cli.test_commands import ROOT
from tests.fuzz.cases import design_text
from tests.pages.test_report import Page
from tests.verification.unknown_input.test_claims import example

# one design of each kind, and the kinds whose sentences name no claim of their own
EXAMPLES = (
    "degue_4_1", "sampled_data", "medina_spline", "mazenc_4", "mattsson_medvedev", "ahn_1",
)  # fmt: skip


def unconfirmed(source: Path, target: Path) -> None:
    """A signed design whose certificate shows nothing: a claim stays open when it is verified."""
    body = json.loads(source.read_text("utf-8"))
    claim = next(c for c in body["claims"] if c["id"] == "dwell_stability")
    claim["evidence"]["P"] = [[1.0, 0.0], [0.0, 1.0]]
    target.write_text(json.dumps(body | {"digest": digest(body)}))


def ran(*arguments: object) -> Any:
    return CliRunner().invoke(cli, [*map(str, arguments)], standalone_mode=False)


def test_what_verify_could_not_confirm_is_not_called_guaranteed(
    academic_design: Path, tmp_path: Path
) -> None:
    unconfirmed(academic_design, tmp_path / "d.json")
    done = ran("--verbose", "verify", tmp_path / "d.json")
    assert done.return_value == 3
    assert "guaranteed:" not in done.output
    assert "dwell_stability could not be confirmed" in " ".join(done.output.split())
    # the twin: the same file as it was written
    done = ran("--verbose", "verify", academic_design)
    assert done.return_value == 0
    assert done.output.count("\nguaranteed:") == 7


def test_what_a_report_could_not_confirm_is_not_on_it(
    academic_design: Path, tmp_path: Path
) -> None:
    unconfirmed(academic_design, tmp_path / "d.json")
    sentence = json.loads(academic_design.read_text("utf-8"))["guarantees"][0]["statement"]
    pages = []
    for source, code in ((tmp_path / "d.json", 3), (academic_design, 0)):
        assert ran("report", source, "-o", tmp_path / "r.html").return_value == code
        pages.append(Page((tmp_path / "r.html").read_text("utf-8")).text)
    assert [sentence in page for page in pages] == [False, True]
    assert ["Nothing beyond what is proved below." in page for page in pages] == [True, False]
    assert ["the shaded range is proved" in page for page in pages] == [False, True]


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_sentence_falls_with_any_claim_it_rests_on(
    example: str, capsys: pytest.CaptureFixture[str]
) -> None:
    outcome = obsdesign.investigate(obsdesign.load_problem(ROOT / "examples" / f"{example}.toml"))
    assert outcome.design is not None
    problem = Problem.from_dict(outcome.design.problem)
    assert any(entry.given for entry in outcome.guarantees)
    for k, claim in enumerate(outcome.claims):
        claims = list(outcome.claims)
        claims[k] = replace(claim, verdict="undecided")
        left = sentences_from(problem, tuple(claims)).guarantees
        named = [entry for entry in left if claim.id in entry.claims]
        assert not any(entry.given for entry in (left if k == 0 else named)), claim.id
        opened = replace(outcome, verdict="undecided", claims=tuple(claims), guarantees=left)
        show_details(opened)
        printed = " ".join(capsys.readouterr().out.split())
        for entry in left:
            text = " ".join(entry.statement.split())
            assert (f" guaranteed: {text}" in printed.replace("not guaranteed", "withheld")) is (
                entry.given
            )


def test_a_curve_calls_proved_what_is(academic_design: Path) -> None:
    design = obsdesign.load_design(academic_design)
    claims = tuple(
        replace(claim, verdict="undecided") if claim.id == "dwell_stability" else claim
        for claim in design.claims
    )
    curves = [curve_of(one) for one in (design, replace(design, claims=claims))]
    assert ["is proved" in curve.caption for curve in curves if curve] == [True, False]


def test_a_sentence_may_name_fewer_of_its_claims_and_promises_no_more_by_it() -> None:
    """Older designs rest some sentences on no claim; what they promise is compared all the same."""
    design = obsdesign.design(obsdesign.load_problem(ROOT / "examples" / "ahn_1.toml"))
    older = tuple(replace(entry, claims=()) for entry in design.guarantees)
    assert obsdesign.verify(replace(design, guarantees=older, warnings=None)).verdict == "proved"
    # the twin: a design of today rests each sentence on exactly its claims
    assert obsdesign.verify(replace(design, guarantees=older)).verdict == "refuted"


def test_a_sentence_that_is_withheld_says_less_and_one_that_is_added_is_false() -> None:
    """A document that does not give what is proved is confirmed with a warning."""
    design = obsdesign.design(obsdesign.load_problem(ROOT / "examples" / "ahn_1.toml"))
    first, *others = design.guarantees
    assert first.given
    withheld = (replace(first, given=False), *others)
    outcome = obsdesign.verify(replace(design, guarantees=withheld))
    assert (outcome.verdict, outcome.guarantees) == ("proved", design.guarantees)
    assert len(outcome.warnings) == len(design.warnings or ()) + 1
    assert first.statement in outcome.warnings[-1]
    # the twins: other words of the withheld sentence, and one that nothing gives
    for false in (replace(first, given=False, statement=first.statement + " Always."),
                  replace(first, statement="Noise leaves no error.", claims=())):  # fmt: skip
        outcome = obsdesign.verify(replace(design, guarantees=(false, *others)))
        assert (outcome.verdict, outcome.guarantees) == ("refuted", ())


@pytest.mark.parametrize("is_older", [False, True])
@pytest.mark.parametrize("example", ["mattsson_medvedev", "sampled_data"])
def test_sentences_that_are_not_given_are_compared_like_all_others(
    example: str, is_older: bool
) -> None:
    design = obsdesign.design(obsdesign.load_problem(ROOT / "examples" / f"{example}.toml"))
    if is_older:
        design = replace(design, warnings=None)
    assert obsdesign.verify(design).verdict == "proved"
    k = next(i for i, entry in enumerate(design.guarantees) if not entry.given)
    entry = design.guarantees[k]
    for forged in (
        replace(entry, statement=entry.statement.replace("not ", "")),
        replace(entry, claims=(*entry.claims, "no_such_claim")),
        replace(entry, given=True),
    ):
        guarantees = (*design.guarantees[:k], forged, *design.guarantees[k + 1 :])
        outcome = obsdesign.verify(replace(design, guarantees=guarantees))
        assert (outcome.verdict, outcome.guarantees) == ("refuted", ())


def test_an_older_design_may_lack_sentences_that_are_not_given() -> None:
    design = obsdesign.design(obsdesign.load_problem(ROOT / "examples" / "sampled_data.toml"))
    fewer = tuple(entry for entry in design.guarantees if entry.given)
    assert len(fewer) < len(design.guarantees)
    for warnings, verdict in ((None, "proved"), (design.warnings, "refuted")):
        changed = replace(design, guarantees=fewer, warnings=warnings)
        assert obsdesign.verify(changed).verdict == verdict


def test_warnings_are_those_of_the_claims(tmp_path: Path) -> None:
    """A document may lack warnings, as older ones do; others than these are refuted."""
    body = example(poles=[-1, -2, -300]).to_dict()
    body["output"] |= {"measured": "periodic", "period": 0.1}
    design = obsdesign.design(obsdesign.Problem.from_dict(body))
    assert design.warnings
    design.save(tmp_path / "d.json")
    assert json.loads((tmp_path / "d.json").read_text("utf-8"))["warnings"] == [*design.warnings]
    stored = obsdesign.load_design(tmp_path / "d.json")
    assert obsdesign.verify(stored).warnings == design.warnings
    for warnings, verdict in ((None, "proved"), ((), "refuted"), (("All is well.",), "refuted")):
        outcome = obsdesign.verify(replace(stored, warnings=warnings))
        assert outcome.verdict == verdict
        assert outcome.warnings == (design.warnings if verdict == "proved" else ())


# gains are open and the last ones tried fail, which refutes them and not the problem
UNDECIDED: list[dict[str, Any]] = [
    {
        "flow": {"A": [[1, 0.26], [-1, 1]]},
        "jump": {"G": [[0.0, 1.0], [0.0, 0.0]], "dwell_time": [0, 1]},
        "output": {"C": [[-1, -0.66]], "measured": "at_jumps"},
        "observer": {"kind": "luenberger", "decay_rate": 0.1},
    },
    {
        "flow": {"A": [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]},
        "jump": {"G": [[0, -0.28, 0], [-1, 0, 1], [0, 0, 1]], "dwell_time": [0.3, "inf"]},
        "output": {"C": [[-0.61, 0.46, 0]]},
        "observer": {"kind": "luenberger"},
    },
]


@pytest.mark.parametrize("body", UNDECIDED)
def test_what_a_document_leaves_undecided_is_not_false(body: dict[str, Any]) -> None:
    design = obsdesign.design(Problem.from_dict(body), allow_undecided=True)
    opened = {claim.id for claim in design.claims if claim.verdict == "undecided"}
    found = {claim.id: claim.verdict for claim in obsdesign.verify(design).claims}
    assert "refuted" in {found[name] for name in opened}
    assert found["document"] == "proved"
    # the twins: a document that says more than that is refuted, in a verdict or in words
    for change in ({"verdict": "proved"}, {"statement": "the error is zero"}):
        claims = tuple(
            replace(claim, **change) if claim.id in opened else claim for claim in design.claims
        )
        said = obsdesign.verify(replace(design, claims=claims))
        assert {claim.id: claim.verdict for claim in said.claims}["document"] == "refuted"


def test_a_proof_of_what_a_document_leaves_undecided_is_no_fault_of_it(
    academic_design: Path,
) -> None:
    design = obsdesign.load_design(academic_design)
    claims = tuple(
        replace(claim, verdict="undecided") if claim.id == "dwell_stability" else claim
        for claim in design.claims
    )
    sentences = sentences_from(Problem.from_dict(design.problem), claims)
    opened = replace(design, claims=claims, guarantees=sentences.guarantees)
    outcome = obsdesign.verify(opened)
    assert {claim.id: claim.verdict for claim in outcome.claims}["document"] == "proved"
    assert not any(one.given for one in outcome.guarantees if "dwell_stability" in one.claims)


@pytest.mark.parametrize("missing", ["after_sample", "always"])
def test_evidence_without_what_its_sentence_is_made_of_confirms_nothing(missing: str) -> None:
    """Where the claim is not proved again, only the document says what its width is."""
    body = json.loads(design_text("sampled"))
    claim = next(one for one in body["claims"] if missing in one["evidence"])
    claim["evidence"]["maps"] = ["inf"]  # no certificate
    del claim["evidence"][missing]
    outcome = obsdesign.verify(from_dict(body | {"digest": digest(body)}))
    assert outcome.verdict in ("refuted", "undecided")
    assert outcome.guarantees == ()


@pytest.mark.parametrize("name", ["", " ", "a"])
def test_a_claim_of_any_name_that_nothing_proves_is_a_difference(
    name: str, academic_design: Path
) -> None:
    design = obsdesign.load_design(academic_design)
    more = replace(design.claims[0], id=name, statement="x", source="x", evidence={})
    first = replace(design.claims[0], statement="No estimate is ever off.")
    for claims in ((*design.claims, more), (first, *design.claims[1:], more), design.claims[1:]):
        outcome = obsdesign.verify(replace(design, claims=claims))
        assert (outcome.verdict, outcome.guarantees) == ("refuted", ())
    assert obsdesign.verify(design).verdict == "proved"


def test_an_older_design_lacks_the_sentence_on_rounded_widths_and_no_other_that_is_given() -> None:
    main, other = (obsdesign.document.Guarantee(text, ("a",), True) for text in ("one.", "two."))
    rounded = obsdesign.document.Guarantee(ROUNDED_WIDTHS, ("a",), True)
    recomputed: Any = SimpleNamespace(guarantees=(main, other, rounded), warnings=("beware",))

    def pairs(*guarantees: Any, warnings: Any = None) -> Any:
        design: Any = SimpleNamespace(guarantees=guarantees, warnings=warnings)
        return _pairs(design, recomputed)

    assert pairs(other, main) == [(main, main), (other, other)]
    assert len(pairs(main, other, rounded)) == 3
    assert pairs(main) is None
    assert pairs(main, rounded) is None
    assert pairs(main, other, warnings=("beware",)) is None  # a design of this release
