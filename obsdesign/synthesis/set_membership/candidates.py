"""The multiplier observer of a problem: nothing is searched but the length of its window."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.unbounded_inputs import reason_against_unbounded
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.errors import DoesNotApply
from obsdesign.problem.options import SetMembershipOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate

# stages by number of states: a window that is exact to a few percent on random plants
_WINDOWS = ((2, 8), (4, 16))
_LONGEST_DEFAULT = 30


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield the observer of the problem; DoesNotApply where its bounds need what is missing."""
    del budget
    if reason := reason_against_unbounded(problem.plant, "set_membership"):
        raise DoesNotApply(reason)
    problem.require_noise_bound("kind 'set_membership'")
    options = problem.options_as(SetMembershipOptions)
    window = options.window or max(
        default_window(problem.plant.n), 2 * (options.fixed_lag or 0)
    )  # fmt: skip
    gains = SetMembershipGains.from_plant(
        problem.plant, window=window, steps=options.steps, fixed_lag=options.fixed_lag,
        directions=None if options.directions is None else np.array(options.directions),
    )  # fmt: skip
    yield Candidate(f"window of {window} stages", gains)


def default_window(n: int) -> int:
    """Stages of a window for n states."""
    return next((stages for most, stages in _WINDOWS if n <= most), _LONGEST_DEFAULT)
