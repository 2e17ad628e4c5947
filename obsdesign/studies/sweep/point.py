"""One point of a sweep: a problem with other numbers, and what `search` or `design` says of it."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lmi.memory import OversizeError
from lmi.time_budget import ended_part
from obsdesign import workflow
from obsdesign.document import jsonable
from obsdesign.errors import InputError
from obsdesign.problem.kinds import KINDS, SEARCHES
from obsdesign.problem.problem import Problem
from obsdesign.studies.search import dwell_time as searching
from obsdesign.studies.sweep.axes import Axis, changed, require_number
from obsdesign.verification.answers import is_ended, more_time, reason

# quality of a design -> where its proved number stands: (claim, entry of its evidence) by kind
QUALITIES: Mapping[str, Mapping[str, tuple[tuple[str, str], ...]]] = {
    "verdict": dict.fromkeys(KINDS, ()),
    "width": {"interval": (("width", "always"), ("sampled_stability", "always"))},
    "decay_rate": {
        "interval": (("rates", "in_time"),),
        "luenberger": (("rates", "in_time"),),
        "impulsive": (("rate", "in_time"),),
    },
    "error": {"finite_time": (("error_radius", "largest_error"),)},
}
MOST_POINTS = 1_000_000
_WIDER = "the bracket is wider than asked"
# the precision of ball arithmetic belongs to the process: threads of one worker take turns
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True)
class Plan:
    """A problem (normalised, as a dict), one or two axes, and what is asked at every point.

    seconds: of processor time that the searches of one point may take; None for their own budgets.
    """

    body: Mapping[str, Any]
    axes: tuple[Axis, ...]
    what: str
    accuracy: float
    seconds: float | None = None

    def __len__(self) -> int:
        return math.prod(axis.count for axis in self.axes)

    def at(self, index: int) -> list[float]:
        """Values of the axes at a point; the last axis changes fastest."""
        values: list[float] = []
        for axis in reversed(self.axes):
            index, i = divmod(index, axis.count)
            values.insert(0, axis.value(i))
        return values

    def problem(self, index: int) -> Problem:
        """The problem of a point; InputError when it cannot be read with these numbers."""
        body: Any = self.body
        for axis, value in zip(self.axes, self.at(index), strict=True):
            body = changed(body, axis.path, value)
        return Problem.from_dict(body)


def plan_sweep(
    problem: Problem, axes: Sequence[Axis], what: str, accuracy: float, seconds: float | None = None
) -> Plan:
    """A sweep that makes sense, or InputError: what is asked, how many axes, entries that exist."""
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


def evaluate(plan: Plan, index: int) -> dict[str, Any]:
    """The line of one point, JSON-ready; what goes wrong there is one line of text in it."""
    row = {"point": index, "at": plan.at(index)}
    with _ONE_AT_A_TIME:
        try:
            problem = plan.problem(index)
            if plan.what in SEARCHES:
                found = searching.search(problem, plan.what, plan.accuracy, seconds=plan.seconds)
                told = _searched(found)
            else:
                found = workflow.investigate(problem, seconds=plan.seconds)
                told = _designed(found, plan.what)
            result: dict[str, Any] = row | jsonable(told)
        except (InputError, OversizeError) as error:
            return row | {"error": str(error)}
        except Exception as error:  # whatever it is, the other points are worth having
            return row | {"error": " ".join(f"{type(error).__name__}: {error}".split())}
    return result


def _searched(outcome: workflow.Outcome) -> dict[str, Any]:
    result = outcome.result
    told = {"verdict": outcome.verdict, "value": result["proved"]}
    told |= {name: result[name] for name in ("not_proved", "not_proved_verdict")}
    return told if outcome.verdict == "proved" else told | _why(outcome)


def _designed(outcome: workflow.Outcome, what: str) -> dict[str, Any]:
    told: dict[str, Any] = {"verdict": outcome.verdict, "value": None}
    if outcome.verdict != "proved":
        return told | _why(outcome)
    places = QUALITIES[what][outcome.kind]
    numbers = [
        claim.evidence[entry]
        for name, entry in places
        for claim in outcome.claims
        if claim.id == name and claim.verdict == "proved" and entry in claim.evidence
    ]
    if numbers:  # of a number per state the largest
        told["value"] = max(numbers[0]) if isinstance(numbers[0], list | tuple) else numbers[0]
    elif places:
        told["reason"] = f"the design is proved, no number for its {what.replace('_', ' ')} is"
    return told


def _why(outcome: workflow.Outcome) -> dict[str, Any]:
    """{"reason"}: the first claim that is not proved, or what a search says of its open side.

    With the evidence of a budget that ended it.
    """
    open_claims = [claim for claim in outcome.claims if claim.verdict != "proved"]
    if open_claims:
        first = min(open_claims, key=lambda claim: claim.verdict != outcome.verdict)
        text, evidence = f"{first.id}: {reason(first)}", first.evidence
        return {"reason": text} | (ended_part(evidence) if is_ended(first) else {})
    text, end = str(outcome.result.get("reason") or _WIDER), ended_part(outcome.result)
    return {"reason": f"{text}; {more_time(end)}" if end else text} | end
