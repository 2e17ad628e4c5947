"""Decay per jump and in time: the claim about proposed rates, and its sentence."""

from __future__ import annotations

from dataclasses import asdict
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal, localcontext

from lmi.arithmetic.arrays import Array, Entries
from lmi.prove.rates import Rates, prove_rates
from obsdesign.document import Claim
from obsdesign.verification.dwell import Dwell, matrix_of


def rates_claim(
    F: Array, H: Array, dwell: Dwell, certificates: Entries, source: str
) -> tuple[Claim, ...]:
    """Claim of proposed rates of decay per jump and in time, for the P of the stability claim.

    No claim where no rates were proposed: stability does not depend on them.
    """
    proposed = certificates.get("rates", {})
    certificate = certificates.get("dwell_stability", {})
    if not all(isinstance(proposed.get(n), float) for n in ("per_jump", "in_time")):
        return ()
    if "P" in certificate and matrix_of(certificate["P"], len(F)) is None:
        return ()
    if not {"P", "windows"} & set(certificate):
        return ()
    rates = Rates(proposed["per_jump"], proposed["in_time"])
    own = {name: proposed[f"P_{name}"] for name in asdict(rates) if f"P_{name}" in proposed}
    if any(matrix_of(P, len(F)) is None for P in own.values()):
        return ()
    verdict = prove_rates(
        F, H, certificate, dwell.low, dwell.high, rates=rates, jitter=dwell.jitter, own=own
    )
    usual = "the P of dwell_stability"
    if "P" not in certificate:
        usual += " of the window that the dwell times are in"
    norms = [f"P_{name}" if name in own else usual for name in asdict(rates)]
    statement = (
        f"e^(F T) H shrinks every vector by the factor per_jump in the norm of {norms[0]}, and by "
        f"e^(-in_time T) in that of {norms[1]}, for all dwell times T in the range"
    )
    return (Claim.from_verdict("rates", statement, source, verdict),)


def rates_sentence(claims: tuple[Claim, ...], what: str) -> list[tuple[str, list[str]]]:
    """The guarantee that a proved rates claim gives, and the claims behind it."""
    for claim in claims:
        if claim.id == "rates" and claim.verdict == "proved":
            per_jump, in_time = claim.evidence["per_jump"], claim.evidence["in_time"]
            norm = "fixed norms"
            if "window" in claim.statement:
                norm = "norms that depend on neighbouring dwell times"
            text = (
                f"Without disturbance and noise, {what} just before a jump shrinks, in {norm}, "
                f"to at most {six_digits(per_jump, ROUND_CEILING)} of itself at the next one, and "
                f"like e^(-{six_digits(in_time, ROUND_FLOOR)} t) from jump to jump."
            )
            return [(text, ["dwell_stability", "rates"])]
    return []


def six_digits(value: float, rounding: str) -> str:
    """A positive number with six digits, rounded in the direction that is given."""
    with localcontext(prec=6, rounding=rounding):
        return f"{+Decimal(value):.6g}"
