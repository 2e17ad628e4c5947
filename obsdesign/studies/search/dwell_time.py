"""Shortest and longest dwell time of an observer: a bracket, proved on one side.

The searched end of `jump.dwell_time` is replaced; the other end and all that the file gives is
kept, and gains that are missing are synthesised first. The proved end is claimed and proved like
any design.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lmi.decide.dwell_problem import Direction
from lmi.decide.dwell_search import ACCURACY, Bracket
from lmi.time_budget import TimeBudget, ended_part, last_end
from lmi.verdict import overall
from obsdesign import workflow
from obsdesign.errors import InputError
from obsdesign.kinds import DWELL_SEARCHES, PERIOD_SEARCHES, SEARCHES
from obsdesign.problem.problem import Problem
from obsdesign.studies.search import period as period_search
from obsdesign.studies.search.attempts import Attempt, DwellSearch, attempts, with_brackets
from obsdesign.studies.search.result import SearchResult
from obsdesign.verification.answers import is_ended
from obsdesign.verification.kind import verification_of


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
    for budget in TimeBudget.from_seconds(seconds).attempts():
        outcome = _searched(problem, what, accuracy, budget)
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


def _searched(problem: Problem, what: str, accuracy: float, budget: TimeBudget) -> workflow.Outcome:
    """One attempt with this budget."""
    if what in PERIOD_SEARCHES:
        return period_search.search_period(problem, what, budget)
    direction: Direction = "shortest" if what == "shortest_dwell" else "longest"
    search = DwellSearch(problem, direction, accuracy, budget)
    tried = with_brackets(search, attempts(search))
    # a refuted form does not refute the problem while another one is open
    best = max(tried, key=lambda attempt: (search.reach(attempt.proved), attempt.is_open))
    end = None if best.bracket is None else best.bracket.not_proved
    of_problem = end is None or all(one.refutes(search, end) for one in tried)
    gains_ended = last_end([remark for one in tried for remark in one.candidate.remarks])
    return _outcome(search, best, of_problem, gains_ended)


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
    if problem.options.is_stated("schedule"):
        raise InputError(
            "--for dwell times: observer.schedule divides a range that is fixed; search without it."
        )


def _outcome(
    search: DwellSearch, best: Attempt, of_problem: bool, gains_ended: Mapping[str, Any]
) -> workflow.Outcome:
    bracket, kind = best.bracket, search.problem.require_kind()
    if bracket is None:
        verdict = overall(claim.verdict for claim in best.claims)
        end = next((ended_part(claim.evidence) for claim in best.claims if is_ended(claim)), {})
        ended: Mapping[str, Any] = end if verdict == "undecided" else {}
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
    these_gains: Mapping[str, Any] = {}
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
        open=_relative_gap(bracket),
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
