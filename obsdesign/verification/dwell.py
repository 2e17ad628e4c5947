"""Stability for every sequence of dwell times: what the kinds with jumps have in common."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.infeasible import prove_no_common
from lmi.positive import FORMS, SIDES, prove_copositive
from lmi.proof import prove_common
from lmi.rates import Rates, prove_rates
from lmi.spectral import refute_spectral, refute_word
from lmi.verdict import Verdict, undecided
from obsdesign.document import Claim
from obsdesign.problem import Problem


def unusable(problem: Problem) -> str | None:
    """What no observer with gains L, M can execute; None if there is nothing."""
    plant = problem.plant
    if plant.jump is not None and plant.jump.dwell_time is None:
        return f"jump.dwell_time = [shortest, longest] is required by kind {problem.kind!r}."
    if plant.output.measured == "periodic":
        return (
            f"output.measured = 'periodic' is not available for kind {problem.kind!r} in this "
            "version; it must be continuous or at_jumps."
        )
    return None


def range_text(low: float, high: float) -> str:
    """A range of dwell times in words that round-trip: [0.7, inf)."""
    return f"[{low!r}, inf)" if math.isinf(high) else f"[{low!r}, {high!r}]"


def dwell_stability(
    F: Any, H: Any, low: float, high: float, certificate: Mapping[str, Any], paranoid: bool
) -> Verdict:
    """Is x -> e^{F theta} H x stable for every sequence of theta in [low, high]?

    certificate: what a finder believes shows the answer: {"P": n x n}, {"witness": {"thetas": ...}}
    or {"no_common_P": ...}; it is checked here, or not used. Refuted only by a checked witness.
    paranoid: a proof is repeated by the second, independent method.
    """
    attempt = undecided("no certificate P was given or found")
    if "P" in certificate:
        attempt = _proof(F, H, low, high, certificate["P"], paranoid)
        if attempt.outcome == "proved":
            return attempt
    if "vector" in certificate:
        attempt = _copositive(F, H, low, high, certificate)
        if attempt.outcome == "proved":
            return attempt
    counter = refute_spectral(F, H, low, high)
    if counter.outcome == "refuted":
        return counter
    word = _dwell_times(certificate.get("witness"), low, high)
    if word:
        counter = refute_word(F, H, word)
        if counter.outcome == "refuted":
            return counter
    if "no_common_P" in certificate:
        nothing = _no_common(F, H, low, high, certificate["no_common_P"])
        attempt = attempt if nothing is None else nothing
    seen = {**counter.evidence, **attempt.evidence}
    # overflow leaves NaN where a number was looked for: it tells nothing
    return Verdict("undecided", {key: value for key, value in seen.items() if value == value})


def rates_claim(
    F: Any, H: Any, ends: tuple[float, float], certificates: Mapping[str, Any], source: str
) -> tuple[Claim, ...]:
    """The decay per jump and in time that a finder proposes, for the P of the stability claim.

    No claim where nothing was proposed: a rate is extra, stability does not hang on it.
    """
    proposed = certificates.get("rates", {})
    P = _matrix(certificates.get("dwell_stability", {}).get("P"), len(F))
    if P is None or not all(isinstance(proposed.get(n), float) for n in ("per_jump", "in_time")):
        return ()
    rates = Rates(proposed["per_jump"], proposed["in_time"])
    verdict = prove_rates(F, H, P, *ends, rates)
    statement = (
        "in the norm of the P of dwell_stability, e^(F T) H shrinks every vector by the factor "
        "per_jump, and by e^(-in_time T), for all dwell times T in the range"
    )
    return (Claim("rates", statement, source, verdict.outcome, verdict.evidence),)


def rates_sentence(found: tuple[Claim, ...], what: str) -> list[tuple[str, list[str]]]:
    """The guarantee that a proved rates claim gives, and the claims behind it."""
    for claim in found:
        if claim.id == "rates" and claim.verdict == "proved":
            per_jump, in_time = claim.evidence["per_jump"], claim.evidence["in_time"]
            text = (
                f"Without disturbance and noise, {what} just before a jump shrinks, in a fixed "
                f"norm, to at most {per_jump:.6g} of itself at the next one, and like "
                f"e^(-{in_time:.6g} t) from jump to jump."
            )
            return [(text, ["dwell_stability", "rates"])]
    return []


def _proof(F: Any, H: Any, low: float, high: float, values: Any, paranoid: bool) -> Verdict:
    P = _matrix(values, len(F))
    if P is None:
        return undecided("the certificate P is not a matrix of the right size")
    verdict = prove_common(F, H, P, low, high)
    if verdict.outcome != "proved":
        return verdict
    evidence = {"P": values, **verdict.evidence}
    if paranoid:
        second = prove_common(F, H, P, low, high, method="march")
        if second.outcome != "proved":
            why = second.evidence.get("reason", "")
            return undecided(f"the second method does not confirm the proof: {why}")
        evidence["confirmed_by"] = dict(second.evidence)
    return Verdict("proved", evidence)


def _copositive(F: Any, H: Any, low: float, high: float, certificate: Mapping[str, Any]) -> Verdict:
    """The proof by one vector, for positive systems."""
    side, form = certificate.get("side"), certificate.get("form")
    vector = _numbers(certificate["vector"])
    if vector is None or side not in SIDES or form not in FORMS:
        return undecided("the certificate is not a vector with its side and form")
    verdict = prove_copositive(F, H, vector, low, high, side=side, form=form)
    return Verdict(verdict.outcome, {"vector": certificate["vector"], **verdict.evidence})


def _dwell_times(witness: Any, low: float, high: float) -> list[float]:
    """The sequence of a witness, if all of it is admissible."""
    thetas = witness.get("thetas") if isinstance(witness, Mapping) else None
    if not isinstance(thetas, list) or not all(isinstance(theta, float) for theta in thetas):
        return []
    return thetas if all(low <= theta <= high for theta in thetas) else []


def _no_common(F: Any, H: Any, low: float, high: float, certificate: Any) -> Verdict | None:
    """Undecided, a common P being proved not to exist; None if the certificate shows nothing."""
    thetas = _dwell_times(certificate, low, high)
    if not thetas or prove_no_common(F, H, thetas, certificate["multipliers"]).outcome != "proved":
        return None
    return undecided(
        f"no common P exists for {len(thetas)} of the dwell times (checked dual certificate), "
        "which is not instability"
    )


def _matrix(values: Any, n: int) -> Any:
    P = _numbers(values)
    return P if P is not None and P.shape == (n, n) else None


def _numbers(values: Any) -> Any:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
