"""The longest period of condition (13) as a smooth program, for CasADi and IPOPT.

    maximise  log nu = log log(1 + u / (g |L C|)) - log |A|
    over      L = e^lambda l, |l| = 1;  log T;  w = log u;  coordinates S = upper triangular
    such that w + e^w = log Sigma* - f T

(13) eliminates nu by Lambert's function, and w + e^w = ... says u e^u = Sigma* e^{-f T} without
overflow. Spectral norms are replaced by (tr (X'X)^p)^(1/2p), which is above them by at most
n^(1/2p) and smooth; since all terms of (13) grow with each norm, a feasible point of the program
is one of (13). e^X is a scaled Taylor polynomial: the wheel's own expm lacks its plugin. Its
solutions are rated again with true norms, and proved elsewhere.

The smooth formulas take SX and MX of CasADi alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.finite_time.condition_13 import log_lambert
from obsdesign.equations.finite_time.formulas import SMALLEST_GAIN
from obsdesign.synthesis.finite_time.period_problem import (
    PeriodProblem,
    normal_coordinates,
    triangular,
)

Expression = Any  # SX or MX of CasADi, whose type hints exclude formulas for both
_TAYLOR_DEGREE, _SQUARINGS = 16, 6
_NORM_DOUBLINGS = 6  # p = 64


def casadi_package() -> Expression:
    """Import CasADi without its type hints, which exclude formulas for both SX and MX."""
    import casadi

    return casadi


def triangular_of(entries: Expression, n: int) -> tuple[Expression, Expression]:
    """S upper triangular with exponentials on its diagonal, and its inverse."""
    ca = casadi_package()

    S, k = type(entries).zeros(n, n), 0
    for i in range(n):
        for j in range(i, n):
            S[i, j] = ca.exp(entries[k]) if i == j else entries[k]
            k += 1
    return S, inverse_of(S, n)


def inverse_of(X: Expression, n: int) -> Expression:
    """X^-1 for X (n, n)."""
    ca = casadi_package()

    unit = type(X).eye(n)
    return ca.solve(X, unit) if isinstance(X, ca.SX) else ca.solve(X, unit, "lapackqr")


def exponential_of(X: Expression) -> Expression:
    """e^X by a Taylor polynomial and squarings."""
    ca = casadi_package()

    scaled = X / 2**_SQUARINGS
    unit = type(X).eye(X.shape[0])
    result = unit
    for k in range(_TAYLOR_DEGREE, 0, -1):
        result = unit + ca.mtimes(scaled, result) / k
    for _ in range(_SQUARINGS):
        result = ca.mtimes(result, result)
    return result


def log_norm(X: Expression) -> Expression:
    """log (tr (X'X)^p)^(1/2p), p = 2^doublings, each power scaled by its trace."""
    ca = casadi_package()

    power = ca.mtimes(X.T, X)
    total, weight = 0, 1.0
    for _ in range(_NORM_DOUBLINGS):
        trace = ca.trace(power)
        total = total + weight * ca.log(trace)
        power = power / trace
        power = ca.mtimes(power, power)
        weight /= 2
    return (total + weight * ca.log(ca.trace(power))) / 2


def softplus(x: Expression) -> Expression:
    """log(1 + e^x), without overflow."""
    ca = casadi_package()

    return ca.fmax(x, 0) + ca.log1p(ca.exp(-ca.fabs(x)))


def condition_13(
    problem: PeriodProblem, kind: Expression
) -> tuple[Expression, Expression, Expression, Expression]:
    """(unknowns, log nu, equality that vanishes, (|l|^2 - 1, log |L C|)); kind: SX or MX.

    unknowns: l (n p,), log of the size of L, log T, w = log u, the triangle of S.
    """
    ca = casadi_package()

    A, C, n, p = problem.A, problem.C, len(problem.A), len(problem.C)
    direction, size = kind.sym("l", n * p), kind.sym("size")
    log_T, w = kind.sym("T"), kind.sym("w")
    triangle = kind.sym("S", n * (n + 1) // 2)
    S, S_inverse = triangular_of(triangle, n)
    A_s = ca.mtimes([S, ca.DM(A), S_inverse])
    unit = ca.mtimes([S, ca.reshape(direction, n, p), ca.DM(C), S_inverse])
    T = ca.exp(log_T)
    F = A_s + ca.exp(size) * unit
    block = ca.blockcat([[-F, unit], [kind.zeros(n, n), -A_s]]) * T
    whole = exponential_of(block)
    log_a = log_norm(whole[:n, :n])
    log_m = log_norm(inverse_of(whole[:n, n:], n)) - size
    log_f, log_LC = log_norm(F), log_norm(unit) + size
    f = ca.exp(log_f)
    log_sigma = -log_a - softplus(log_m + log_a)
    if problem.tighter:  # e^u - 1 = Sigma* e^{-f T}, which does not underflow
        u, log_g = ca.exp(w), log_T
        equality = u + ca.log(-ca.expm1(-u)) - log_sigma + f * T
    else:
        log_g = 2 * f * T + ca.log(-ca.expm1(-2 * f * T)) - math.log(2) - log_f
        equality = w + ca.exp(w) - log_sigma + f * T
    log_nu = ca.log(ca.log1p(ca.exp(w - log_g - log_LC))) - log_norm(A_s)
    unknowns = ca.vertcat(direction, size, log_T, w, triangle)
    return unknowns, log_nu, equality, (ca.dot(direction, direction) - 1, log_LC)


_SCALAR_STATES = 3
_LARGEST_GAIN = 1e3  # |L C| relative to |A|


@dataclass(frozen=True)
class Start:
    """Initial point: direction of L (n p,), its size, T, and S as entries of `triangular`.

    L and T are those of the problem where it fixes them.
    """

    direction: Matrix
    size: float
    window: float
    triangle: Matrix | None = None


@dataclass(frozen=True)
class Solution:
    """A point of the program; period and status are unchecked results of the solver."""

    L: Matrix
    window: float
    period: float
    S: Matrix | None
    status: str
    iterations: int

    @property
    def is_finite(self) -> bool:
        """Are all variables finite, with T > 0?"""
        S = 0.0 if self.S is None else self.S
        return bool(
            np.isfinite(self.L).all() and np.isfinite(S).all() and 0 < self.window < math.inf
        )


class PeriodProgram:
    """The program of one plant, built once and solved from several starts.

    With `tighter_sigma` u is log(1 + Sigma* e^{-f T}) and T stands for g. seconds: of processor
    time, for a run.
    """

    def __init__(self, problem: PeriodProblem, seconds: float = math.inf) -> None:
        ca = casadi_package()

        self._problem = problem
        self._n, self._p = len(problem.A), len(problem.C)
        # scalar expressions are faster, but grow like n^3 in their length: matrices beyond
        small = self._n <= _SCALAR_STATES
        x, log_nu, equality, conditions = condition_13(problem, ca.SX if small else ca.MX)
        self._size_A = float(np.linalg.norm(problem.A, 2)) or 1.0
        self._size_C = float(np.linalg.norm(problem.C, 2))
        ipopt = {"print_level": 0, "sb": "yes", "max_iter": 300}
        ipopt |= {"max_cpu_time": seconds} if seconds < math.inf else {}
        ipopt |= {} if small else {"hessian_approximation": "limited-memory"}
        self._equality = ca.Function("equality", [x], [equality])
        self._solver = ca.nlpsol(
            "period", "ipopt",
            {"x": x, "f": -log_nu, "g": ca.vertcat(equality, *conditions)},
            {"print_time": False, "show_eval_warnings": False, "ipopt": ipopt},
        )  # fmt: skip

    def solve(self, start: Start) -> Solution:
        """Return the solution of one run of IPOPT."""
        n, p, problem = self._n, self._p, self._problem
        triangle = np.zeros(n * (n + 1) // 2) if start.triangle is None else start.triangle
        free = math.inf if problem.coordinates else 0.0
        log_T = math.log(start.window)
        ends = (-math.inf, math.inf) if problem.window is None else (log_T, log_T)
        x0 = np.concatenate([start.direction, [math.log(start.size), log_T, 0.0], triangle])
        missing = float(self._equality(x0))  # at w = 0, where the left-hand side is 1
        x0[n * p + 2] = log_lambert(1.0 - missing) if math.isfinite(missing) else -10.0
        fixed = np.full(len(triangle), free)
        inner = np.full(n * p + 1, math.inf)
        low, high = -inner, inner
        least = math.log(SMALLEST_GAIN * self._size_A)
        most = math.log(_LARGEST_GAIN * self._size_A)
        if problem.L is not None:
            low = high = x0[: n * p + 1]
            least, most = -math.inf, math.inf
        result = self._solver(
            x0=x0,
            lbx=np.concatenate([low, [ends[0], -math.inf], -fixed]),
            ubx=np.concatenate([high, [ends[1], math.inf], fixed]),
            lbg=[0, 0, least], ubg=[0, 0, most],
        )  # fmt: skip
        x = np.asarray(result["x"]).reshape(-1)
        L = problem.L
        if L is None:
            L = math.exp(min(x[n * p], 700.0)) * x[: n * p].reshape(p, n).T
        S = triangular(x[n * p + 3 :], n) if problem.coordinates else None
        stats = self._solver.stats()
        period = math.exp(min(-float(result["f"]), 700.0)) if result["f"].is_regular() else 0.0
        window, status = math.exp(min(x[n * p + 1], 700.0)), str(stats["return_status"])
        return Solution(L, window, period, S, status, int(stats["iter_count"]))

    def starts(self, count: int) -> Sequence[Start]:
        """Random directions, L C below and about the size of A, T below and about 1 / |A|.

        Every second one starts in coordinates in which A is (nearly) normal.
        """
        problem = self._problem
        rng = np.random.default_rng(0)  # fixed: the same problem has the same starts
        normal = normal_coordinates(problem.A) if problem.coordinates else None
        starts = []
        for i in range(count):
            direction = rng.standard_normal(self._n * self._p)
            direction /= np.linalg.norm(direction)
            # from far below |A| there is no gradient back: most starts are near it
            size = self._size_A / self._size_C * 10.0 ** rng.uniform(-2, 0.5)
            window = 10.0 ** rng.uniform(-1, 0.3) / self._size_A
            if problem.L is not None:
                size = float(np.linalg.norm(problem.L))
                direction = problem.L.T.reshape(-1) / size
            if problem.window is not None:
                window = problem.window
            starts.append(Start(direction, size, window, normal if i % 2 == 0 else None))
        return starts
