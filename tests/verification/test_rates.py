"""The sentence on rates follows from what is proved, not from how a claim is worded."""

from __future__ import annotations

import pytest

from lmi.arithmetic.arrays import NewEntries
from lmi.verdict import proved, undecided
from obsdesign.document import Claim
from obsdesign.verification.dwell import DwellCertificate, source_of
from obsdesign.verification.rates import StatedRates, rates_sentence

ONE = {"P": [[1.0]]}
WINDOWS = {"windows": [{"dwell": {"0": [0.5, 1.0]}, "P": [[1.0]]}], "edges": [[0, 0, 0.5, 1.0]]}
RATES: NewEntries = {"per_jump": 0.5, "in_time": 0.25}
OWN = {"P_per_jump": [[1.0]], "P_in_time": [[1.0]]}
NEIGHBOURS = "norms that depend on neighbouring dwell times"


def sentence(stability: NewEntries, rates: NewEntries, verdict: str = "proved") -> str:
    """Of claims whose statements say nothing of norms."""
    claims = (
        Claim("dwell_stability", "it is stable", "", "proved", stability),
        Claim("rates", "it decays, in whatever window norm", "", verdict, rates),
    )
    sentences = rates_sentence(claims, "the error")
    return sentences[0][0] if sentences else ""


@pytest.mark.parametrize(
    ("stability", "rates", "norm"),
    [
        (ONE, RATES, "in fixed norms,"),
        (ONE, RATES | OWN, "in fixed norms,"),
        (WINDOWS, RATES, f"in {NEIGHBOURS},"),
        (WINDOWS, RATES | OWN, "in fixed norms,"),
        (WINDOWS, RATES | {"P_in_time": [[1.0]]}, f"in {NEIGHBOURS},"),
    ],
)
def test_norms_are_those_of_the_proof(stability: NewEntries, rates: NewEntries, norm: str) -> None:
    assert norm in sentence(stability, rates)


def test_rates_that_are_not_proved_are_not_promised() -> None:
    assert not sentence(ONE, RATES, "undecided")


@pytest.mark.parametrize("wrong", [None, "0.5", True, 1, [0.5]])
def test_rates_that_are_no_numbers_are_none(wrong: object) -> None:
    assert StatedRates.from_evidence(RATES | {"per_jump": wrong}) is None
    stated = StatedRates.from_evidence(RATES | OWN)
    assert stated is not None
    assert (stated.rates.per_jump, set(stated.own)) == (0.5, {"per_jump", "in_time"})


def test_a_certificate_is_read_by_its_names() -> None:
    """Entries of other claims are not taken for proposals; null is none."""
    read = DwellCertificate.from_document
    assert read(ONE | {"boxes": 3}).matrices() == ONE
    assert read(WINDOWS | {"boxes": 3}).matrices() == WINDOWS
    assert not read({"vector": [1.0], "P": None}).has_matrices
    assert read({}) == DwellCertificate()


def test_the_source_of_a_proof_by_windows_is_named() -> None:
    for verdict, named in (
        (proved(windows=3), True), (proved(P=1), False), (undecided("open", windows=3), False),
    ):  # fmt: skip
        source = source_of(verdict, "A paper")
        assert source.startswith("A paper")
        assert ("docs/windows.md" in source) is named
