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

from lmi.rank.full_rank import BOX_LIMIT
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.equations.impulsive.gains import STRATEGIES
from obsdesign.errors import InputError
from obsdesign.problem.options import ImpulsiveOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.impulsive.corrected_part import WINDOWED, part_candidates
from obsdesign.synthesis.impulsive.quadratic import quadratic_candidate
from obsdesign.synthesis.impulsive.window import factors_of, window_gains, windowed

# a proof that takes more is put off until the weaker strategies have been tried
_FEW_BOXES = 2000


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield candidates in order of preference; InputError for what cannot be built at all."""
    problem.require_measured("at_jumps")
    options, high = problem.options_as(ImpulsiveOptions), problem.require_dwell_time()[1]
    is_open = options.strategy == "auto"
    order: tuple[str, ...] = STRATEGIES if is_open else (options.strategy,)
    for name in WINDOWED:
        if options.is_stated(name) and options.strategy == "quadratic":
            raise InputError(
                f"observer.{name} means nothing to strategy 'quadratic', which has no window; "
                "drop one of the two."
            )
        if options.is_stated(name):
            order = tuple(strategy for strategy in order if strategy != "quadratic")
    if math.isinf(high):  # a claim refutes it, whatever the gains are
        order = order[:1]
    assert problem.plant.jump is not None
    G = problem.plant.jump.G
    for strategy in order:
        if strategy == "full":
            first = _full(problem, BOX_LIMIT if len(order) == 1 else _FEW_BOXES, budget)
            if is_open and not G.any():
                # G = 0 leaves nothing to estimate: a full window that misses it refutes no observer
                first = replace(first, searched=True)
            yield first
        if strategy == "compressed":
            U, S = factors_of(G)
            if not is_open or U.shape[1] < len(G):  # with a regular G nothing is gained
                gains = window_gains(problem, "compressed", image=U, coimage=S)
                yield windowed(problem, gains, "compressed", budget)
        if strategy == "subspace":
            yield from part_candidates(problem, is_open, budget)
        if strategy == "quadratic":
            yield quadratic_candidate(problem, budget)
    if len(order) > 1 and _ran_out_of_boxes(first):  # nothing weaker could be proved
        yield _full(problem, BOX_LIMIT, budget)


def _full(problem: Problem, limit: int, budget: TimeBudget) -> Candidate:
    return windowed(problem, window_gains(problem, "full"), "full", budget, limit=limit)


def _ran_out_of_boxes(candidate: Candidate) -> bool:
    """Whether its proof ended for want of boxes."""
    boxes = candidate.certificates.get("strongly_observable", {}).get("boxes", 0)
    return bool(boxes > _FEW_BOXES // 2)
