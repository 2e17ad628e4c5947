"""Decay per jump and in time: the claim about proposed rates, and its sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal, localcontext

from lmi.arithmetic.arrays import Array, Entries, EntriesByClaim, NewEntries
from lmi.prove.rates import Rates, prove_rates
from obsdesign.document import Claim
from obsdesign.verification.dwell import Dwell, DwellCertificate
from obsdesign.verification.proposal import matrix_of


@dataclass(frozen=True)
class StatedRates:
    """Rates of a certificate or a claim; own: the P of single rates, by their names, unchecked."""

    rates: Rates
    own: NewEntries

    @classmethod
    def from_evidence(cls, entries: Entries) -> StatedRates | None:
        """Those that the entries state; None where one is missing or no number."""
        names = [entry.name for entry in fields(Rates)]
        if not all(isinstance(entries.get(name), float) for name in names):
            return None
        own = {name: entries[f"P_{name}"] for name in names if f"P_{name}" in entries}
        return cls(Rates(*(entries[name] for name in names)), own)


def rates_claim(
    F: Array, H: Array, dwell: Dwell, certificates: EntriesByClaim, source: str
) -> tuple[Claim, ...]:
    """Claim of proposed rates of decay per jump and in time, for the P of the stability claim.

    No claim where no rates were proposed: stability does not depend on them.
    """
    proposed = StatedRates.from_evidence(certificates.get("rates", {}))
    certificate = DwellCertificate.from_document(certificates.get("dwell_stability", {}))
    if proposed is None or not certificate.has_matrices:
        return ()
    if certificate.P is not None and matrix_of(certificate.P, len(F)) is None:
        return ()
    rates, own = proposed.rates, proposed.own
    if any(matrix_of(P, len(F)) is None for P in own.values()):
        return ()
    verdict = prove_rates(
        F, H, certificate.matrices(), dwell.low, dwell.high, rates=rates, jitter=dwell.jitter,
        own=own,
    )  # fmt: skip
    usual = "the P of dwell_stability"
    if certificate.P is None:
        usual += " of the window that the dwell times are in"
    norms = [f"P_{name}" if name in own else usual for name in asdict(rates)]
    statement = (
        f"e^(F T) H shrinks every vector by the factor per_jump in the norm of {norms[0]}, and by "
        f"e^(-in_time T) in that of {norms[1]}, for all dwell times T in the range"
    )
    return (Claim.from_verdict("rates", statement, source, verdict),)


# what drives the error of most plants
DRIVING = "disturbance and noise"


def rates_sentence(
    claims: tuple[Claim, ...], what: str, absent: str = DRIVING
) -> list[tuple[str, list[str]]]:
    """The guarantee that a proved rates claim gives, and the claims behind it.

    absent: what drives the error, and must be absent.
    """
    evidence = [c.evidence for c in claims if c.id == "rates" and c.verdict == "proved"]
    stated = StatedRates.from_evidence(evidence[0]) if evidence else None
    if stated is None:
        return []
    norm = "fixed norms"
    if len(stated.own) < len(asdict(stated.rates)) and not _has_one_matrix(claims):
        norm = "norms that depend on neighbouring dwell times"
    per_jump = six_digits(stated.rates.per_jump, ROUND_CEILING)
    text = (
        f"Without {absent}, {what} just before a jump shrinks, in {norm}, "
        f"to at most {per_jump} of itself at the next one, and "
        f"like e^(-{six_digits(stated.rates.in_time, ROUND_FLOOR)} t) from jump to jump."
    )
    return [(text, ["dwell_stability", "rates"])]


def _has_one_matrix(claims: tuple[Claim, ...]) -> bool:
    """Is stability proved by one P for all dwell times?"""
    stability = (claim.evidence for claim in claims if claim.id == "dwell_stability")
    return any(DwellCertificate.from_document(evidence).P is not None for evidence in stability)


def six_digits(value: float, rounding: str) -> str:
    """A positive number with six digits, rounded in the direction that is given.

    TypeError or ValueError for what is no number: evidence of a file may be anything.
    """
    with localcontext(prec=6, rounding=rounding):
        return f"{+Decimal(float(value)):.6g}"


def shown(values: Sequence[float] | Array) -> str:
    """Text of a vector of upper bounds: six digits, rounded up."""
    return "(" + ", ".join(six_digits(float(value), ROUND_CEILING) for value in values) + ")"
