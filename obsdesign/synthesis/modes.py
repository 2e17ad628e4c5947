"""Synthesis for plants with modes: what the kinds share."""

from __future__ import annotations

from lmi.arithmetic.arrays import Entries
from lmi.decide.mode_stability import decide_modes
from lmi.modes import Modes
from lmi.time_budget import TimeBudget
from obsdesign.analysis.modes import reason_against_modes
from obsdesign.errors import DoesNotApply
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Certificates


def require_served(problem: Problem) -> None:
    """DoesNotApply where the kind has no observer of modes for the problem."""
    if reason := reason_against_modes(problem):
        raise DoesNotApply(reason)


def stability_certificates(name: str, modes: Modes, budget: TimeBudget) -> Certificates:
    """What may prove or refute the claim `name`, that errors tend to zero along all paths."""
    verdict = decide_modes(modes, budget=budget)
    evidence: Entries = verdict.evidence
    return Certificates({name: evidence}, verdict.solvers)
