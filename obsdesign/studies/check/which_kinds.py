"""Which observer kinds can be built for a plant, and why the others cannot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from lmi.time_budget import ended_part, total_budget
from obsdesign import workflow
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.kinds import KINDS
from obsdesign.problem.problem import Problem
from obsdesign.studies.check.advice import next_step
from obsdesign.verification.answers import is_ended, reason, verdict_of_refusal

Entry = dict[str, Any]


def check_all(
    problem: Problem,
    *,
    seconds: float | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[str, dict[str, Entry]]:
    """(verdict, kind -> {"verdict", "reasons", "next"}, and where a budget ended it "ended_by").

    The verdict on a kind is proved, refuted, undecided, or does_not_apply where the problem has not
    what the kind needs: that of `workflow.investigate`. In all: proved if any kind is, else
    undecided if any is, else refuted: one observer is enough. seconds: of processor time that
    searches may take in all. progress: called with the kinds that are settled, and all.
    """
    with total_budget(seconds):
        outcomes = _checked(problem, KINDS, progress)
    verdicts = {entry["verdict"] for entry in outcomes.values()}
    order = ("proved", "undecided")
    return next((word for word in order if word in verdicts), "refuted"), outcomes


def check_kind(problem: Problem, kind: str, *, seconds: float | None = None) -> Entry:
    """The verdict on one kind, its reasons, one sentence each, and what to try next."""
    with total_budget(seconds):
        return _checked(problem, (kind,), lambda done, total: None)[kind]


def _checked(
    problem: Problem, kinds: tuple[str, ...], progress: Callable[[int, int], None]
) -> dict[str, Entry]:
    """Every kind as for a design, which the first proved candidate settles."""
    problems: dict[str, Problem] = {}
    outcomes: dict[str, workflow.Outcome | InputError] = {}
    for kind in kinds:
        for name in ("synthesis", "verification"):  # to load them is no part of the search
            workflow.layer(name, kind)
        try:
            problems[kind] = problem.for_kind(kind)[0]
        except InputError as error:
            outcomes[kind] = error
    settled = len(outcomes)

    def settle(kind: str) -> None:
        nonlocal settled
        settled += 1
        progress(settled, len(kinds))

    outcomes |= workflow.investigate_each(problems, first=True, done=settle)
    return {kind: _entry(kind, outcomes[kind]) for kind in kinds}


def _entry(kind: str, outcome: workflow.Outcome | InputError) -> Entry:
    if isinstance(outcome, InputError):
        verdict = verdict_of_refusal(outcome)
        missing = outcome.entry if isinstance(outcome, DoesNotApply) else ""
        return _plain_entry(verdict, [str(outcome)], next_step(kind, verdict, missing=missing))
    # what decided comes first
    failed = sorted(
        (claim for claim in outcome.claims if claim.verdict != "proved"),
        key=lambda claim: claim.verdict != outcome.verdict,
    )
    reasons = [f"{claim.id}: {reason(claim)}" for claim in failed]
    step = next_step(kind, outcome.verdict, claim=failed[0].id if failed else "")
    end: Mapping[str, Any] = {}
    if outcome.verdict == "undecided":
        end = next((ended_part(claim.evidence) for claim in failed if is_ended(claim)), {})
    return _plain_entry(outcome.verdict, reasons, step) | dict(end)


def _plain_entry(verdict: str, reasons: list[str], step: str) -> Entry:
    return {"verdict": verdict, "reasons": reasons, "next": step}
