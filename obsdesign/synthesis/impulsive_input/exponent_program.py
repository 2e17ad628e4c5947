"""Exponents that make the time of an impulse least sensitive to noise, by CasADi and IPOPT.

    minimise  log c' N(Lambda) c,   c = the row of J^+ for the age, J = [b'(s), b(s)]
    over      Lambda, and the age s where it is the peak of |b|:  b(s)' b'(s) = 0
    such that lambda_1 <= lambda_bar (what (15) neglects),  lambda_i - lambda_{i+1} >= spacing

N is the covariance of the features under white noise, N_ij = (e^{(lambda_i + lambda_j) tau} - 1) /
(lambda_i + lambda_j) for each output. An independent check of the corner of
`exponents`; its result is evaluated again with exact responses.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries
from lmi.arithmetic.exponential import exponential_grid
from lmi.time_budget import Remark, TimeBudget, remark_end
from obsdesign.equations.impulsive_input.features import (
    FeatureWindow,
    feature_flows,
    filtered_system,
    impulse_responses,
)

Expression = Any  # SX or MX of CasADi, whose type hints exclude formulas for both
_NODES = 96  # of Gauss's rule on [0, s]
_KNOTS = 400  # of the spline through h
_LARGEST_EXPONENT_RATIO = 6.0  # exponents may be this much faster than the slowest
_SLACK = 1e-9


def time_deviation(window: FeatureWindow, scale: Matrix, age: float) -> float:
    """Deviation of the time of an impulse of weight 1 at an age, plain norm; exact responses.

    For white noise of intensity scale_j^2 at output j; infinite where J has rank one.
    """
    exponents, tau, C = window.exponents, window.tau, window.C
    F, n = filtered_system(window.D, C, exponents), len(window.D)
    state = feature_flows(F, n, age, 0.0, 1)[0] @ window.H[:, 0]
    b, rate = state[n:], (F @ state)[n:]
    J = np.column_stack([rate, b])
    if np.linalg.matrix_rank(J, tol=1e-13 * float(np.abs(J).max())) < 2:
        return float("inf")
    row = np.linalg.pinv(J, rcond=1e-14)[0]
    sums = exponents[:, None] + exponents
    flat = np.abs(sums) * tau < 1e-9
    N = np.where(flat, tau, np.expm1(sums * tau) / np.where(flat, 1.0, sums))
    parts = row.reshape(len(C), -1) * scale[:, None]
    return float(np.sqrt(np.einsum("ji,ik,jk->", parts, N, parts)))


def peak_age(window: FeatureWindow) -> float:
    """Age at which |b| is largest, on a grid refined by a parabola."""
    n, count = len(window.D), 800
    F = filtered_system(window.D, window.C, window.exponents)
    tau = window.tau
    states = impulse_responses(F, window.H, tau / count, count + 1)
    size = np.linalg.norm(states[:, n:, 0], axis=1)
    k = int(np.clip(np.argmax(size), 1, count - 1))
    low, mid, high = size[k - 1 : k + 2]
    bend = low - 2 * mid + high
    shift = 0.5 * (low - high) / bend if bend < 0 else 0.0
    return float((k + np.clip(shift, -1, 1)) * tau / count)


def optimal_exponents(
    window: FeatureWindow, scale: Matrix, age: float | None, budget: TimeBudget
) -> list[Matrix]:
    """Sets that IPOPT prefers to those of `window`, each decreasing.

    It starts from those exponents, and from spread ones. One direction H (n, 1). age: where
    impulses are evaluated, None for the peak of |b|.
    """
    corner, tau = window.exponents, window.tau
    n, m = len(window.D), len(corner)
    spacing = float(-np.diff(corner).max()) * tau if m > 1 else 0.0
    first = float(corner[0]) * tau  # in units of the window: ages and exponents near one
    begin = (peak_age(window) if age is None else age) / tau
    solver = _solver(window, scale, age is None, budget)
    ends = (begin, begin) if age is not None else (0.02, 0.98)
    zeros = [0.0] * (age is None)
    spread = corner * tau
    if m > n:
        spread = np.append(
            spread[:n], spread[n - 1] * np.geomspace(1.5, 0.9 * _LARGEST_EXPONENT_RATIO, m - n)
        )
    sets = []
    for lams in (corner * tau, spread):
        solution = solver(
            x0=np.append(1.05 * lams, begin),
            lbx=[_LARGEST_EXPONENT_RATIO * first] * m + [ends[0]], ubx=[first] * m + [ends[1]],
            lbg=[spacing * (1 - _SLACK)] * (m - 1) + zeros, ubg=[math.inf] * (m - 1) + zeros,
        )  # fmt: skip
        if solver.stats()["success"]:
            z = np.asarray(solution["x"], dtype=np.float64).ravel()[:m] / tau
            sets.append(np.sort(np.minimum(z, corner[0]))[::-1])
    return sets


def _solver(window: FeatureWindow, scale: Matrix, at_peak: bool, budget: TimeBudget) -> Expression:
    """IPOPT over (Lambda tau, s / tau): gaps between exponents, and b'b_dot = 0 at a peak."""
    import casadi as ca

    m, p = len(window.exponents), len(window.C)
    lams, s = ca.SX.sym("lambda", m), ca.SX.sym("s")
    x, w = np.polynomial.legendre.leggauss(_NODES)
    x, w = (x + 1) / 2, w / 2
    values = [ca.SX.sym(f"h{j}", _NODES + 1) for j in range(p)]
    features, rates = [], []
    for column in values:
        for i in range(m):
            kernel = s * ca.exp(lams[i] * s * (1 - ca.DM(x))) * ca.DM(w)
            features.append(ca.dot(kernel, column[:_NODES]))
            rates.append(lams[i] * features[-1] + column[_NODES])
    b, rate = ca.vertcat(*features), ca.vertcat(*rates)
    aa, ad, dd = ca.dot(b, b), ca.dot(b, rate), ca.dot(rate, rate)
    row = (aa * rate - ad * b) / (aa * dd - ad * ad)
    variance = ca.SX(0)
    for j, i, k in itertools.product(range(p), range(m), range(m)):
        both = lams[i] + lams[k]
        entry = (ca.exp(both) - 1) / both
        variance += float(scale[j]) ** 2 * row[j * m + i] * row[j * m + k] * entry
    body = ca.Function("body", [lams, s, *values], [ca.log(variance), ad / aa])
    z = ca.MX.sym("z", m + 1)
    ages = ca.vertcat(z[m] * ca.DM(x), z[m])
    cost, peak = body(z[:m], z[m], *(spline(ages.T).T for spline in _splines(ca, window)))
    gaps = [z[i] - z[i + 1] for i in range(m - 1)]
    program: Entries = {"x": z, "f": cost, "g": ca.vertcat(*gaps, *([peak] if at_peak else []))}
    quiet: NewEntries = {
        "ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False,
        "show_eval_warnings": False, "ipopt.max_iter": 200,
    }  # fmt: skip
    if math.isfinite(seconds := budget.remaining()):
        quiet["ipopt.max_cpu_time"] = max(seconds, 1e-3)
    return ca.nlpsol("exponents", "ipopt", program, quiet)


def _splines(ca: Expression, window: FeatureWindow) -> list[Expression]:
    """h of each output over ages in units of the window, up to a common factor."""
    grid = exponential_grid(window.D, 0.0, window.tau / _KNOTS, _KNOTS + 1)
    shown = (grid @ window.H)[:, :, 0] @ window.C.T
    knots = np.linspace(0.0, 1.0, _KNOTS + 1)
    unit = float(np.abs(shown).max()) or 1.0
    return [ca.interpolant("h", "bspline", [knots], column / unit) for column in shown.T]


def refined_exponents(
    window: FeatureWindow, scale: Matrix, age: float | None, budget: TimeBudget
) -> tuple[Matrix | None, float, tuple[Remark, ...]]:
    """(best set of IPOPT, its deviation of times relative to that of `window`, remarks).

    None without a set.
    """

    def deviation(exponents: Matrix) -> float:
        chosen = replace(window, exponents=exponents)
        return time_deviation(chosen, scale, peak_age(chosen) if age is None else age)

    own = deviation(window.exponents)
    sets = optimal_exponents(window, scale, age, budget)
    remarks = remark_end("exponents", budget.ended())
    best = min(((deviation(exponents) / own, k) for k, exponents in enumerate(sets)), default=None)
    return (None, math.nan, remarks) if best is None else (sets[best[1]], best[0], remarks)
