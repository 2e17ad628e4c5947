"""Impulsive observers: window, weight of the past and strategy where they are left open.

Strategies are tried from the strongest hypothesis to the weakest: full (the plant is strongly
observable), compressed (it is after an impulse, in the image of G), subspace (a part of it is, and
the rest decays), quadratic (a matrix inequality). A window that is not given is the shortest one
that can be certified.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lmi.rank.full_rank import BOX_LIMIT
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.equations.impulsive.gains import STRATEGIES
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.impulsive.corrected_part import part_candidates
from obsdesign.synthesis.impulsive.quadratic import quadratic_candidate
from obsdesign.synthesis.impulsive.window import factors_of, window_gains, windowed

# a proof that takes more is put off until the weaker strategies have been tried
_FEW_BOXES = 2000


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield candidates in order of preference; InputError for what cannot be built at all."""
    problem.require_measured("at_jumps")
    problem.require_dwell_time()
    chosen = problem.options.get("strategy", "auto")
    order: tuple[str, ...] = STRATEGIES if chosen == "auto" else (chosen,)
    for name in ("window", "alpha", "noise_target"):
        if name in problem.options and chosen == "quadratic":
            raise InputError(
                f"observer.{name} means nothing to strategy 'quadratic', which has no window; "
                "drop one of the two."
            )
        if name in problem.options:
            order = tuple(strategy for strategy in order if strategy != "quadratic")
    if math.isinf(problem.require_dwell_time()[1]):
        order = order[:1]
    for strategy in order:
        if strategy == "full":
            first = _full(problem, BOX_LIMIT if len(order) == 1 else _FEW_BOXES, budget)
            if chosen == "auto" and _leaves_no_state(problem):  # nothing to tell apart after it
                first = replace(first, searched=True)
            yield first
        if strategy == "compressed":
            yield from _compressed(problem, chosen == "auto", budget)
        if strategy == "subspace":
            yield from part_candidates(problem, chosen == "auto", budget)
        if strategy == "quadratic":
            yield quadratic_candidate(problem, budget)
    if len(order) > 1 and _ran_out_of_boxes(first):  # nothing weaker could be proved
        yield _full(problem, BOX_LIMIT, budget)


def _leaves_no_state(problem: Problem) -> bool:
    assert problem.plant.jump is not None
    return not np.any(problem.plant.jump.G)


def _full(problem: Problem, limit: int, budget: TimeBudget) -> Candidate:
    return windowed(problem, window_gains(problem, "full"), "full", budget, limit=limit)


def _ran_out_of_boxes(candidate: Candidate) -> bool:
    """Whether its proof ended for want of boxes."""
    boxes = candidate.certificates.get("strongly_observable", {}).get("boxes", 0)
    return bool(boxes > _FEW_BOXES // 2)


def _compressed(
    problem: Problem, only_if_singular: bool, budget: TimeBudget
) -> Iterator[Candidate]:
    assert problem.plant.jump is not None
    U, S = factors_of(problem.plant.jump.G)
    if only_if_singular and U.shape[1] == problem.plant.n:
        return  # G is regular: nothing is gained
    gains = window_gains(problem, "compressed", image=U, coimage=S)
    yield windowed(problem, gains, "compressed", budget)


def untried(problem: Problem) -> dict[str, str]:
    """Forms that are passed over, and why: none of this kind."""
    return {}
