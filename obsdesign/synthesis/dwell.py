"""Certificates of stability and rates for a pair over a range of dwell times."""

from __future__ import annotations

import math
from dataclasses import asdict

from lmi.arithmetic.arrays import Array, Entries, NewEntries
from lmi.arithmetic.balls import exact, to_float
from lmi.decide.stability import decide
from lmi.find.copositive import decide_copositive, looks_positive
from lmi.find.largest_rates import largest_rates
from lmi.prove.rates import propose_rates
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict
from lmi.window_memory import Memory
from obsdesign.problem.option_table import memory_of
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Certificates

# from so many states on, linear programs come first: a matrix has n (n + 1) / 2 unknowns
_LARGE = 16


def stability_options(problem: Problem, budget: TimeBudget) -> NewEntries:
    """Arguments of `lmi.decide.stability` other than the range: memory, jitter and budget."""
    jump = problem.plant.jump
    jitter = math.inf if jump is None else jump.dwell_jitter
    return {"memory": memory_of(problem.options), "jitter": jitter, "budget": budget}


def dwell_certificates(
    F: Array,
    H: Array,
    low: float,
    high: float,
    *,
    memory: Memory,
    jitter: float,
    budget: TimeBudget,
) -> Certificates:
    """Under the ids of the claims they are for: stability, and the rates its P allows.

    memory, jitter: as in `lmi.decide.stability`.
    """
    verdict = stability_certificate(F, H, low, high, memory=memory, jitter=jitter, budget=budget)
    evidence = verdict.evidence
    certificates = Certificates({"dwell_stability": dict(evidence)}, verdict.solvers)
    rates: Entries | None = None
    if budget.remaining() < 0:
        return certificates
    if "P" in evidence:
        rates = largest_rates(F, H, evidence["P"], low, high, budget=budget)
    elif "windows" in evidence:
        proposed = propose_rates(F, H, evidence, low, high, jitter=jitter)
        rates = None if proposed is None else asdict(proposed)
    # rates are of the same P, or of one by the same solver
    more = Certificates({} if rates is None else {"rates": rates})
    return certificates.joined(more)


def stability_certificate(
    F: Array,
    H: Array,
    low: float,
    high: float,
    *,
    memory: Memory,
    jitter: float = math.inf,
    budget: TimeBudget = UNLIMITED,
) -> Verdict:
    """Evidence that the pair is stable or is not, as far as any is found.

    For positive systems a copositive certificate is tried too: first where matrices are large, else
    where one common P is not enough, before windows are. memory, jitter: as in
    `lmi.decide.stability`.
    """
    positive = looks_positive(to_float(exact(F)), to_float(exact(H)))
    if positive and len(F) >= _LARGE:
        vector = decide_copositive(F, H, low, high)
        if vector.outcome == "proved":
            return vector
    first = 0 if positive else memory
    verdict = decide(F, H, low, high, memory=first, jitter=jitter, budget=budget)
    if positive and verdict.outcome == "undecided":
        if len(F) < _LARGE:
            vector = decide_copositive(F, H, low, high)
            if vector.outcome == "proved":
                return vector
        if memory != 0:
            verdict = decide(F, H, low, high, memory=memory, jitter=jitter, budget=budget)
    return verdict
