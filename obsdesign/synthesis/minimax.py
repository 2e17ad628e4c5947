"""Gains on a window with the least largest error: one linear program per state.

    minimise  sum_jc V_c |g_jc| + sum_l nu sum_c Delta_c |r_l e^{-A nu/2}|_c
    such that r_l = r_{l-1} A_d^{-1} + g_l C,   r_{k-1} A_d^{-1} = e_r   (unbiased)

g is row r of the gains, r_l row r of R_l (`window_bounds`); the integral over a period is replaced
by its midpoint, which steers well enough: what is found is made unbiased and bounded again.
"""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

from lmi.exponential import expm

# samples in a program; a longer window has no better gains that would be worth the time
_SMALL = 1e-9


def minimax_gain(gains: dict[str, Any], rows: Any) -> Any:
    """(n, k p), with NaN in rows where the solver gives up. rows: (k, p, n) of `sample_rows`."""
    import cvxpy as cp

    A, C, period, k = gains["A"], gains["C"], gains["period"], gains["samples"]
    n, p = len(A), len(C)
    noise = np.asarray(gains["noise_bound"])
    Delta = (gains["flow_upper"] - gains["flow_lower"]) / 2 * period
    back, half = expm(-A * period), expm(-A * period / 2)
    size = np.abs(rows).max() or 1.0
    # without any weight a gain could grow for nothing: a little noise keeps the program bounded
    weights = np.maximum(noise, _SMALL * max(float(noise.max()), float(Delta.max()) * size))
    target = cp.Parameter(n)
    g, r = cp.Variable((k, p)), cp.Variable((k, n))
    conditions = [r[0] == g[0] @ C, r[k - 1] @ back == target]
    if k > 1:
        conditions.append(r[1:] == r[:-1] @ back + g[1:] @ C)
    cost = cp.sum(cp.abs(g) @ weights)
    if np.any(Delta):
        cost = cost + cp.sum(cp.abs(r @ half) @ Delta)
    program = cp.Problem(cp.Minimize(cost), conditions)
    found = []
    for unit in np.eye(n):
        target.value = unit
        with contextlib.suppress(cp.error.SolverError):
            program.solve(solver=cp.CLARABEL)
        value = g.value if program.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE) else None
        found.append(np.full(k * p, np.nan) if value is None else np.asarray(value).reshape(-1))
    return np.array(found)
