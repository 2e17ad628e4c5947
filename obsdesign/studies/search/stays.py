"""Shortest and longest stays in modes: a bracket, proved on one side.

The searched end of `mode.every` is replaced, of one mode or of all; the other ends and all that the
file gives is kept, and gains that are missing are synthesised first.
"""

from __future__ import annotations

from dataclasses import dataclass

from lmi.arithmetic.arrays import Entries, NewEntries
from lmi.decide.dwell_problem import Direction
from lmi.decide.dwell_search import Bracket
from lmi.decide.stay_search import stay_bracket
from lmi.time_budget import TimeBudget
from lmi.verdict import overall
from obsdesign import workflow
from obsdesign.document import jsonable
from obsdesign.equations.modes import mode_entries
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.studies.search.result import SearchResult
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.kind import candidates_of
from obsdesign.verification.kind import mode_verification_of


@dataclass(frozen=True)
class _StaySearch:
    """The stays that are searched: which end, of which modes; the relative width of the bracket."""

    problem: Problem
    direction: Direction
    places: list[int]
    accuracy: float


def search_stays(
    problem: Problem, direction: Direction, of: str | None, accuracy: float, budget: TimeBudget
) -> workflow.Outcome:
    """One attempt at the bracket with this budget; of: the mode, None for all.

    InputError for a name that is no mode.
    """
    names = [mode.name for mode in problem.plant.modes]
    if of is not None and of not in names:
        raise InputError(f"--of must be a mode, one of {', '.join(names)}; got {of!r}.")
    places = list(range(len(names))) if of is None else [names.index(of)]
    verification = mode_verification_of(problem.require_kind())
    best: tuple[Candidate, Bracket] | None = None
    for candidate in candidates_of(problem, budget):
        modes = verification.error_modes(problem, candidate.document())
        bracket = stay_bracket(modes, direction, places, accuracy=accuracy, budget=budget)
        if best is None or bracket.proved is not None:
            best = candidate, bracket
        if bracket.proved is not None or budget.remaining() < 0:
            break
    assert best is not None
    return _outcome(_StaySearch(problem, direction, places, accuracy), *best)


def _outcome(search: _StaySearch, candidate: Candidate, bracket: Bracket) -> workflow.Outcome:
    """The bracket, with the claims of its proved end."""
    kind, result = search.problem.require_kind(), _result(search, candidate, bracket)
    if bracket.proved is None:
        verdict = result.not_proved_verdict or "undecided"
        return workflow.Outcome(verdict, kind, (), result.to_dict(), None)
    narrowed, gains = _narrowed(search, candidate, bracket.proved)
    certificates = {"mode_stability": bracket.certificate, "decay_rate": bracket.certificate}
    claims = mode_verification_of(kind).claims(narrowed, gains, certificates)
    is_proved, gap = overall(claim.verdict for claim in claims) == "proved", bracket.relative_gap
    is_tight = bracket.not_proved is None or (gap is not None and gap <= search.accuracy)
    verdict = "proved" if is_proved and is_tight else "undecided"
    return workflow.Outcome(verdict, kind, claims, result.to_dict(), None)


def _result(search: _StaySearch, candidate: Candidate, bracket: Bracket) -> SearchResult:
    """The bracket as an answer about the problem: a cycle refutes only gains that were chosen."""
    witness, verdict = bracket.obstacle.get("witness"), bracket.verdict
    reason = bracket.obstacle.get("reason") or (witness or {}).get("reason")
    these: Entries = {}
    if candidate.searched and verdict == "refuted":
        these, witness, verdict = {"witness": witness}, None, "undecided"
        reason = f"other gains may do; for these, {reason}"
    entries = mode_entries(candidate.document())
    return SearchResult(
        proved=bracket.proved, not_proved=bracket.not_proved, not_proved_verdict=verdict,
        accuracy=search.accuracy, open=bracket.relative_gap, reason=reason, witness=witness,
        these_gains=these, form=candidate.label, ended=bracket.ended,
        gains={entry["name"]: {"L": jsonable(entry["L"])} for entry in entries},
    )  # fmt: skip


def _narrowed(
    search: _StaySearch, candidate: Candidate, x: float
) -> tuple[Problem, NewEntries]:  # fmt: skip
    """The problem with the searched end at x, and the gains with the same stays.

    A shortest stay of 0, which a file does not state, leaves the stated ones.
    """
    problem = search.problem
    body, gains = problem.to_dict(), candidate.document()
    listed = [dict(entry) for entry in mode_entries(gains)]
    for k in search.places:
        low, high = problem.plant.modes[k].every
        ends = [x or low, high] if search.direction == "shortest" else [low, x]
        body["mode"][k]["every"] = jsonable(ends)
        listed[k]["every"] = ends
    return Problem.from_dict(body), {**gains, "modes": listed}
