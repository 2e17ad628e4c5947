"""What `check` answers for one kind alone."""

from __future__ import annotations

from lmi.time_budget import TimeBudget
from obsdesign import Problem
from obsdesign.studies.check.which_kinds import KindAnswer, check_kinds


def check_kind(problem: Problem, kind: str, *, seconds: float | None = None) -> KindAnswer:
    """The answer of one kind."""
    budget = TimeBudget.from_seconds(seconds)
    return check_kinds(problem, (kind,), lambda done, total: None, budget)[kind]
