"""The multiplier observer: that the stored gains are those of the problem.

The bounds need no other hypothesis: they are certified at run time, for any multipliers.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, NewEntries
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.unbounded_inputs import reason_against_unbounded
from obsdesign.document import Claim
from obsdesign.equations.gains import plant_data
from obsdesign.equations.set_membership.gains import SetMembershipGains, plant_entries
from obsdesign.problem.options import SetMembershipOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.consistency import consistent_gains


def claims(
    problem: Problem,
    stored: Entries,
    certificates: EntriesByClaim,
    *,
    paranoid: bool = False,
    budget: TimeBudget = UNLIMITED,
) -> tuple[Claim, ...]:
    """All hypotheses of the design, each with its verdict; stored: gains as a file states them."""
    del certificates, paranoid, budget
    agreement, _ = consistent_gains(
        reason_against_problem(problem), stored, _expected(problem, stored),
        SetMembershipGains.from_document,
    )  # fmt: skip
    return (agreement,)


def reason_against_problem(problem: Problem) -> str | None:
    """Reason for which no bounds can be given for the problem; None if they can."""
    if problem.plant.output.noise_bound is None:
        return "output.noise_bound is required by kind 'set_membership'; it is missing."
    return reason_against_unbounded(problem.plant, "set_membership")


def _expected(problem: Problem, stored: Entries) -> NewEntries:
    options = problem.options_as(SetMembershipOptions)
    expected = plant_data(problem.plant) | plant_entries(problem.plant)
    # a window that the problem leaves open is a choice: every one gives sound bounds
    window = stored.get("window") if options.window is None else options.window
    expected |= {"window": window, "steps": options.steps}
    if options.fixed_lag is not None:
        expected["fixed_lag"] = options.fixed_lag
    if options.directions is not None:
        expected["directions"] = np.array(options.directions)
    if "multipliers" in stored and np.ndim(stored["multipliers"]) == 4:
        expected["multipliers"] = np.shape(stored["multipliers"])
    return expected
