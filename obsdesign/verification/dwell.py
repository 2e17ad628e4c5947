"""Stability for every sequence of dwell times: what the kinds with jumps have in common."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.proof import prove_common
from lmi.spectral import refute_spectral
from lmi.verdict import Verdict, undecided
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
    seen = {**counter.evidence, **attempt.evidence}
    # overflow leaves NaN where a number was looked for: it tells nothing
    return Verdict("undecided", {key: value for key, value in seen.items() if value == value})


def _matrix(values: Any, n: int) -> Any:
    try:
        P = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    return P if P.shape == (n, n) else None
