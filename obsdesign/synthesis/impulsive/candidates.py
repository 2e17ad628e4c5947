"""Impulsive observers: window, weight of the past and strategy where they are left open.

Strategies are tried from the strongest hypothesis to the weakest: full (the plant is strongly
observable), compressed (it is after an impulse, in the image of G), subspace (a part of it is, and
the rest decays), quadratic (a matrix inequality). A window that is not given is the shortest one
that can be certified.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from lmi.rank.full_rank import BOX_LIMIT
from obsdesign.equations.impulsive import gains as equations
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.impulsive.corrected_part import part_candidates
from obsdesign.synthesis.impulsive.quadratic import quadratic_candidate
from obsdesign.synthesis.impulsive.window import base, image_of, windowed

# a proof that takes more is put off until the weaker strategies have been tried
_FEW_BOXES = 2000


def synthesize(problem: Problem) -> Iterator[Candidate]:
    """Candidates in order of preference; InputError for what cannot be built at all."""
    problem.require_measured("at_jumps")
    problem.require_dwell_time()
    asked = problem.options.get("strategy", "auto")
    order: tuple[str, ...] = equations.STRATEGIES if asked == "auto" else (asked,)
    for name in ("window", "alpha", "noise_target"):
        if name in problem.options and asked == "quadratic":
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
            first = _full(problem, BOX_LIMIT if len(order) == 1 else _FEW_BOXES)
            yield first
        if strategy == "compressed":
            yield from _compressed(problem, asked == "auto")
        if strategy == "subspace":
            yield from part_candidates(problem, base(problem, "subspace"), asked == "auto")
        if strategy == "quadratic":
            yield quadratic_candidate(problem)
    if len(order) > 1 and _tired(first):  # nothing weaker could be proved
        yield _full(problem, BOX_LIMIT)


def _full(problem: Problem, limit: int) -> Candidate:
    return windowed(problem, base(problem, "full"), "full", limit=limit)


def _tired(candidate: Candidate) -> bool:
    """Did its proof end for want of boxes?"""
    boxes = candidate.certificates.get("strongly_observable", {}).get("boxes", 0)
    return bool(boxes > _FEW_BOXES // 2)


def _compressed(problem: Problem, only_if_singular: bool) -> Iterator[Candidate]:
    assert problem.plant.jump is not None
    U, S = image_of(problem.plant.jump.G)
    if only_if_singular and U.shape[1] == problem.plant.n:
        return  # the image is all there is: nothing is gained
    yield windowed(problem, base(problem, "compressed") | {"image": U, "coimage": S}, "compressed")
