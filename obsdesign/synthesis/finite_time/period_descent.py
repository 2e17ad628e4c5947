"""Last step of a search for a long period: descent on the true norms of condition (13)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.solvers import merged
from lmi.time_budget import TimeBudget, ended_by_count, remark_end
from obsdesign.equations.finite_time.formulas import SMALLEST_GAIN
from obsdesign.synthesis.finite_time.period_problem import (
    Injection,
    PeriodProblem,
    triangle_of,
    triangular,
)

_NELDER_MEAD = {"xatol": 1e-7, "fatol": 1e-11, "maxiter": 2000, "maxfev": 2000}
# beyond, a simplex only creeps
_MOST_UNKNOWNS = 12


class _BudgetEnded(Exception):
    """The time or the evaluations of a search have ended."""


class _TargetReached(Exception):
    """The period exceeds the target of the search."""


class _Cost:
    """Cost of the free variables as one vector: direction and size of L, log T, triangle of S."""

    def __init__(
        self,
        problem: PeriodProblem,
        start: Injection,
        budget: TimeBudget,
        evaluations: int,
        target: float,
    ) -> None:
        self._problem, self._start, self._target = problem, start, target
        self._budget, self._left = budget, evaluations
        self.best = start
        size = float(np.linalg.norm(start.L)) or 1.0
        x: list[Matrix] = []
        if problem.L is None:
            x += [start.L.reshape(-1) / size, np.array([math.log(size)])]
        if problem.window is None:
            x.append(np.array([math.log(start.window)]))
        if problem.coordinates:
            x.append(triangle_of(np.eye(len(problem.A)) if start.S is None else start.S))
        self.x0 = np.concatenate(x) if x else np.zeros(0)
        self._least = SMALLEST_GAIN * float(np.linalg.norm(problem.A, 2))

    def value(self, x: Matrix) -> float:
        """-log of the period; _BudgetEnded after the end, _TargetReached beyond the target."""
        self._left -= 1
        if self._left < 0 or self._budget.remaining() < 0:
            raise _BudgetEnded
        if not np.isfinite(x).all() or np.abs(x).max() > 700:
            return 1e6
        injection = self._injection(x)
        if injection.log_period > self.best.log_period:
            self.best = replace(injection, solvers=merged(self._start.solvers, ("SciPy",)))
            if injection.log_period > self._target:
                raise _TargetReached
        return -injection.log_period if math.isfinite(injection.log_period) else 1e6

    def _injection(self, x: Matrix) -> Injection:
        problem, L, T, S = self._problem, self._start.L, self._start.window, None
        if problem.L is None:
            m = L.size
            L = (x[:m] / (np.linalg.norm(x[:m]) or 1.0)).reshape(L.shape) * math.exp(x[m])
            size = float(np.linalg.norm(L @ problem.C, 2))
            L = L * max(1.0, 1.000001 * self._least / size) if size > 0 else L
            x = x[m + 1 :]
        if problem.window is None:
            T, x = math.exp(x[0]), x[1:]
        if problem.coordinates:
            S = triangular(x, len(problem.A))
        return problem.rated(L, T, S)


def polished(
    problem: PeriodProblem,
    start: Injection,
    budget: TimeBudget,
    evaluations: int,
    target: float = math.inf,
) -> Injection:
    """Improve start by quasi-Newton steps and simplices until the evaluations are spent.

    evaluations: their number, which a stretched budget multiplies; target: log of a period beyond
    which the search ends.
    """
    from scipy.optimize import minimize

    limit = budget.scaled(evaluations)
    cost = _Cost(problem, start, budget, limit, target)
    x, count = cost.x0, len(cost.x0)
    if math.isinf(start.log_period) or not count or start.log_period > target:
        return start
    try:
        x = minimize(cost.value, x, method="BFGS", options={"gtol": 1e-7, "maxiter": 100}).x
        # norms have kinks where singular values meet; a simplex that has collapsed is opened again
        for spread in (0.3, 0.1) if count <= _MOST_UNKNOWNS else ():
            simplex = np.vstack([x, x + spread * np.eye(count)])
            options = {**_NELDER_MEAD, "initial_simplex": simplex}
            x = minimize(cost.value, x, method="Nelder-Mead", options=options).x
    except _TargetReached:
        pass
    except _BudgetEnded:
        end = budget.ended() or ended_by_count("evaluations", limit)
        return replace(cost.best, remarks=remark_end(problem.unknowns, end))
    return cost.best
