"""Stability for every sequence of dwell times: what the kinds with jumps have in common."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.proof import prove_common
from lmi.spectral import refute_spectral
from lmi.verdict import Verdict, undecided


def range_text(low: float, high: float) -> str:
    """A range of dwell times in words that round-trip: [0.7, inf)."""
    return f"[{low!r}, inf)" if math.isinf(high) else f"[{low!r}, {high!r}]"


def dwell_stability(
    F: Any, H: Any, low: float, high: float, certificate: Mapping[str, Any], paranoid: bool
) -> Verdict:
    """Is x -> e^{F theta} H x stable for every sequence of theta in [low, high]?

    certificate: {"P": n x n} if a finder has one; it is proved here or not used. Refuted only by a
    checked witness. paranoid: the proof is repeated by the second, independent method.
    """
    attempt = undecided("no certificate P was given or found")
    if "P" in certificate:
        P = _matrix(certificate["P"], len(F))
        attempt = undecided("the certificate P is not a matrix of the right size")
        if P is not None:
            attempt = prove_common(F, H, P, low, high)
        if attempt.outcome == "proved":
            return Verdict("proved", {"P": certificate["P"], **attempt.evidence})
    counter = refute_spectral(F, H, low, high)
    if counter.outcome == "refuted":
        return counter
    worst = {key: counter.evidence[key] for key in ("spectral_radius",) if key in counter.evidence}
    return Verdict("undecided", {**counter.evidence, **worst, **attempt.evidence})


def _matrix(values: Any, n: int) -> Any:
    try:
        P = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return P if P.shape == (n, n) else None
