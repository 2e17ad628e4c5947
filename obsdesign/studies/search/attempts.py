"""Candidates whose range of dwell times is searched for, with their brackets.

A witness against gains or a form that synthesis chose is none against the problem: a range is
refuted where the claims of every candidate are, as answers to the problem with that range.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact
from lmi.decide.dwell_search import Bracket, longest_dwell, shortest_dwell
from lmi.time_budget import Remark
from lmi.verdict import overall
from obsdesign.document import Claim
from obsdesign.problem.options import LuenbergerOptions, memory_of
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.kind import synthesis_of
from obsdesign.verification.answers import as_answers
from obsdesign.verification.kind import dwell_verification_of, verification_of

# claims about the range itself; all others must hold before one is searched for
_RANGE_CLAIMS = ("attainable", "dwell_stability", "decay_rate", "hurwitz", "rates")


@dataclass(frozen=True)
class Attempt:
    """A candidate, claims about it on the file's range, and its bracket where one was sought.

    claims: as answers to the problem. is_usable: do the hypotheses that every range needs hold?
    """

    candidate: Any
    claims: tuple[Claim, ...]
    gains: Mapping[str, Any]
    is_usable: bool
    bracket: Bracket | None = None

    @property
    def proves_range(self) -> bool:
        """Is there a certificate for the range of the file?"""
        certificate = self.candidate.certificates.get("dwell_stability", {})
        return self.is_usable and bool({"P", "windows"} & set(certificate))

    @property
    def is_open(self) -> bool:
        """May some range hold? Not where the gains are refuted for every range."""
        return self.is_usable or overall(c.verdict for c in self.claims) != "refuted"

    def reach(self, shortest: bool) -> float:
        """Extent of the proved range; larger is better."""
        if self.bracket is None or self.bracket.proved is None:
            return -math.inf
        return -self.bracket.proved if shortest else self.bracket.proved

    def refutes(self, problem: Problem, end: float, shortest: bool) -> bool:
        """Is every choice of this form refuted on the range from `end`, or up to it?"""
        bracket = self.bracket
        if not self.candidate.searched and bracket is not None and bracket.verdict == "refuted":
            nearest = bracket.not_proved
            if nearest is not None and (end <= nearest if shortest else end >= nearest):
                return True
        low, high = problem.require_dwell_time()
        ends = (end, high) if shortest else (low, end)
        if math.isinf(ends[0]):  # of an endless range nothing is left: the file's own is no better
            ends = low, high
        gains = {**self.gains, "dwell_time": list(ends)}
        verification = verification_of(problem.require_kind())
        claims = verification.claims(problem.with_dwell_time(*ends), gains, {})
        claims = as_answers(self.candidate, claims)
        return overall(claim.verdict for claim in claims) == "refuted"


def attempts(problem: Problem, remarks: Sequence[Remark]) -> list[Attempt]:
    """Candidates of synthesis, until one is proved for the range of the file."""
    synthesis = synthesis_of(problem.require_kind())
    tried = list[Attempt]()
    for candidate in synthesis.synthesize(problem):
        tried.append(_attempt(problem, candidate, remarks))
        if not candidate.goes_on and any(one.proves_range for one in tried):
            break
    return tried


def _attempt(problem: Problem, candidate: Any, remarks: Sequence[Remark]) -> Attempt:
    gains = candidate.document()
    claims = verification_of(problem.require_kind()).claims(problem, gains, {})
    is_usable = all(c.verdict == "proved" for c in claims if c.id not in _RANGE_CLAIMS)
    return Attempt(candidate, as_answers(candidate, claims, remarks), gains, is_usable)


def with_brackets(
    problem: Problem, tried: Sequence[Attempt], shortest: bool, accuracy: float
) -> list[Attempt]:
    """The attempts, with the bracket of each that may hold the answer.

    Of gains that were searched for, the first that are proved for the file's range, or else for
    any.
    """
    chosen = next((i for i, one in enumerate(tried) if one.proves_range), None)
    if chosen is not None and any(one.candidate.searched for one in tried[: chosen + 1]):
        order = [chosen]
    else:
        order = [i for i, one in enumerate(tried) if one.is_usable]
    attempts = list(tried)
    for i in order:
        bracket = _bracket(problem, tried[i], shortest, accuracy)
        attempts[i] = replace(tried[i], bracket=bracket)
        if tried[i].candidate.searched and bracket.proved is not None:
            break
    return attempts


def _bracket(problem: Problem, attempt: Attempt, shortest: bool, accuracy: float) -> Bracket:
    low, high = problem.require_dwell_time()
    F, H = dwell_verification_of(problem.require_kind()).dwell_pair(attempt.gains)
    # a required decay rate has to hold over the whole range
    options = problem.options
    rate = options.decay_rate if isinstance(options, LuenbergerOptions) else 0.0
    F = F + exact(rate * np.eye(problem.plant.n))
    jump = problem.plant.jump
    find, kept = (shortest_dwell, high) if shortest else (longest_dwell, low)
    return find(
        F,
        H,
        kept,
        accuracy=accuracy,
        memory=memory_of(options),
        jitter=math.inf if jump is None else jump.dwell_jitter,
    )
