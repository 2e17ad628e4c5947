"""Candidates whose range of dwell times is searched for, with their brackets.

A witness against gains or a form that synthesis chose is none against the problem: a range is
refuted where the claims of every candidate are, as answers to the problem with that range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Entries
from lmi.arithmetic.balls import exact
from lmi.decide.dwell_problem import Direction, dwell_range
from lmi.decide.dwell_search import Bracket, dwell_bracket
from lmi.time_budget import Remark, TimeBudget
from lmi.verdict import overall
from obsdesign.document import Claim
from obsdesign.entries import SMALLEST
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.dwell import stability_options
from obsdesign.synthesis.kind import synthesis_of
from obsdesign.verification.answers import as_answers
from obsdesign.verification.dwell import DwellCertificate
from obsdesign.verification.kind import dwell_verification_of, verification_of

# claims about the range itself; all others must hold before one is searched for
_RANGE_CLAIMS = ("attainable", "dwell_stability", "decay_rate", "hurwitz", "rates")


@dataclass(frozen=True)
class DwellSearch:
    """A problem and the end of its range of dwell times that is searched for."""

    problem: Problem
    direction: Direction
    accuracy: float
    budget: TimeBudget

    @property
    def kept(self) -> float:
        """The end of the range that is kept."""
        return self.problem.require_dwell_time()[1 if self.direction == "shortest" else 0]

    def ends(self, x: float) -> tuple[float, float]:
        """The range (shortest, longest) whose searched end is x."""
        return dwell_range(self.direction, x, self.kept)

    def reach(self, x: float | None) -> float:
        """Extent of the range whose searched end is x, larger is better; -inf without a range."""
        if x is None:
            return -math.inf
        return -x if self.direction == "shortest" else x


@dataclass(frozen=True)
class Attempt:
    """A candidate, claims about it on the file's range, and its bracket where one was sought.

    claims: as answers to the problem. is_usable: do the hypotheses that every range needs hold?
    """

    candidate: Candidate
    claims: tuple[Claim, ...]
    gains: Entries
    is_usable: bool
    bracket: Bracket | None = None

    @property
    def proves_range(self) -> bool:
        """Is there a certificate for the range of the file?"""
        stated = self.candidate.certificates.get("dwell_stability", {})
        return self.is_usable and DwellCertificate.from_document(stated).has_matrices

    @property
    def is_open(self) -> bool:
        """May some range hold? Not where the gains are refuted for every range."""
        return self.is_usable or overall(c.verdict for c in self.claims) != "refuted"

    @property
    def proved(self) -> float | None:
        """The end of the range that is proved."""
        return None if self.bracket is None else self.bracket.proved

    def refutes(self, search: DwellSearch, end: float) -> bool:
        """Is every choice of this form refuted on the range from `end`, or up to it?"""
        bracket = self.bracket
        if not self.candidate.searched and bracket is not None and bracket.verdict == "refuted":
            nearest = bracket.not_proved
            if nearest is not None and search.reach(end) >= search.reach(nearest):
                return True
        ends = search.ends(end)
        if math.isinf(ends[0]):  # of an endless range nothing is left: the file's own is no better
            ends = search.problem.require_dwell_time()
        if ends[1] == 0:  # no range, but part of the shortest one
            ends = (0.0, SMALLEST)
        gains = {**self.gains, "dwell_time": list(ends)}
        verification = verification_of(search.problem.require_kind())
        claims = verification.claims(
            search.problem.with_dwell_time(*ends), gains, {}, budget=search.budget
        )
        claims = as_answers(self.candidate, claims)
        return overall(claim.verdict for claim in claims) == "refuted"


def attempts(search: DwellSearch) -> list[Attempt]:
    """Candidates of synthesis, until one is proved for the range of the file."""
    kind = search.problem.require_kind()
    synthesis, verification = synthesis_of(kind), verification_of(kind)
    tried, remarks = list[Attempt](), list[Remark]()
    for candidate in synthesis.synthesize(search.problem, search.budget):
        remarks += candidate.remarks
        gains = candidate.document()
        claims = verification.claims(search.problem, gains, {}, budget=search.budget)
        is_usable = all(c.verdict == "proved" for c in claims if c.id not in _RANGE_CLAIMS)
        claims = as_answers(candidate, claims, remarks)
        tried.append(Attempt(candidate, claims, gains, is_usable))
        if not candidate.goes_on and any(one.proves_range for one in tried):
            break
    return tried


def with_brackets(search: DwellSearch, tried: Sequence[Attempt]) -> list[Attempt]:
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
        bracket = _bracket(search, tried[i])
        attempts[i] = replace(tried[i], bracket=bracket)
        if tried[i].candidate.searched and bracket.proved is not None:
            break
    return attempts


def _bracket(search: DwellSearch, attempt: Attempt) -> Bracket:
    problem = search.problem
    F, H = dwell_verification_of(problem.require_kind()).dwell_pair(attempt.gains)
    # a required decay rate has to hold over the whole range
    options = problem.options
    rate = options.decay_rate if isinstance(options, LuenbergerOptions) else 0.0
    F = F + exact(rate * np.eye(problem.plant.n))
    return dwell_bracket(
        F, H, search.direction, search.kept, accuracy=search.accuracy,
        **stability_options(problem, search.budget),
    )  # fmt: skip
