"""Gains on a window with the least largest error: one linear program per state.

    minimise  sum_jc V_c |g + z|_jc + sum_l nu sum_c Delta_c |(r_l + q_l) e^{-A nu/2}|_c
    such that q_l = q_{l-1} A_d^{-1} + z_l C,   q_{k-1} = 0     (z changes nothing of the bias)

g is row r of gains that are unbiased already, those of least squares, r_l row r of their R_l
(`analysis.finite_time.error_radius`); relative to the window's start Q_l in place of R_l. So z = 0
is always feasible, and everything is in units in which it is about one. The integral over a period
is replaced by its midpoint, which is accurate enough for a cost: the minimiser is made unbiased and
bounded again.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from lmi.solvers import Solver, Solvers, merged
from obsdesign.synthesis.finite_time.window_task import WindowTask

if TYPE_CHECKING:
    import cvxpy as cp

# weight of a sample without noise relative to the others, which keeps its gains small
_LEAST_WEIGHT = 1e-9
# the second one, slower with long windows, where the first one is not sure
_TIGHT = 1e-10
_SOLVERS: Mapping[Solver, tuple[str, Mapping[str, object]]] = {
    "CVXPY/Clarabel": (
        "CLARABEL",
        {"tol_gap_abs": _TIGHT, "tol_gap_rel": _TIGHT, "tol_feas": _TIGHT},
    ),
    "CVXPY/HiGHS": ("HIGHS", {"highs_options": {"simplex_iteration_limit": 20_000, "threads": 1}}),
}


@dataclass(frozen=True)
class MinimaxGain:
    """Gains (n, k p), the rows kept for lack of better ones, and the solvers of the others."""

    gain: Matrix
    kept: list[int]
    solvers: Solvers


@dataclass(frozen=True)
class _RowProgram:
    """The program of a row in natural units, without its fitted gains."""

    C: Matrix
    step: Matrix
    half: Matrix
    weights: Matrix
    Delta: Matrix
    from_start: bool

    @classmethod
    def from_task(cls, task: WindowTask, fitted: Matrix) -> Self:
        """The program of a task with these fitted gains (n, k p)."""
        units, period, flow = task.scales, task.period, task.plant.flow
        A, C = task.A * units / units[:, None], task.C * units
        forwards = 1.0 if task.is_relative_to_start else -1.0
        Delta = np.subtract(*flow.b_bounds[::-1]) / 2 * period / units
        noise = np.asarray(task.plant.output.noise_radius)
        size = float(np.abs(fitted / units[:, None]).max()) or 1.0
        least = _LEAST_WEIGHT * max(float(noise.max()), float(Delta.max()) / size)
        return cls(
            C=C,
            step=expm(forwards * A * period),
            half=expm(forwards * A * period / 2),
            weights=np.maximum(noise, least),
            Delta=Delta,
            from_start=task.is_relative_to_start,
        )

    def weights_of_disturbance(self, g: Matrix, unit: Matrix) -> Matrix:
        """r_l, l = 0..k-1, or q_l, (k, n), of the row g (k, p), whose state is `unit`."""
        weights = np.zeros((len(g), len(unit)))
        if self.from_start:
            q = unit
            for j in range(len(g) - 1, -1, -1):
                weights[j], q = q, q @ self.step - g[j] @ self.C
            return weights
        r = 0 * unit
        for j in range(len(g)):
            weights[j] = r = r @ self.step + g[j] @ self.C
        return weights

    def error(self, g: Matrix, unit: Matrix) -> float:
        """Cost of the program; infinite beyond floats."""
        r = self.weights_of_disturbance(g, unit)
        size = (np.abs(g) @ self.weights).sum() + (np.abs(r @ self.half) @ self.Delta).sum()
        return float(size) if np.isfinite(size) else np.inf


def minimax_gain(
    task: WindowTask, fitted: Matrix, project: Callable[[Matrix], Matrix]
) -> MinimaxGain:
    """Gains on the window with the least largest error, row by row.

    fitted: unbiased gains, (n, k p); project makes gains unbiased that are nearly so.
    """
    program, units = _RowProgram.from_task(task, fitted), task.scales
    k, p, n = task.samples, len(task.C), len(units)
    best, kept, solvers = fitted.copy(), list[int](), Solvers()
    with np.errstate(over="ignore", invalid="ignore"):
        for r, unit in enumerate(np.eye(n)):
            g = fitted[r].reshape(k, p) / units[r]
            least, solver_of_row = program.error(g, unit), Solvers()
            for solver, row in _solutions(program, g, unit):
                gain = fitted.copy()
                gain[r] = units[r] * row.reshape(-1)
                gain = project(gain)
                error = program.error(gain[r].reshape(k, p) / units[r], unit)
                if error < least:
                    best[r], least, solver_of_row = gain[r], error, (solver,)
            solvers = merged(solvers, solver_of_row)
            if (best[r] == fitted[r]).all():
                kept.append(r)
    return MinimaxGain(best, kept, solvers)


def _solutions(program: _RowProgram, g: Matrix, unit: Matrix) -> list[tuple[Solver, Matrix]]:
    """Solutions (k, p) near g for the state `unit`, one per solver until one is optimal."""
    import cvxpy as cp

    r = program.weights_of_disturbance(g, unit)
    total = program.error(g, unit)
    size_g, size_r = float(np.abs(g).max()), float(np.abs(r).max())
    if not (0 < total < np.inf and 0 < size_g < np.inf and 0 < size_r < np.inf):
        return []
    z, q = cp.Variable(g.shape), cp.Variable(r.shape)
    conditions = _recursion(program, q, (size_g / size_r) * (z @ program.C))
    cost = cp.sum(cp.abs(g / size_g + z) @ (program.weights * size_g / total))
    if np.any(program.Delta):
        disturbance = (r / size_r + q) @ program.half
        cost = cost + cp.sum(cp.abs(disturbance) @ (program.Delta * size_r / total))
    linear = cp.Problem(cp.Minimize(cost), conditions)
    solutions: list[tuple[Solver, Matrix]] = []
    for name, (solver, options) in _SOLVERS.items():
        # CVXPY calls an unknown status a ValueError
        with contextlib.suppress(cp.error.SolverError, ValueError), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an inaccurate solution is compared with g anyway
            linear.solve(solver=solver, **options)
        if z.value is not None and np.isfinite(z.value).all():
            solutions.append((name, np.asarray(g + size_g * z.value)))
        if linear.status == cp.OPTIMAL:
            break
    return solutions


def _recursion(program: _RowProgram, q: cp.Variable, push: cp.Expression) -> list[cp.Constraint]:
    """Conditions on q_l, (k, n) variables, driven by z_l C = push."""
    if program.from_start:
        conditions = [q[-1] == 0, q[0] @ program.step == push[0]]
        later = q[:-1] == q[1:] @ program.step - push[1:] if q.shape[0] > 1 else None
    else:
        conditions = [q[-1] == 0, q[0] == push[0]]
        later = q[1:] == q[:-1] @ program.step + push[1:] if q.shape[0] > 1 else None
    return conditions if later is None else [*conditions, later]
