"""Which observer kinds can be built for a plant, and why the others cannot."""

from __future__ import annotations

from typing import Any

from lmi.patience import at_most, left
from obsdesign import workflow
from obsdesign.advice import next_step
from obsdesign.errors import InputError
from obsdesign.kinds import KINDS
from obsdesign.problem import Problem

# of processor time: a glance, not a search; more for the kind that the problem is about
_SECONDS, _OWN_SECONDS = 0.2, 1.0


def check_all(problem: Problem) -> tuple[str, dict[str, dict[str, Any]]]:
    """(verdict, kind -> {"verdict", "reasons", "next"}).

    Proved if any kind is, else undecided if any is, else refuted: one observer is enough.
    """
    found = {kind: check_kind(problem, kind) for kind in KINDS}
    verdicts = {entry["verdict"] for entry in found.values()}
    order = ("proved", "undecided", "refuted")
    return next(word for word in order if word in verdicts), found


def check_kind(problem: Problem, kind: str) -> dict[str, Any]:
    """The verdict on one kind, its reasons, one sentence each, and what to try next."""
    impatient = False
    try:
        asked, _ = problem.for_kind(kind)
        for name in ("synthesis", "verification"):  # to load them is no part of the search
            workflow.layer(name, kind)
        with at_most(_OWN_SECONDS if kind == problem.kind else _SECONDS):
            outcome = workflow.investigate(asked)
            impatient = left() < 0
    except InputError as error:
        unknown = "is required by kind" in str(error) and "observer.gains" in str(error)
        verdict, failed, reasons = "undecided" if unknown else "refuted", [], [str(error)]
    else:
        verdict = outcome.verdict
        # what decided comes first
        failed = sorted(
            (c for c in outcome.claims if c.verdict != "proved"),
            key=lambda claim: claim.verdict != verdict,
        )
        reasons = [f"{claim.id}: {workflow.reason(claim)}" for claim in failed]
    first = failed[0].id if failed else None
    if impatient and verdict != "proved":  # other forms were not looked at
        verdict = "undecided"
        step = f"This was a quick look: `obsdesign design PROBLEM --kind {kind}` searches longer."
        return {"verdict": verdict, "reasons": reasons, "next": step}
    step = next_step(kind, verdict, first, reasons[0] if reasons else "")
    return {"verdict": verdict, "reasons": reasons, "next": step}
