"""Verdicts on all observer kinds for a plant, with reasons."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from lmi.arithmetic.arrays import Entries, NewEntries
from lmi.time_budget import TimeBudget, ended_part
from obsdesign import workflow
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.kinds import KINDS
from obsdesign.problem.problem import Problem
from obsdesign.studies.check.advice import next_step, theorem_sentences
from obsdesign.synthesis.kind import synthesis_of
from obsdesign.verification.answers import is_ended, reason, verdict_of_refusal
from obsdesign.verification.kind import verification_of


@dataclass(frozen=True)
class KindAnswer:
    """The verdict on one kind, its reasons, one sentence each, and what to try next.

    verdict: proved, refuted, undecided, or does_not_apply where the problem lacks an entry that the
    kind needs. ended: the budget that ended its search, as `TimeBudget.ended` has it.
    """

    verdict: str
    reasons: tuple[str, ...]
    next_step: str
    ended: Entries = field(default_factory=dict)

    def to_dict(self) -> NewEntries:
        """Its entry in the answer of `check --json`."""
        body = {"verdict": self.verdict, "reasons": list(self.reasons), "next": self.next_step}
        return body | dict(self.ended)


def check_all(
    problem: Problem,
    *,
    seconds: float | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[str, dict[str, KindAnswer]]:
    """The verdict on the plant, and the answer of each kind.

    The verdict on a kind is that of `workflow.investigate`. In all: proved if any kind is, else
    undecided if any is, else refuted: one observer is enough. seconds: of processor time that
    searches may take in all. progress: called with the kinds that are settled, and all.
    """
    answers = check_kinds(problem, KINDS, progress, TimeBudget.from_seconds(seconds))
    verdicts = {answer.verdict for answer in answers.values()}
    order = ("proved", "undecided")
    return next((word for word in order if word in verdicts), "refuted"), answers


def check_kinds(
    problem: Problem,
    kinds: tuple[str, ...],
    progress: Callable[[int, int], None],
    budget: TimeBudget,
) -> dict[str, KindAnswer]:
    """Investigate every kind as for a design; the first proved candidate settles it."""
    problems: dict[str, Problem] = {}
    outcomes: dict[str, workflow.Outcome | InputError] = {}
    for kind in kinds:
        synthesis_of(kind)  # to load modules is no part of the search
        verification_of(kind)
        try:
            problems[kind] = problem.for_kind(kind)[0]
        except InputError as error:
            outcomes[kind] = error
    settled = len(outcomes)

    def settle(kind: str) -> None:
        nonlocal settled
        settled += 1
        progress(settled, len(kinds))

    outcomes |= workflow.investigate_each(problems, budget, first=True, done=settle)
    return {kind: _answer(kind, outcomes[kind]) for kind in kinds}


def _answer(kind: str, outcome: workflow.Outcome | InputError) -> KindAnswer:
    if isinstance(outcome, InputError):
        verdict = verdict_of_refusal(outcome)
        missing = outcome.entry if isinstance(outcome, DoesNotApply) else ""
        step = next_step(kind, verdict, missing=missing)
        return KindAnswer(verdict, (str(outcome),), step)
    # claims that decided the verdict come first
    failed = sorted(
        (claim for claim in outcome.claims if claim.verdict != "proved"),
        key=lambda claim: claim.verdict != outcome.verdict,
    )
    reasons = tuple(f"{claim.id}: {reason(claim)}" for claim in failed)
    step = next_step(kind, outcome.verdict, claim=failed[0].id if failed else "")
    step = ". ".join([step, *theorem_sentences(outcome.claims)])
    end: Entries = {}
    if outcome.verdict == "undecided":
        end = next((ended_part(claim.evidence) for claim in failed if is_ended(claim)), {})
    return KindAnswer(outcome.verdict, reasons, step, end)
