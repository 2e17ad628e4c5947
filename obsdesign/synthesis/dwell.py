"""Certificates for a pair and a range of dwell times: what a finder hands to verification."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from lmi.copositive import decide_copositive
from lmi.decide import Memory, decide
from lmi.largest_rates import largest_rates
from lmi.rates import propose_rates
from obsdesign.problem import Problem

# from so many states on, linear programs come first: a matrix has n (n + 1) / 2 unknowns
_LARGE = 16


def question(problem: Problem) -> dict[str, Any]:
    """What a problem asks of `lmi.decide` beside the range: memory and jitter."""
    jump = problem.plant.jump
    jitter = math.inf if jump is None else jump.dwell_jitter
    return {"memory": problem.options.get("memory", "auto"), "jitter": jitter}


def dwell_certificates(
    F: Any,
    H: Any,
    low: float,
    high: float,
    *,
    memory: Memory = "auto",
    jitter: float = math.inf,
) -> dict[str, Any]:
    """Under the ids of the claims they are for: stability, and the rates its P allows.

    A quadratic certificate is tried, and for positive systems a copositive one: whichever proves.
    memory, jitter: as in `lmi.decide`.
    """
    found: dict[str, Any] = {}
    if len(F) >= _LARGE:
        vector = decide_copositive(F, H, low, high)
        if vector.outcome == "proved":
            return {"dwell_stability": vector.evidence}
    verdict = decide(F, H, low, high, memory=memory, jitter=jitter)
    found["dwell_stability"] = verdict.evidence
    if verdict.outcome == "proved":
        if "P" in verdict.evidence:
            rates = largest_rates(F, H, verdict.evidence["P"], low, high)
        else:
            seen = propose_rates(F, H, verdict.evidence, low, high, jitter)
            rates = None if seen is None else asdict(seen)
        if rates is not None:
            found["rates"] = rates
    elif verdict.outcome == "undecided" and len(F) < _LARGE:
        vector = decide_copositive(F, H, low, high)
        if vector.outcome == "proved":
            found["dwell_stability"] = vector.evidence
    return found
