"""Shortest and longest dwell time of an observer: a bracket, proved on one side.

The searched end of `jump.dwell_time` is replaced; the other end and all that the file gives is
kept, and gains that are missing are synthesised first. The proved end is claimed and proved like
any design.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
from obsdesign.problem.problem import Problem
from obsdesign.studies.search import period as period_search
from obsdesign.verification.answers import as_answers, is_ended

# claims about the range itself; all others must hold before a range is looked for
_OF_THE_RANGE = ("dwell_stability", "decay_rate", "hurwitz", "rates")


@dataclass(frozen=True)
class _Try:
    """One candidate with its bracket (None: its gains are refused whatever the range)."""

    label: str
    bracket: Bracket | None
    claims: tuple[Claim, ...]
    gains: Mapping[str, Any]
    searched: bool = False

    @property
    def is_open(self) -> bool:
        """Is it not refuted whatever the range?"""
        return self.bracket is not None or overall(c.verdict for c in self.claims) != "refuted"

    def reach(self, shortest: bool) -> float:
        """How far the proved range reaches; larger is better."""
        if self.bracket is None or self.bracket.proved is None:
            return -math.inf
        return -self.bracket.proved if shortest else self.bracket.proved


def search(
    problem: Problem, what: str, accuracy: float = ACCURACY, *, seconds: float | None = None
) -> workflow.Outcome:
    """The bracket for `what`; accuracy is its relative width.

    result: {"proved", "not_proved", "not_proved_verdict", "accuracy", "common_P", "open",
    "islands", "form", "gains"}; common_P is the end that one P proves, where windows of dwell times
    were tried beyond it, open what is left between proved and not proved, relative to the latter.
    Where a budget ended the search, also what `lmi.time_budget.ended` has of it.
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
            if not ended_part(outcome.result):
                break
    assert best is not None
    return best


def _quality(outcome: workflow.Outcome, what: str) -> tuple[int, float, float]:
    """Of two answers to one search the larger is better: decided, far on the proved side, tight."""
    rank = ("undecided", "refuted", "proved").index(outcome.verdict)
    proved, other = outcome.result["proved"], outcome.result["not_proved"]
    if proved is None:
        return rank, -math.inf, -math.inf
    reach = -proved if what.startswith("shortest") else proved
    return rank, reach, 0.0 if other in (None, proved) else -abs(other - proved)


def _searched(problem: Problem, what: str, accuracy: float) -> workflow.Outcome:
    """One attempt, with the budgets that are in force."""
    if what in PERIOD_SEARCHES:
        return period_search.search_period(problem, what)
    kind, shortest = problem.require_kind(), what == "shortest_dwell"
    tried: list[_Try] = []
    with collect_remarks() as remarks:
        for candidate in _candidates(problem):
            tried.append(_bracket(problem, candidate, shortest, accuracy, remarks))
            if candidate.searched and tried[-1].bracket is not None:
                break
    # a form that is refuted refutes nothing while another one is open
    best = max(tried, key=lambda one: (one.reach(shortest), one.is_open))
    gains_ended = next((one.evidence for one in reversed(remarks) if one.evidence), {})
    return _outcome(problem, kind, best, shortest, accuracy, gains_ended)


def require_accuracy(accuracy: float) -> None:
    """InputError unless it is the relative width of a bracket that can be found."""
    if not (math.isfinite(accuracy) and 1e-12 <= accuracy < 1):
        raise InputError(f"--accuracy must be a number from 1e-12 to 1; got {accuracy!r}.")


def require_search(problem: Problem, what: str, accuracy: float = ACCURACY) -> None:
    """InputError unless `search` can be asked this of a problem of this kind."""
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
    """What the problem gives or leaves to be found; of gains that were searched for, the proved."""
    synthesis = workflow.layer("synthesis", problem.require_kind())
    found, proved = [], []
    for candidate in synthesis.synthesize(problem):
        found.append(candidate)
        if {"P", "windows"} & set(candidate.certificates.get("dwell_stability", {})):
            proved.append(candidate)
        if proved and not candidate.goes_on:
            break
    return proved[:1] if proved and found[0].searched else found


def _bracket(
    problem: Problem, candidate: Any, shortest: bool, accuracy: float, remarks: Sequence[Remark]
) -> _Try:
    verification = workflow.layer("verification", problem.require_kind())
    claims = verification.claims(problem, candidate.gains, {})
    claims = as_answers(candidate, claims, remarks)
    if any(c.verdict != "proved" for c in claims if c.id not in _OF_THE_RANGE):
        return _Try(candidate.label, None, claims, candidate.gains)
    low, high = problem.require_dwell_time()
    F, H = verification.dwell_pair(candidate.gains)
    # a decay rate that is asked for has to hold over the range that is found
    F = F + exact(float(problem.options.get("decay_rate", 0.0)) * np.eye(problem.plant.n))
    jump = problem.plant.jump
    asked: dict[str, Any] = {
        "accuracy": accuracy,
        "memory": problem.options.get("memory", "auto"),
        "jitter": math.inf if jump is None else jump.dwell_jitter,
    }
    find, kept = (shortest_dwell, high) if shortest else (longest_dwell, low)
    bracket = find(F, H, kept, **asked)
    return _Try(candidate.label, bracket, claims, candidate.gains, candidate.searched)


def _outcome(
    problem: Problem,
    kind: str,
    best: _Try,
    shortest: bool,
    accuracy: float,
    gains_ended: Mapping[str, Any],
) -> workflow.Outcome:
    bracket = best.bracket
    result: dict[str, Any] = {"proved": None, "not_proved": None, "not_proved_verdict": None}
    if bracket is None:
        verdict = overall(claim.verdict for claim in best.claims)
        end = next((ended_part(claim.evidence) for claim in best.claims if is_ended(claim)), {})
        result |= {"form": best.label} | (end if verdict == "undecided" else {})
        return workflow.Outcome(verdict, kind, best.claims, result, None)
    result |= _numbers(problem, best, bracket, shortest, accuracy)
    if bracket.proved is None:
        # other gains may do where those that were found do not
        open_question = best.searched or bracket.ended  # time may have ended before all was tried
        verdict = "undecided" if open_question else bracket.verdict or "undecided"
        result |= (bracket.ended or gains_ended) if verdict == "undecided" else {}
        return workflow.Outcome(verdict, kind, best.claims, result, None)
    low, high = problem.require_dwell_time()
    ends = (bracket.proved, high) if shortest else (low, bracket.proved)
    narrowed = problem.with_dwell_time(*ends)
    gains = {**best.gains, "dwell_time": list(ends)}
    verification = workflow.layer("verification", kind)
    certificates = {"dwell_stability": bracket.certificate, "decay_rate": bracket.certificate}
    claims = verification.claims(narrowed, gains, certificates)
    proved = overall(c.verdict for c in claims) == "proved"
    unit = high if math.isfinite(high) else 1.0 / float(np.abs(best.gains["A"]).max())
    verdict = "proved" if proved and _tight(bracket, accuracy, unit) else "undecided"
    result |= bracket.ended if verdict == "undecided" else {}
    return workflow.Outcome(verdict, kind, claims, result, None)


def _numbers(
    problem: Problem, best: _Try, bracket: Bracket, shortest: bool, accuracy: float
) -> dict[str, Any]:
    """What an answer holds of a bracket.

    A witness against gains that were searched for says nothing about other gains: the far end is
    refuted for the gains of the file only.
    """
    witness, reason, verdict = bracket.obstacle.get("witness"), _reason(bracket), bracket.verdict
    these_gains = {}
    if best.searched and verdict == "refuted":
        these_gains = {"these_gains": {"witness": witness}}
        witness, verdict = None, "undecided"
        reason = f"other gains may do; for these, {reason}"
    return {
        "proved": bracket.proved,
        "not_proved": bracket.not_proved,
        "not_proved_verdict": verdict,
        "accuracy": accuracy,
        "kept": problem.require_dwell_time()[1 if shortest else 0],
        "common_P": bracket.common,
        "open": _open(bracket),
        "islands": [list(island) for island in bracket.islands],
        "reason": reason,
        "witness": witness,
        **these_gains,
        "form": best.label,
        "gains": {name: best.gains[name] for name in ("L", "M")},
    }


def _tight(bracket: Bracket, accuracy: float, unit: float) -> bool:
    if bracket.proved is None or bracket.not_proved is None:
        return bracket.proved is not None
    if math.isinf(bracket.not_proved):
        return False  # every finite end may hold: no bracket around infinity is tight
    if bracket.not_proved == 0:
        return bracket.proved <= accuracy * unit  # nothing is close to zero relative to itself
    width = abs(bracket.proved - bracket.not_proved)
    return width <= accuracy * max(abs(bracket.proved), abs(bracket.not_proved)) * (1 + 1e-9)


def _open(bracket: Bracket) -> float | None:
    """Relative width of what is neither proved nor refuted; None where that has no meaning."""
    if bracket.proved is None or not bracket.not_proved or math.isinf(bracket.not_proved):
        return None
    return abs(bracket.proved / bracket.not_proved - 1)


def _reason(bracket: Bracket) -> str | None:
    """Why the other side is not proved."""
    witness = bracket.obstacle.get("witness", {})
    text = bracket.obstacle.get("reason") or witness.get("reason")
    return None if text is None else str(text)
