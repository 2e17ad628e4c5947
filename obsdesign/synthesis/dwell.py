"""Certificates for a pair and a range of dwell times: what a finder hands to verification."""

from __future__ import annotations

from typing import Any

from lmi.copositive import decide_copositive
from lmi.decide import decide
from lmi.rates import propose_rates

# from so many states on, linear programs come first: a matrix has n (n + 1) / 2 unknowns
_LARGE = 16


def dwell_certificates(F: Any, H: Any, low: float, high: float) -> dict[str, Any]:
    """Under the ids of the claims they are for: stability, and the rates its P allows.

    A quadratic certificate is tried, and for positive systems a copositive one: whichever proves.
    """
    found: dict[str, Any] = {}
    if len(F) >= _LARGE:
        vector = decide_copositive(F, H, low, high)
        if vector.outcome == "proved":
            return {"dwell_stability": vector.evidence}
    verdict = decide(F, H, low, high)
    found["dwell_stability"] = verdict.evidence
    if "P" in verdict.evidence:
        rates = propose_rates(F, H, verdict.evidence["P"], low, high)
        if rates is not None:
            found["rates"] = {"per_jump": rates.per_jump, "in_time": rates.in_time}
    elif verdict.outcome == "undecided" and len(F) < _LARGE:
        vector = decide_copositive(F, H, low, high)
        if vector.outcome == "proved":
            found["dwell_stability"] = vector.evidence
    return found
