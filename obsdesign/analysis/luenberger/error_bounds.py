"""Ultimate bounds of the error of a point observer, in balls.

Without jumps that of |e_i| is sum_k int_0^inf |(e^(Fs) E)_ik| ds, which some disturbance attains
if x, inputs and noise in their boxes act independently. With jumps,
the smaller, entry by entry, of a tube of |e|' <= Mz(F) |e| + |E| 1, |e+| <= |H| |e| + |K| 1, in
which signs are lost, and of what a norm that contracts from jump to jump gives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Exact, exact
from lmi.bounds.absolute_integral import absolute_integrals
from lmi.bounds.driven_jumps import DrivenJumps, Radius, driven_bounds, radius_before_jumps
from lmi.bounds.tube import Tube, prove_tube
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.luenberger.driven_error import DrivenError


@dataclass(frozen=True)
class ErrorBounds:
    """Of |e|: always (n,), before_jump (n,) just before jumps; exact."""

    always: Exact
    before_jump: Exact | None = None


@dataclass(frozen=True)
class Contraction:
    """|T e^(F theta) H x| <= per_jump |T x| for all dwell times theta; T (n, n). To be proved."""

    T: Matrix
    per_jump: float


def bounds_without_jumps(error: DrivenError) -> ErrorBounds | None:
    """Bounds of the error of a plant without jumps; None where F is not proved to decay."""
    integrals = absolute_integrals(error.F, error.E)
    if integrals is None:
        return None
    # a sum over no columns, where nothing drives the error, is the integer 0
    return ErrorBounds(exact(np.zeros(len(integrals))) + exact(integrals).sum(axis=1))


def bounds_with_jumps(
    error: DrivenError, ends: tuple[float, float], tube: Tube | None, around: Radius | None
) -> ErrorBounds | None:
    """What a tube of |e| and a contraction leave, both proved, each None where there is none.

    ends: the shortest and the longest dwell time, which may be infinite. None where that is no
    bound.
    """
    before = None if tube is None else tube.before
    bounds = driven_bounds(_system(error, ends), before, around)
    if bounds is None:
        return None if tube is None else ErrorBounds(tube.always, tube.before)
    before_jump, always = map(exact, bounds)
    return ErrorBounds(always if tube is None else np.minimum(always, tube.always), before_jump)


def is_tube(error: DrivenError, ends: tuple[float, float], tube: Tube) -> bool:
    """Is a tube of |e| proved for all dwell times?"""
    unit = exact(np.eye(len(error.F)))
    low, high = ends
    verdict = prove_tube(*comparison_system(error), unit, tube=tube, low=low, high=high)
    return verdict.outcome == "proved"


def contraction_radius(
    error: DrivenError,
    ends: tuple[float, float],
    contraction: Contraction,
    budget: TimeBudget = UNLIMITED,
) -> Radius | None:
    """Ultimate bound of |T e| just before jumps; None where no contraction is proved in time."""
    return radius_before_jumps(_system(error, ends), contraction.T, contraction.per_jump, budget)


def comparison_system(error: DrivenError) -> tuple[Exact, Exact, Exact, Exact]:
    """(W, f, N, h) with |e|' <= W |e| + f, |e+| <= N |e| + h, exact; with jumps."""
    assert error.H is not None
    assert error.K is not None
    W = abs(error.F)
    np.fill_diagonal(W, np.diag(error.F))
    return W, _sums(error.E), abs(error.H), _sums(error.K)


def _system(error: DrivenError, ends: tuple[float, float]) -> DrivenJumps:
    assert error.H is not None
    assert error.K is not None
    return DrivenJumps(error.F, error.E, error.H, error.K, *ends)


def _sums(columns: Exact) -> Exact:
    zero = exact(np.zeros((len(columns), 1)))
    result: Exact = abs(np.hstack([zero, columns])).sum(axis=1)
    return result
