"""Gains on a window with the least largest error: one linear program per state.

    minimise  sum_jc V_c |g + z|_jc + sum_l nu sum_c Delta_c |(r_l + q_l) e^{-A nu/2}|_c
    such that q_l = q_{l-1} A_d^{-1} + z_l C,   q_{k-1} = 0     (z changes nothing of the bias)

g is row r of gains that are unbiased already, those of least squares, r_l row r of their R_l
(`window_bounds`); where the window speaks of its start, Q_l in place of R_l. So z = 0 is always
there, and everything is in units in which it is about one. The integral over a period is replaced
by its midpoint, which steers well enough: what is found is made unbiased and bounded again.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.exponential import expm
from obsdesign.equations.finite_time.gains import START, state_scales

Array = NDArray[np.float64]

# a sample without noise counts that little beside the others: gains do not grow for nothing
_SMALL = 1e-9
# the second one, slower with long windows, where the first one is not sure
_TIGHT = 1e-10
_SOLVERS: dict[str, dict[str, Any]] = {
    "CLARABEL": {"tol_gap_abs": _TIGHT, "tol_gap_rel": _TIGHT, "tol_feas": _TIGHT},
    "HIGHS": {"highs_options": {"time_limit": 5.0, "threads": 1}},
}


@dataclass(frozen=True)
class _Task:
    """A row's program in natural units: all but its fitted gains."""

    C: Array
    step: Array
    half: Array
    weights: Array
    Delta: Array
    of_start: bool

    @staticmethod
    def of(gains: dict[str, Any], fitted: Array) -> tuple[_Task, Array]:
        """The task, and the units of the states."""
        A, C, period, k = gains["A"], gains["C"], gains["period"], gains["samples"]
        units = state_scales(A, C, k * period)
        A, C = A * units / units[:, None], C * units
        of_start = gains.get("reference") == START
        forwards = 1.0 if of_start else -1.0
        Delta = (gains["flow_upper"] - gains["flow_lower"]) / 2 * period / units
        noise = np.asarray(gains["noise_bound"])
        size = float(np.abs(fitted / units[:, None]).max()) or 1.0
        least = _SMALL * max(float(noise.max()), float(Delta.max()) / size)
        step, half = expm(forwards * A * period), expm(forwards * A * period / 2)
        return _Task(C, step, half, np.maximum(noise, least), Delta, of_start), units

    def weights_of_disturbance(self, g: Array, unit: Array) -> Array:
        """r_l, l = 0..k-1, or q_l, (k, n), of the row g (k, p), whose state is `unit`."""
        found = np.zeros((len(g), len(unit)))
        now = unit if self.of_start else 0 * unit
        order = range(len(g) - 1, -1, -1) if self.of_start else range(len(g))
        for j in order:
            if self.of_start:
                found[j], now = now, now @ self.step - g[j] @ self.C
            else:
                found[j] = now = now @ self.step + g[j] @ self.C
        return found

    def error(self, g: Array, unit: Array) -> float:
        """What the program makes small; infinite beyond floats."""
        r = self.weights_of_disturbance(g, unit)
        size = (np.abs(g) @ self.weights).sum() + (np.abs(r @ self.half) @ self.Delta).sum()
        return float(size) if np.isfinite(size) else np.inf


def minimax_gain(
    gains: dict[str, Any], fitted: Array, project: Callable[[Array], Array]
) -> tuple[Array, list[int]]:
    """(n, k p), and the rows that are those of fitted, as nothing better was found.

    fitted: unbiased gains, (n, k p); project makes gains unbiased that are nearly so.
    """
    task, units = _Task.of(gains, fitted)
    k, p, n = gains["samples"], len(gains["C"]), len(units)
    found, kept = fitted.copy(), []
    with np.errstate(over="ignore", invalid="ignore"):
        for r, unit in enumerate(np.eye(n)):
            g = fitted[r].reshape(k, p) / units[r]
            least = task.error(g, unit)
            for row in _solved(task, g, unit):
                moved = fitted.copy()
                moved[r] = units[r] * row.reshape(-1)
                moved = project(moved)
                error = task.error(moved[r].reshape(k, p) / units[r], unit)
                if error < least:
                    found[r], least = moved[r], error
            if (found[r] == fitted[r]).all():
                kept.append(r)
    return found, kept


def _solved(task: _Task, g: Array, unit: Array) -> list[Array]:
    """What the solvers make of g, (k, p), for the state `unit`, the last one being surest of it."""
    import cvxpy as cp

    r = task.weights_of_disturbance(g, unit)
    disturbed = bool(np.any(task.Delta))
    total = task.error(g, unit)
    size_g, size_r = float(np.abs(g).max()), float(np.abs(r).max())
    if not (0 < total < np.inf and 0 < size_g < np.inf and 0 < size_r < np.inf):
        return []
    z, q = cp.Variable(g.shape), cp.Variable(r.shape)
    pushed = (size_g / size_r) * (z @ task.C)
    if task.of_start:
        conditions = [q[-1] == 0, q[0] @ task.step == pushed[0]]
        conditions += [q[:-1] == q[1:] @ task.step - pushed[1:]] if len(g) > 1 else []
    else:
        conditions = [q[-1] == 0, q[0] == pushed[0]]
        conditions += [q[1:] == q[:-1] @ task.step + pushed[1:]] if len(g) > 1 else []
    cost = cp.sum(cp.abs(g / size_g + z) @ (task.weights * size_g / total))
    if disturbed:
        moved = (r / size_r + q) @ task.half
        cost = cost + cp.sum(cp.abs(moved) @ (task.Delta * size_r / total))
    program = cp.Problem(cp.Minimize(cost), conditions)
    found = []
    for solver, options in _SOLVERS.items():
        # CVXPY calls an unknown status a ValueError
        with contextlib.suppress(cp.error.SolverError, ValueError), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a solution that may be inaccurate: it is judged
            program.solve(solver=solver, **options)
        if z.value is not None and np.isfinite(z.value).all():
            found.append(np.asarray(g + size_g * z.value))
        if program.status == cp.OPTIMAL:
            break
    return found
