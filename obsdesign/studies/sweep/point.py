"""One point of a sweep: a changed problem, and the answer of `search` or `design`."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from lmi.memory import OversizeError
from lmi.time_budget import ended_part
from obsdesign import workflow
from obsdesign.document import jsonable
from obsdesign.errors import InputError
from obsdesign.kinds import KINDS, SEARCHES
from obsdesign.problem.problem import Problem
from obsdesign.studies.search import search as searching
from obsdesign.studies.search.result import SearchResult
from obsdesign.studies.sweep.axes import Axis, changed, require_number
from obsdesign.verification.answers import is_ended, more_time, reason

# quality of a design -> where its proved number stands: (claim, entry of its evidence) by kind
QUALITIES: Mapping[str, Mapping[str, tuple[tuple[str, str], ...]]] = {
    "verdict": dict.fromkeys(KINDS, ()),
    "width": {
        "interval": (
            ("width", "always"),
            ("sampled_stability", "always"),
            ("event_width", "always"),
        )
    },
    "decay_rate": {
        "interval": (("rates", "in_time"),),
        "luenberger": (("rates", "in_time"),),
        "impulsive": (("rate", "in_time"),),
    },
    "error": {"finite_time": (("error_radius", "largest_error"),)},
}
MOST_POINTS = 1_000_000
_WIDER = "the bracket is wider than asked"
_ENDED = ("ended_by", "seconds", "limit")
# the precision of ball arithmetic belongs to the process: threads of one worker take turns
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True, kw_only=True)
class PointAnswer:
    """The answer at a point: a verdict, and the proved number where there is one.

    value: JSON-ready, "inf" where there is no limit; limit: the nearest end that is not proved and
    its verdict, of a search; reason: why the verdict is not proved, or why no number is;
    ended: the budget that ended the search, as `TimeBudget.ended` has it.
    """

    verdict: str
    value: Value = None
    limit: tuple[Value, str | None] | None = None
    reason: str = ""
    ended: Entries = field(default_factory=dict)

    def to_dict(self) -> NewEntries:
        """Its entries in the line of its point."""
        body = {"verdict": self.verdict, "value": self.value}
        if self.limit is not None:
            body |= {"not_proved": self.limit[0], "not_proved_verdict": self.limit[1]}
        if self.reason:
            body["reason"] = self.reason
        return body | dict(self.ended)


@dataclass(frozen=True)
class SweepPoint:
    """A point: its number, the values of the axes, and the answer or an error."""

    index: int
    at: tuple[float, ...]
    answer: PointAnswer | None = None
    error: str = ""

    @property
    def verdict(self) -> str:
        """The verdict of its answer, or "error"."""
        return "error" if self.answer is None else self.answer.verdict

    @property
    def value(self) -> Value:
        """The proved number, "inf" where there is no limit; None where none is proved."""
        return None if self.answer is None else self.answer.value

    def to_dict(self) -> NewEntries:
        """The line of the point, JSON-ready, without its digest."""
        body: NewEntries = {"point": self.index, "at": list(self.at)}
        if self.answer is None:
            return body | {"error": self.error}
        return body | self.answer.to_dict()

    @staticmethod
    def from_dict(row: Entries) -> SweepPoint:
        """The point of a line that `to_dict` wrote."""
        index, at = int(row["point"]), tuple(row["at"])
        if "verdict" not in row:
            return SweepPoint(index, at, None, str(row.get("error", "")))
        limit = (row["not_proved"], row.get("not_proved_verdict")) if "not_proved" in row else None
        answer = PointAnswer(
            verdict=str(row["verdict"]),
            value=row.get("value"),
            limit=limit,
            reason=str(row.get("reason", "")),
            ended={name: row[name] for name in _ENDED if name in row},
        )
        return SweepPoint(index, at, answer)


@dataclass(frozen=True)
class Plan:
    """A problem (normalised, as a dict), one or two axes, and the question at every point.

    seconds: of processor time that the searches of one point may take; None for their own budgets.
    """

    body: Entries
    axes: tuple[Axis, ...]
    what: str
    accuracy: float
    seconds: float | None = None

    def __len__(self) -> int:
        return math.prod(axis.count for axis in self.axes)

    def values_of(self, index: int) -> tuple[float, ...]:
        """Values of the axes at a point; the last axis changes fastest."""
        values: list[float] = []
        for axis in reversed(self.axes):
            index, i = divmod(index, axis.count)
            values.insert(0, axis.value(i))
        return tuple(values)

    def problem(self, index: int) -> Problem:
        """The problem of a point; InputError when it cannot be read with these numbers."""
        body: Value = self.body
        for axis, value in zip(self.axes, self.values_of(index), strict=True):
            body = changed(body, axis.path, value)
        return Problem.from_dict(body)


def plan_sweep(
    problem: Problem, axes: Sequence[Axis], what: str, accuracy: float, seconds: float | None = None
) -> Plan:
    """A sweep, or InputError for its question, its number of axes, or entries that do not exist."""
    kind = problem.require_kind()
    searching.require_accuracy(accuracy)
    known = (*SEARCHES, *QUALITIES)
    if what not in known:
        raise InputError(f"--for must be one of {', '.join(known)}; got {what!r}.")
    if what in SEARCHES:
        searching.require_search(problem, what, accuracy)
    elif kind not in QUALITIES[what]:
        kinds = " and ".join(map(repr, QUALITIES[what]))
        raise InputError(f"--for {what} is a number of kind {kinds}; this problem is of {kind!r}.")
    if not 1 <= len(axes) <= 2:
        raise InputError(f"--over must be given once or twice; got {len(axes)} of them.")
    body = problem.to_dict()
    for axis in axes:
        require_number(body, axis)
    if len({axis.path for axis in axes}) < len(axes):
        raise InputError(f"--over: {axes[0].key} is given twice; a map needs two entries.")
    plan = Plan(body, tuple(axes), what, accuracy, seconds)
    if len(plan) > MOST_POINTS:
        raise InputError(f"--over: at most {MOST_POINTS} points are possible; got {len(plan)}.")
    return plan


def evaluate(plan: Plan, index: int) -> SweepPoint:
    """One point; an error there is one line of text in it."""
    at = plan.values_of(index)
    with _ONE_AT_A_TIME:
        try:
            problem = plan.problem(index)
            if plan.what in SEARCHES:
                outcome = searching.search(problem, plan.what, plan.accuracy, seconds=plan.seconds)
                answer = _search_answer(outcome)
            else:
                outcome = workflow.investigate(problem, seconds=plan.seconds)
                answer = _design_answer(outcome, plan.what)
        except (InputError, OversizeError) as error:
            return SweepPoint(index, at, error=str(error))
        except Exception as error:  # whatever it is, the other points are worth having
            text = " ".join(f"{type(error).__name__}: {error}".split())
            return SweepPoint(index, at, error=text)
    return SweepPoint(index, at, answer)


def _search_answer(outcome: workflow.Outcome) -> PointAnswer:
    result = SearchResult.from_dict(outcome.result)
    answer = PointAnswer(
        verdict=outcome.verdict,
        value=jsonable(result.proved),
        limit=(jsonable(result.not_proved), result.not_proved_verdict),
    )
    return answer if outcome.verdict == "proved" else _with_reason(answer, outcome)


def _design_answer(outcome: workflow.Outcome, what: str) -> PointAnswer:
    answer = PointAnswer(verdict=outcome.verdict)
    if outcome.verdict != "proved":
        return _with_reason(answer, outcome)
    places = QUALITIES[what][outcome.kind]
    numbers = [
        claim.evidence[entry]
        for name, entry in places
        for claim in outcome.claims
        if claim.id == name and claim.verdict == "proved" and entry in claim.evidence
    ]
    if numbers:  # of a number per state the largest
        value = max(numbers[0]) if isinstance(numbers[0], list | tuple) else numbers[0]
        return replace(answer, value=jsonable(value))
    if places:
        text = f"the design is proved, no number for its {what.replace('_', ' ')} is"
        return replace(answer, reason=text)
    return answer


def _with_reason(answer: PointAnswer, outcome: workflow.Outcome) -> PointAnswer:
    """The answer with the first claim that is not proved, or the reason of a wide bracket.

    With the evidence of a budget that ended it.
    """
    open_claims = [claim for claim in outcome.claims if claim.verdict != "proved"]
    if open_claims:
        first = min(open_claims, key=lambda claim: claim.verdict != outcome.verdict)
        text, evidence = f"{first.id}: {reason(first)}", first.evidence
        end = ended_part(evidence) if is_ended(first) else {}
        return replace(answer, reason=text, ended=jsonable(end))
    result = SearchResult.from_dict(outcome.result)
    text = result.reason or _WIDER
    if result.ended:
        text = f"{text}; {more_time(result.ended)}"
    return replace(answer, reason=text, ended=jsonable(result.ended))
