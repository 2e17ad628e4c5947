"""Matrix inequalities and linear programs under further convex constraints, through CVXPY.

    minimise f(P, Z, ...)   subject to   inequality(P, Z, ...)_i >= margin I   for every i,
                                         I <= P <= kappa I   for every symmetric P,
                                         constraints(P, Z, ...)

Without f the margin is as large as possible, at most 1. This is `lmi.find.affine` with a modelling
layer that takes anything convex and is some hundred times slower; the inequalities are read off in
the same way. `constrained_minimum` is `lmi.find.linear_program.minimise` in the same sense. Nothing
here is proved.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.find.affine import Inequality, Unknown, coefficients

Expression = Any  # of CVXPY, which is not typed
Constraints = Callable[[Sequence[Expression]], Sequence[Expression]]  # unknowns -> constraints
Objective = Callable[[Sequence[Expression]], Expression]  # unknowns -> convex expression


def constrained_matrices(
    unknowns: Sequence[Unknown],
    inequalities: Sequence[Inequality],
    kappa: float,
    *,
    constraints: Constraints = lambda values: (),
    objective: Objective | None = None,
    margin: float = 0.0,
) -> tuple[list[Matrix], float] | None:
    """(values of the unknowns, margin), or None when the solver finds none.

    constraints, objective: functions of CVXPY expressions in the order of the unknowns. margin:
    that of the inequalities where there is an objective. None says nothing: the solver found no
    values, or gave up. ValueError for constraints or an objective that are not convex by CVXPY's
    rules.
    """
    import cvxpy as cp  # slow to import, and rarely needed

    values = [cp.Variable((u.rows, u.columns), symmetric=u.symmetric) for u in unknowns]
    level = cp.Variable() if objective is None else cp.Constant(margin)
    holds = [*constraints(values)]
    for value in (v for v, unknown in zip(values, unknowns, strict=True) if unknown.symmetric):
        holds += [value >> np.eye(value.shape[0]), kappa * np.eye(value.shape[0]) >> value]
    for inequality in inequalities:
        blocks = inequality_blocks(unknowns, inequality, values)
        holds += [S >> level * np.eye(S.shape[0]) for S in blocks]
    if objective is None:
        goal, holds = cp.Maximize(level), [*holds, level <= 1]
    else:
        goal = cp.Minimize(objective(values))
    program = cp.Problem(goal, holds)
    if not _solve(program):
        return None
    solution = [np.asarray(value.value, dtype=np.float64) for value in values]
    if not all(np.isfinite(value).all() for value in solution):
        return None
    return solution, float(level.value)


def _free(unknown: Unknown) -> list[int]:
    """Places, by columns, of the entries that determine an unknown, in the order of its basis."""
    return [
        j * unknown.rows + i
        for j in range(unknown.columns)
        for i in range(j + 1 if unknown.symmetric else unknown.rows)
    ]


def inequality_blocks(
    unknowns: Sequence[Unknown], inequality: Inequality, values: Sequence[Expression]
) -> list[Expression]:
    """The matrices of an inequality as CVXPY expressions of the values of its unknowns."""
    import cvxpy as cp

    pairs = zip(values, unknowns, strict=True)
    entries = cp.hstack([cp.vec(value, order="F")[_free(unknown)] for value, unknown in pairs])
    constant, columns = coefficients(unknowns, inequality)
    count, m = constant.shape[:2]
    changes = np.array(columns).reshape(len(columns), count, m * m)
    return [
        constant[i] + cp.reshape(changes[:, i].T @ entries, (m, m), order="C") for i in range(count)
    ]


def constrained_minimum(
    cost: Matrix,
    rows: tuple[Indices, Indices, Matrix],
    sides: tuple[Matrix, Matrix],
    bounds: tuple[Matrix, Matrix],
    constraints: Callable[[Expression], Sequence[Expression]],
) -> Matrix | None:
    """x of least cost'x with lower <= A x <= upper, low <= x <= high and the constraints of x.

    As `linear_program.minimise` has it; None when the solver finds none. ValueError for constraints
    that are not convex by CVXPY's rules.
    """
    import cvxpy as cp
    from scipy.sparse import csr_array

    row, column, value = rows
    A = csr_array((value, (row, column)), shape=(len(sides[0]), len(cost)))
    x = cp.Variable(len(cost))
    holds = [*constraints(x)]
    for expression, (low, high) in ((A @ x, sides), (x, bounds)):
        below, above = np.flatnonzero(np.isfinite(low)), np.flatnonzero(np.isfinite(high))
        holds += [expression[below] >= low[below]] if below.size else []
        holds += [expression[above] <= high[above]] if above.size else []
    if not _solve(cp.Problem(cp.Minimize(cost @ x), holds)):
        return None
    solution = np.asarray(x.value, dtype=np.float64)
    return solution if np.isfinite(solution).all() else None


def _solve(program: Expression) -> bool:
    """Solve by Clarabel; False where it ends without usable numbers, ValueError if not convex."""
    import cvxpy as cp

    if not program.is_dcp():
        raise ValueError("constraints and objective must be convex by CVXPY's rules (DCP)")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an inaccurate solution is a proposal too
        try:
            program.solve(solver=cp.CLARABEL, max_threads=1)
        except cp.error.SolverError:
            return False
    return program.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE)
