"""Shortest and longest dwell time of an observer: a bracket, proved on one side.

The searched end of `jump.dwell_time` is replaced; the other end and all that the file gives is
kept, and gains that are missing are synthesised first. The proved end is claimed and proved like
any design.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Entries
from lmi.decide.dwell_problem import Direction
from lmi.decide.dwell_search import Bracket
from lmi.time_budget import TimeBudget, ended_part, last_end
from lmi.verdict import overall
from obsdesign import workflow
from obsdesign.problem.problem import Problem
from obsdesign.studies.search.attempts import Attempt, DwellSearch, attempts, with_brackets
from obsdesign.studies.search.result import SearchResult
from obsdesign.verification.answers import is_ended
from obsdesign.verification.kind import verification_of


def search_dwell_time(
    problem: Problem, direction: Direction, accuracy: float, budget: TimeBudget
) -> workflow.Outcome:
    """One attempt at the bracket of an end of the range with this budget."""
    search = DwellSearch(problem, direction, accuracy, budget)
    tried = with_brackets(search, attempts(search))
    # a refuted form does not refute the problem while another one is open
    best = max(tried, key=lambda attempt: (search.reach(attempt.proved), attempt.is_open))
    end = None if best.bracket is None else best.bracket.not_proved
    of_problem = end is None or all(one.refutes(search, end) for one in tried)
    gains_ended = last_end([remark for one in tried for remark in one.candidate.remarks])
    return _outcome(search, best, of_problem, gains_ended)


def _outcome(
    search: DwellSearch, best: Attempt, of_problem: bool, gains_ended: Entries
) -> workflow.Outcome:
    bracket, kind = best.bracket, search.problem.require_kind()
    if bracket is None:
        verdict = overall(claim.verdict for claim in best.claims)
        end = next((ended_part(claim.evidence) for claim in best.claims if is_ended(claim)), {})
        ended: Entries = end if verdict == "undecided" else {}
        result = SearchResult(form=best.candidate.label, ended=ended)
        return workflow.Outcome(verdict, kind, best.claims, result.to_dict(), None)
    result = _result(search, best, bracket, of_problem)
    if bracket.proved is None:
        # other choices may prove a range where these do not; time may have ended before all was
        # tried
        is_open = not of_problem or bracket.ended
        verdict = "undecided" if is_open else bracket.verdict or "undecided"
        ended = (bracket.ended or gains_ended) if verdict == "undecided" else {}
        body = replace(result, ended=ended).to_dict()
        return workflow.Outcome(verdict, kind, best.claims, body, None)
    ends = search.ends(bracket.proved)
    narrowed = search.problem.with_dwell_time(*ends)
    gains = {**best.gains, "dwell_time": list(ends)}
    verification = verification_of(kind)
    certificates = {"dwell_stability": bracket.certificate, "decay_rate": bracket.certificate}
    claims = verification.claims(narrowed, gains, certificates, budget=search.budget)
    proved = overall(c.verdict for c in claims) == "proved"
    is_tight = _is_tight(bracket, search.accuracy, _unit_of_time(search.problem))
    verdict = "proved" if proved and is_tight else "undecided"
    result = replace(result, ended=bracket.ended if verdict == "undecided" else {})
    return workflow.Outcome(verdict, kind, claims, result.to_dict(), None)


def _unit_of_time(problem: Problem) -> float:
    """What dwell times next to zero are short against."""
    low, high = problem.require_dwell_time()
    rate = float(np.abs(problem.plant.flow.A).max())
    if math.isfinite(high):
        return high
    return 1.0 / rate if rate > 0 else low or 1.0


def _result(search: DwellSearch, best: Attempt, bracket: Bracket, of_problem: bool) -> SearchResult:
    """The result of an attempt that has a bracket.

    of_problem: does a witness against these gains hold for all that the problem leaves open? Else
    the far end is refuted for these gains only.
    """
    witness, reason, verdict = bracket.obstacle.get("witness"), _reason(bracket), bracket.verdict
    these_gains: Entries = {}
    if not of_problem and verdict == "refuted":
        these_gains = {"witness": witness}
        witness, verdict = None, "undecided"
        others = "gains" if best.candidate.searched else "forms"
        reason = f"other {others} may do; for these, {reason}"
    return SearchResult(
        proved=bracket.proved,
        not_proved=bracket.not_proved,
        not_proved_verdict=verdict,
        accuracy=search.accuracy,
        kept=search.kept,
        common_P=bracket.common,
        open=bracket.relative_gap,
        islands=tuple(bracket.islands),
        reason=reason,
        witness=witness,
        these_gains=these_gains,
        form=best.candidate.label,
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


def _reason(bracket: Bracket) -> str | None:
    """Reason for which the other side is not proved."""
    witness = bracket.obstacle.get("witness", {})
    text = bracket.obstacle.get("reason") or witness.get("reason")
    return None if text is None else str(text)
