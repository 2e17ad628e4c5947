"""Constraints on the gains in the linear programs of interval observers, through CVXPY.

With X = diag(p) > 0 and U = X K in coordinates x = S z, P = S^-T X S^-1 and P K_x = S^-T U are
linear in (p, U), K_x = S K the gain in the plant's coordinates: what `synthesis.convex_gain` states
of (P, P K) is convex here too. In the plant's own coordinates a structure costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lmi.arithmetic.arrays import Array, Indices, Matrix
from lmi.find.constrained import Expression, constrained_minimum
from lmi.find.linear_program import minimise
from lmi.time_budget import TimeBudget
from obsdesign.synthesis.convex_gain import ConvexGain, refused_constraints

_ITERATIONS = 20_000  # of the simplex method
_INTERIOR = 1e-8  # share of the largest value that an interior point cannot tell from zero


def program_minimum(
    cost: Matrix,
    rows: tuple[Indices, Indices, Matrix],
    sides: tuple[Matrix, Matrix],
    bounds: tuple[Matrix, Matrix],
    *,
    constraints: Callable[[Expression], Sequence[Expression]] | None,
    budget: TimeBudget,
) -> Matrix | None:
    """As `linear_program.minimise`, by HiGHS; with constraints of the unknowns through CVXPY.

    None when none is found; InputError for a user's constraints that are not convex.
    """
    if constraints is None:
        return minimise(
            cost, rows, sides, bounds, seconds=budget.remaining(),
            iterations=budget.scaled(_ITERATIONS),
        )  # fmt: skip
    with refused_constraints():
        x = constrained_minimum(cost, rows, sides, bounds, constraints)
    return None if x is None else np.where(np.abs(x) < _INTERIOR * np.abs(x).max(), 0.0, x)


def diagonal_constraints(
    entry: ConvexGain,
    values: tuple[Expression, Expression],
    error: tuple[Array, Array],
    S: Matrix,
    rows: Matrix,
    *,
    pace: float = 1.0,
) -> list[Expression]:
    """Constraints on a gain K, for p (n,) > 0 and U = diag(p) K (n, p) in z and y / rows.

    values: p, U; error: (X, output), where X - K output is the matrix of the error in z; pace:
    units of time of a gain of the flow and its error to one of the plant's.
    """
    import cvxpy as cp

    p, U = values
    inward = np.linalg.inv(S)
    P, PK = inward.T @ cp.diag(p) @ inward, inward.T @ U @ np.diag(1 / rows)
    stated = entry.constraints(np.ones(len(S)), pace)([P, PK])
    return [*stated, *entry.blocks(error, p, U, pace)]
