"""Certificates for a pair and a range of dwell times: what a finder hands to verification."""

from __future__ import annotations

from typing import Any

from lmi.decide import decide
from lmi.rates import propose_rates


def dwell_certificates(F: Any, H: Any, low: float, high: float) -> dict[str, Any]:
    """Under the ids of the claims they are for: stability, and the rates its P allows."""
    verdict = decide(F, H, low, high)
    found: dict[str, Any] = {"dwell_stability": verdict.evidence}
    if "P" in verdict.evidence:
        rates = propose_rates(F, H, verdict.evidence["P"], low, high)
        if rates is not None:
            found["rates"] = {"per_jump": rates.per_jump, "in_time": rates.in_time}
    return found
