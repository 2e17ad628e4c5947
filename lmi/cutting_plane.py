"""One P for a range of theta: solve on a few, look at all, add the worst, repeat.

What comes out is a proposal; `lmi.proof` decides whether it is one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmi.families import Edge, slack, worst
from lmi.semidefinite import common_matrix

Matrix = NDArray[np.float64]

# kappa(P) <= 1e4 keeps the solver well scaled; more is allowed only when that fails
CONDITIONS = (1e4, 1e6)
_ROUNDS = 25
_ADDED = 4


@dataclass(frozen=True)
class Proposal:
    """P and the theta it was made for; P is None when none was found. margin: least slack seen."""

    P: Matrix | None
    thetas: tuple[float, ...]
    margin: float
    worst_theta: float


def propose(F: Matrix, H: Matrix, low: float, high: float, seeds: Sequence[float] = ()) -> Proposal:
    """P with M(theta)' P M(theta) < P on a fine grid of theta, or the theta that forbid it."""
    last = high if math.isfinite(high) else low + horizon(F)
    edge = Edge(F, H, low, last)
    with np.errstate(all="ignore"):
        thetas, maps = edge.grid()
        if not np.isfinite(maps).all():
            return Proposal(None, (), -math.inf, last)
        best = Proposal(None, (), -math.inf, low)
        for kappa in CONDITIONS:
            best = _rounds(edge, thetas, maps, kappa, [low, last, *seeds])
            if best.P is not None:
                return best
    return best


def _rounds(edge: Edge, thetas: Matrix, maps: Matrix, kappa: float, start: list[float]) -> Proposal:
    active = sorted(set(start))
    worst_theta, margin = active[0], -math.inf
    for _ in range(_ROUNDS):
        solution = common_matrix(edge.maps(np.array(active)), kappa)
        if solution is None or solution.margin <= 1e-9:
            return Proposal(None, tuple(active), margin, worst_theta)
        try:
            slacks = slack(solution.P, maps)
        except np.linalg.LinAlgError:
            return Proposal(None, tuple(active), margin, worst_theta)
        k = int(np.argmin(slacks))
        worst_theta, margin = float(thetas[k]), float(slacks[k])
        if margin > 0:
            return Proposal(solution.P, tuple(active), margin, worst_theta)
        more = [float(thetas[j]) for j in worst(thetas, slacks, 0.0)[:_ADDED]]
        more = [theta for theta in more if theta not in active]
        if not more:
            return Proposal(None, tuple(active), margin, worst_theta)
        active = sorted({*active, *more})
    return Proposal(None, tuple(active), margin, worst_theta)


def horizon(F: Matrix) -> float:
    """Where to end the search when there is no longest dwell time: some slow time constants."""
    abscissa = float(np.linalg.eigvals(F).real.max())
    return 8.0 / -abscissa if abscissa < 0 else 1.0
