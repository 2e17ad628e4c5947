"""Candidates tried in turn, what is proved of each, and which of them the design has."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass

from lmi.arithmetic.arrays import NewEntries
from lmi.time_budget import TimeBudget
from lmi.verdict import overall
from obsdesign.document import Claim
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.kind import Constraints, candidates_of, untried_forms
from obsdesign.verification.answers import as_answers, reason
from obsdesign.verification.kind import verification_for


@dataclass(frozen=True)
class FormAnswer:
    """What became of a form: `Outcome.result` holds one for each under "forms"."""

    verdict: str
    reasons: list[str]


@dataclass(frozen=True)
class TriedCandidate:
    """A candidate and what was proved of it, so many seconds after the start."""

    candidate: Candidate
    claims: tuple[Claim, ...]
    verdict: str
    seconds: float


def tried_candidates(
    problem: Problem, first: bool, budget: TimeBudget, constraints: Constraints | None
) -> tuple[list[TriedCandidate], Candidate | None]:
    """Candidates with what was proved of them; and the next one where time ended before it."""
    started = time.perf_counter()
    verification = verification_for(problem)
    candidates, tried = iter(candidates_of(problem, budget, constraints)), list[TriedCandidate]()
    while True:
        is_over = bool(tried) and budget.remaining() < 0
        candidate = next(candidates, None)
        if candidate is None or is_over:
            return tried, candidate
        claims = verification.claims(
            problem, candidate.document(), candidate.certificates, budget=budget
        )
        claims = as_answers(candidate, claims, candidate.remarks)
        verdict = overall(claim.verdict for claim in claims)
        tried.append(TriedCandidate(candidate, claims, verdict, time.perf_counter() - started))
        enough = first or not candidate.goes_on
        if enough and any(one.verdict == "proved" for one in tried):
            return tried, None


def best_candidate(tried: list[TriedCandidate]) -> TriedCandidate:
    """The first proved one, or the proved one of least cost; else an undecided one if any.

    An undecided form may still be true, a refuted one is not; of these the last form is taken,
    which has the weakest hypotheses.
    """
    proved = [one for one in tried if one.verdict == "proved"]
    if proved:
        return min(proved, key=lambda attempt: attempt.candidate.cost or 0.0)
    return min(reversed(tried), key=lambda attempt: ("undecided", "refuted").index(attempt.verdict))


def answers_of_forms(problem: Problem, label: str, tried: list[TriedCandidate]) -> NewEntries:
    """The form of the design, and what became of each."""
    proved = {one.candidate.label for one in tried if one.verdict == "proved"}
    forms = {
        one.candidate.label: _summary(one.verdict, one.claims)
        for one in tried
        if one.verdict == "proved" or one.candidate.label not in proved
    }
    skipped = untried_forms(problem)
    forms |= {name: asdict(FormAnswer("undecided", [why])) for name, why in skipped.items()}
    return {"form": label, "forms": forms}


def _summary(verdict: str, claims: tuple[Claim, ...]) -> NewEntries:
    reasons = [f"{c.id}: {reason(c)}" for c in claims if c.verdict != "proved"]
    return asdict(FormAnswer(verdict, reasons))
