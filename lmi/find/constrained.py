"""A common P under further convex constraints (regions, norms), through CVXPY.

    minimise f(P)   subject to   (1 - slack) P - M(theta)' P M(theta) >= 0   for all theta,
                                 P >= floor I,   constraints(P)

The same cutting planes as in `lmi.find.cutting_plane`, with a modelling layer that takes anything
convex and is some hundred times slower. What comes out is a proposal; `lmi.prove.common_matrix`
decides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.balls import exact, to_float
from lmi.families import Edge, slack, worst

Matrix = NDArray[np.float64]
Constraints = Callable[[Any], Sequence[Any]]  # cvxpy P -> cvxpy constraints
Objective = Callable[[Any], Any]  # cvxpy P -> convex cvxpy expression

_ROUNDS = 20
_ADDED = 4


def propose_constrained(
    F: ArrayLike,
    H: ArrayLike,
    low: float,
    high: float,
    constraints: Constraints = lambda P: (),
    objective: Objective | None = None,
    *,
    slack_wanted: float = 1e-4,
    floor: float = 1.0,
) -> Matrix | None:
    """P (n, n) with M(theta)' P M(theta) < P on a fine grid of [low, high], or None.

    F, H: (n, n) floats or exact rationals. slack_wanted: relative, in (0, 1). floor: P >= floor I
    fixes the scale; constraints with a scale of their own want a small one. None says nothing:
    the solver found no P, or gave up. ValueError unless 0 <= low <= high.
    """
    if not 0 <= low <= high:
        raise ValueError(f"0 <= low <= high is required; got [{low}, {high}]")
    if not 0 < slack_wanted < 1:
        raise ValueError(f"slack_wanted must lie between 0 and 1; got {slack_wanted!r}")
    edge = Edge(to_float(exact(F)), to_float(exact(H)), low, high)
    with np.errstate(all="ignore"):
        thetas, maps = edge.grid()
        if not np.isfinite(maps).all():
            return None
        active = [0, len(thetas) - 1]
        for _ in range(_ROUNDS):
            P = _solved(maps[sorted(set(active))], constraints, objective, slack_wanted, floor)
            if P is None:
                return None
            slacks = slack(P, maps)
            # the optimum sits on the constraint: half of the slack is left to the solver's digits
            more = [k for k in worst(slacks, slack_wanted / 2) if k not in active]
            if not more:
                return P if slacks.min() > 0 else None
            active += more[:_ADDED]
    return None


def _solved(
    maps: Matrix,
    constraints: Constraints,
    objective: Objective | None,
    slack_wanted: float,
    floor: float,
) -> Matrix | None:
    import cvxpy as cp  # slow to import, and rarely needed

    n = maps.shape[-1]
    P = cp.Variable((n, n), symmetric=True)
    holds = [P >> floor * np.eye(n), *constraints(P)]
    for M in maps:
        gap = (1 - slack_wanted) * P - M.T @ P @ M
        holds.append((gap + gap.T) / 2 >> 0)
    goal = cp.Minimize(0 if objective is None else objective(P))
    try:
        cp.Problem(goal, holds).solve(solver=cp.CLARABEL)
    except cp.error.SolverError:
        return None
    if P.value is None or not np.isfinite(P.value).all():
        return None
    found: Matrix = (P.value + P.value.T) / 2
    return found if np.linalg.eigvalsh(found)[0] > 0 else None
