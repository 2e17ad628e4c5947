"""Shortest and longest dwell time of an observer: a bracket, proved on one side.

The searched end of `jump.dwell_time` is replaced; the other end and all that the file gives is
kept, and gains that are missing are synthesised first. The proved end is claimed and proved like
any design.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact
from lmi.decide.dwell_search import ACCURACY, Bracket, longest_dwell, shortest_dwell
from lmi.time_budget import (
    Remark,
    collect_remarks,
    ended_part,
    stretch_factors,
    stretched,
    total_budget,
)
from lmi.verdict import overall
from obsdesign import workflow
from obsdesign.document import Claim
from obsdesign.errors import InputError
from obsdesign.problem.kinds import DWELL_SEARCHES, PERIOD_SEARCHES, SEARCHES
from obsdesign.problem.options import LuenbergerOptions, memory_of
from obsdesign.problem.problem import Problem
from obsdesign.studies.search import period as period_search
from obsdesign.studies.search.result import SearchResult
from obsdesign.verification.answers import as_answers, is_ended

# claims about the range itself; all others must hold before one is searched for
_RANGE_CLAIMS = ("dwell_stability", "decay_rate", "hurwitz", "rates")


@dataclass(frozen=True)
class _Attempt:
    """One candidate with its bracket; None where its gains are refused for every range."""

    label: str
    bracket: Bracket | None
    claims: tuple[Claim, ...]
    gains: Mapping[str, Any]
    searched: bool = False

    @property
    def is_open(self) -> bool:
        """May some range hold? Not where the gains are refuted for every range."""
        return self.bracket is not None or overall(c.verdict for c in self.claims) != "refuted"

    def reach(self, shortest: bool) -> float:
        """Extent of the proved range; larger is better."""
        if self.bracket is None or self.bracket.proved is None:
            return -math.inf
        return -self.bracket.proved if shortest else self.bracket.proved


def search(
    problem: Problem, what: str, accuracy: float = ACCURACY, *, seconds: float | None = None
) -> workflow.Outcome:
    """The bracket for `what`; accuracy is its relative width.

    The outcome's result is that of `SearchResult`, or of `period.search_period`.
    Verdict: proved when the bracket is as tight as asked, undecided when it is wider, refuted when
    no range is admissible. InputError when the kind has no such search.

    seconds: of processor time that searches may take in all; None for their own budgets, which a
    larger total stretches until the bracket is as tight as asked.
    """
    require_search(problem, what, accuracy)
    best: workflow.Outcome | None = None
    with total_budget(seconds):
        for factor in stretch_factors():
            with stretched(factor):
                outcome = _searched(problem, what, accuracy)
            best = outcome if best is None else max(best, outcome, key=lambda o: _quality(o, what))
            if not SearchResult.from_dict(outcome.result).ended:
                break
    assert best is not None
    return best


def _quality(outcome: workflow.Outcome, what: str) -> tuple[int, float, float]:
    """Rank of an answer to a search: decided, far on the proved side, tight."""
    rank = ("undecided", "refuted", "proved").index(outcome.verdict)
    result = SearchResult.from_dict(outcome.result)
    proved, other = result.proved, result.not_proved
    if proved is None:
        return rank, -math.inf, -math.inf
    reach = -proved if what.startswith("shortest") else proved
    gap = 0.0 if other is None or other == proved else abs(other - proved)
    return rank, reach, -gap


def _searched(problem: Problem, what: str, accuracy: float) -> workflow.Outcome:
    """One attempt, with the budgets that are in force."""
    if what in PERIOD_SEARCHES:
        return period_search.search_period(problem, what)
    kind, shortest = problem.require_kind(), what == "shortest_dwell"
    tried: list[_Attempt] = []
    with collect_remarks() as remarks:
        for candidate in _candidates(problem):
            tried.append(_bracket(problem, candidate, shortest, accuracy, remarks))
            if candidate.searched and tried[-1].bracket is not None:
                break
    # a refuted form does not refute the problem while another one is open
    best = max(tried, key=lambda attempt: (attempt.reach(shortest), attempt.is_open))
    gains_ended = next((entry.evidence for entry in reversed(remarks) if entry.evidence), {})
    return _outcome(problem, kind, best, shortest, accuracy, gains_ended)


def require_accuracy(accuracy: float) -> None:
    """InputError unless it is the relative width of a bracket that can be found."""
    if not (math.isfinite(accuracy) and 1e-12 <= accuracy < 1):
        raise InputError(f"--accuracy must be a number from 1e-12 to 1; got {accuracy!r}.")


def require_search(problem: Problem, what: str, accuracy: float = ACCURACY) -> None:
    """InputError unless `search` knows this limit for a problem of this kind."""
    kind = problem.require_kind()
    if what not in SEARCHES:
        raise InputError(f"--for must be one of {', '.join(SEARCHES)}; got {what!r}.")
    if kind == "finite_time" and what in PERIOD_SEARCHES:
        return
    if what not in DWELL_SEARCHES or kind not in ("interval", "luenberger"):
        raise InputError(f"--for {what} is not available for kind {kind!r} in this version.")
    if problem.plant.output.measured == "periodic":
        raise InputError(
            f"--for {what} is not available with output.measured = 'periodic'; it must be "
            "continuous or at_jumps."
        )
    require_accuracy(accuracy)
    problem.require_dwell_time()
    if "schedule" in problem.options:
        raise InputError(
            "--for dwell times: observer.schedule divides a range that is fixed; search without it."
        )


def _candidates(problem: Problem) -> list[Any]:
    """Candidates of synthesis; of gains that were searched for, the proved one."""
    synthesis = workflow.layer("synthesis", problem.require_kind())
    candidates, proved = [], []
    for candidate in synthesis.synthesize(problem):
        candidates.append(candidate)
        if {"P", "windows"} & set(candidate.certificates.get("dwell_stability", {})):
            proved.append(candidate)
        if proved and not candidate.goes_on:
            break
    return proved[:1] if proved and candidates[0].searched else candidates


def _bracket(
    problem: Problem, candidate: Any, shortest: bool, accuracy: float, remarks: Sequence[Remark]
) -> _Attempt:
    verification = workflow.layer("verification", problem.require_kind())
    gains = candidate.document()
    claims = verification.claims(problem, gains, {})
    claims = as_answers(candidate, claims, remarks)
    if any(c.verdict != "proved" for c in claims if c.id not in _RANGE_CLAIMS):
        return _Attempt(candidate.label, None, claims, gains)
    low, high = problem.require_dwell_time()
    F, H = verification.dwell_pair(gains)
    # a required decay rate has to hold over the whole range
    options = problem.options
    rate = (options.decay_rate or 0.0) if isinstance(options, LuenbergerOptions) else 0.0
    F = F + exact(rate * np.eye(problem.plant.n))
    jump = problem.plant.jump
    find, kept = (shortest_dwell, high) if shortest else (longest_dwell, low)
    bracket = find(
        F,
        H,
        kept,
        accuracy=accuracy,
        memory=memory_of(options),
        jitter=math.inf if jump is None else jump.dwell_jitter,
    )
    return _Attempt(candidate.label, bracket, claims, gains, candidate.searched)


def _outcome(
    problem: Problem,
    kind: str,
    best: _Attempt,
    shortest: bool,
    accuracy: float,
    gains_ended: Mapping[str, Any],
) -> workflow.Outcome:
    bracket = best.bracket
    if bracket is None:
        verdict = overall(claim.verdict for claim in best.claims)
        end = next((ended_part(claim.evidence) for claim in best.claims if is_ended(claim)), {})
        ended: Mapping[str, Any] = end if verdict == "undecided" else {}
        result = SearchResult(form=best.label, ended=ended)
        return workflow.Outcome(verdict, kind, best.claims, result.to_dict(), None)
    result = _result(problem, best, bracket, shortest, accuracy)
    if bracket.proved is None:
        # other gains may prove a range where these do not; time may have ended before all was tried
        is_open = best.searched or bracket.ended
        verdict = "undecided" if is_open else bracket.verdict or "undecided"
        ended = (bracket.ended or gains_ended) if verdict == "undecided" else {}
        body = replace(result, ended=ended).to_dict()
        return workflow.Outcome(verdict, kind, best.claims, body, None)
    low, high = problem.require_dwell_time()
    ends = (bracket.proved, high) if shortest else (low, bracket.proved)
    narrowed = problem.with_dwell_time(*ends)
    gains = {**best.gains, "dwell_time": list(ends)}
    verification = workflow.layer("verification", kind)
    certificates = {"dwell_stability": bracket.certificate, "decay_rate": bracket.certificate}
    claims = verification.claims(narrowed, gains, certificates)
    proved = overall(c.verdict for c in claims) == "proved"
    unit = high if math.isfinite(high) else 1.0 / float(np.abs(best.gains["A"]).max())
    verdict = "proved" if proved and _is_tight(bracket, accuracy, unit) else "undecided"
    result = replace(result, ended=bracket.ended if verdict == "undecided" else {})
    return workflow.Outcome(verdict, kind, claims, result.to_dict(), None)


def _result(
    problem: Problem, best: _Attempt, bracket: Bracket, shortest: bool, accuracy: float
) -> SearchResult:
    """The result of an attempt that has a bracket.

    A witness against gains that were searched for does not concern other gains: the far end is
    refuted for the gains of the file only.
    """
    witness, reason, verdict = bracket.obstacle.get("witness"), _reason(bracket), bracket.verdict
    these_gains: Mapping[str, Any] = {}
    if best.searched and verdict == "refuted":
        these_gains = {"witness": witness}
        witness, verdict = None, "undecided"
        reason = f"other gains may do; for these, {reason}"
    return SearchResult(
        proved=bracket.proved,
        not_proved=bracket.not_proved,
        not_proved_verdict=verdict,
        accuracy=accuracy,
        kept=problem.require_dwell_time()[1 if shortest else 0],
        common_P=bracket.common,
        open=_relative_gap(bracket),
        islands=tuple(bracket.islands),
        reason=reason,
        witness=witness,
        these_gains=these_gains,
        form=best.label,
        gains={name: best.gains[name] for name in ("L", "M")},
    )


def _is_tight(bracket: Bracket, accuracy: float, unit: float) -> bool:
    if bracket.proved is None or bracket.not_proved is None:
        return bracket.proved is not None
    if math.isinf(bracket.not_proved):
        return False  # every finite end may hold: no bracket around infinity is tight
    if bracket.not_proved == 0:
        return bracket.proved <= accuracy * unit  # nothing is close to zero relative to itself
    width = abs(bracket.proved - bracket.not_proved)
    return width <= accuracy * max(abs(bracket.proved), abs(bracket.not_proved)) * (1 + 1e-9)


def _relative_gap(bracket: Bracket) -> float | None:
    """Relative width of what is neither proved nor refuted; None where that has no meaning."""
    if bracket.proved is None or not bracket.not_proved or math.isinf(bracket.not_proved):
        return None
    return abs(bracket.proved / bracket.not_proved - 1)


def _reason(bracket: Bracket) -> str | None:
    """Reason for which the other side is not proved."""
    witness = bracket.obstacle.get("witness", {})
    text = bracket.obstacle.get("reason") or witness.get("reason")
    return None if text is None else str(text)
