"""Gains for samples as events: the narrowest in given coordinates, by one linear program.

From sample to sample w+ = P w + d + k with P = |(I - L C) e^(A h)| and k = 2 |L| V, so that the
width after samples tends to (I - P)^-1 (d + k), and with weights q >= 0

    q' (I - P)^-1 (d + k) = min zeta' (d + k)    over    zeta >= 0,  zeta' P + q' <= zeta'.

Row i of P, d and k depends on row i of L alone, and convexly. With U = diag(zeta) L all of it is
linear in (zeta, U): zeta_i |X_i - l_i C X| <= T is -T <= zeta_i X_i - u_i C X <= T. So the program
finds the gains of least weighted width, not only a local minimum. With P / gamma in place of P the
gains contract by gamma at least: jumps that widen may need more contraction than samples do.
Coordinates: eigenvectors of (I - L C) e^(A h) with real poles, in which P is diagonal.
Source: the dual of positive systems, as in C. Briat, Automatica 49 (2013).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.exponential import FLOW_PIECES, absolute_flow, exponential_grid
from lmi.arithmetic.spectrum import spectral_radius
from lmi.find.constrained import Expression
from lmi.solvers import Solvers
from lmi.time_budget import TimeBudget
from obsdesign.equations.interval.splits import absolute_metzler
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.convex_gain import UserConstraints, convex_gains
from obsdesign.synthesis.interval.constraints import diagonal_constraints, program_minimum
from obsdesign.synthesis.interval.task import at_most, width_weights
from obsdesign.synthesis.interval.units import balanced_units, given_limit, sampling_limit

# contraction from sample to sample: none but what the least width needs, then ever more
CONTRACTIONS = (1.0, 0.9, 0.75, 0.6, 0.45, 0.3, 0.2, 0.1)
# where neither disturbance nor noise enters, gains that forget fast; else of no weight
_FORGETTING = 1e-6
_POINTS = 9  # of a period, for the time average
_MOST_PERIODS = 2000  # from jump to jump
_LEAST_WEIGHT = 1e-6  # so that every row of L counts for something


class SampledPlant:
    """A plant in coordinates S (None: its own), with samples every h as events."""

    def __init__(
        self,
        problem: Problem,
        S: Matrix | None,
        budget: TimeBudget,
        user: UserConstraints | None = None,
    ) -> None:
        plant = problem.plant
        self.constraint = convex_gains(problem.options_as(IntervalOptions), user)["L"]
        self.budget = budget
        units = balanced_units(problem)
        self.S, self.rows = np.diag(units.sizes) if S is None else S, units.rows
        self.inward: Matrix = np.asarray(np.linalg.inv(self.S))
        self.h = float(problem.require("output.period"))
        self.A, self.C = self.inward @ plant.flow.A @ self.S, plant.output.C @ self.S
        self.C = self.C / self.rows[:, None]
        self.V = problem.require_noise_bound() / self.rows
        self.f = plant.flow.disturbance_width(self.inward)
        self.G: Matrix | None = None
        self.j = np.zeros(plant.n)
        self.dwell = (math.inf, math.inf)
        if plant.jump is not None:
            self.G = self.inward @ plant.jump.G @ self.S
            self.j = plant.jump.disturbance_width(self.inward)
            self.dwell = problem.require_dwell_time()
        self.gain_limit = given_limit(problem)
        self.limit = sampling_limit(problem, S, units)
        self.q, self.mean = self._average(width_weights(problem))

    def _average(self, weights: Matrix) -> tuple[Matrix, float]:
        """(q, c): the time average of the weighted width of x over a period is q'w + c.

        w (n,): the width in z after the sample that begins the period.
        """
        grid = np.linspace(0.0, self.h, _POINTS)
        sizes, added = absolute_flow(np.eye(len(self.A)), self.A, self.f, grid)
        share = np.full(_POINTS, 1.0 / (_POINTS - 1))
        share[[0, -1]] /= 2
        row = weights @ np.abs(self.S)
        return share @ (row @ sizes), float(share @ (added @ row))

    def system(self, L: Matrix) -> WidthSystem:
        """The width system of a gain in z."""
        K = np.eye(len(self.A)) - L @ self.C
        W, k = absolute_metzler(self.A), 2 * np.abs(L) @ self.V
        N, j = (None, None) if self.G is None else (np.abs(self.G), self.j)
        return WidthSystem(
            W=W, f=self.f, N=N, h=j, K=K, k=k, out=np.abs(self.S), A=self.A, G=self.G
        )

    def width(self, L: Matrix) -> float:
        """Time average of the weighted width, at the worse end of the range; inf if it grows.

        Constant dwell times in whole periods, jumps just after samples.
        """
        system = self.system(L)
        with np.errstate(all="ignore"):
            K, k = system.at_samples
            sizes, added = absolute_flow(K, self.A, self.f, np.array([self.h]))
            P, c = sizes[0], added[0] + k
            if not spectral_radius(P) < 1:
                return math.inf
            widths = [float(self.q @ np.linalg.solve(np.eye(len(P)) - P, c))]
            for theta in {*self.dwell} - {math.inf}:
                periods = min(max(round(theta / self.h), 1), _MOST_PERIODS)
                widths.append(self._between_jumps(P, c, periods))
        return float(max(widths)) + self.mean if np.isfinite(widths).all() else math.inf

    def _between_jumps(self, P: Matrix, c: Matrix, periods: int) -> float:
        """Average of q'w over the periods from jump to jump."""
        n = len(P)
        power, offset = np.eye(n), np.zeros(n)
        power_sum, offset_sum = np.zeros((n, n)), np.zeros(n)
        for _ in range(periods):
            power_sum, offset_sum = power_sum + power, offset_sum + offset
            power, offset = P @ power, P @ offset + c
        assert self.G is not None
        N = np.abs(self.G)
        if not spectral_radius(N @ power) < 1:
            return math.inf
        first = np.linalg.solve(np.eye(n) - N @ power, N @ offset + self.j)
        return float(self.q @ (power_sum @ first + offset_sum)) / periods

    def gain(self, contraction: float) -> Matrix | None:
        """L in z, of least average without jumps among those that contract so; None without one."""
        n, p = len(self.A), len(self.C)
        flows = exponential_grid(self.A, 0.0, self.h / FLOW_PIECES, FLOW_PIECES + 1)
        if not np.isfinite(flows).all():
            return None
        pushed = absolute_flow(np.eye(n), self.A, self.f, np.array([self.h / FLOW_PIECES]))[1][0]
        size = max(float(pushed.max(initial=0.0)), float(self.V.max(initial=0.0))) or 1.0
        weights = np.vstack([np.tile(pushed, (FLOW_PIECES, 1)) / size, np.full(n, _FORGETTING)])
        q = np.maximum(self.q / self.q.max(), _LEAST_WEIGHT)
        program = _Program(n, p, flows, weights, self.budget)
        constraints = None if self.constraint.is_free() else self._constraints
        L = program.solve(
            (self.C, self.limit), q, 2 * self.V / size, contraction, constraints=constraints
        )
        if L is None or constraints is None:
            return L
        return self.to_z(self.constraint.rounded(self.whole(L)))

    def _constraints(self, zeta: Expression, U: Expression) -> list[Expression]:
        # regions are refused with samples as events
        return diagonal_constraints(self.constraint, (zeta, U), (self.A, self.C), self.S, self.rows)

    @property
    def solvers(self) -> Solvers:
        """Solvers that `gain` calls."""
        return ("HiGHS",) if self.constraint.is_free() else ("CVXPY/Clarabel",)

    def gains(self) -> Iterator[tuple[float, Matrix]]:
        """(contraction, L in z): the narrowest ones first, then those that contract ever faster."""
        for contraction in CONTRACTIONS:
            L = self.gain(contraction)
            if L is None:
                return
            yield contraction, L

    def to_z(self, L: Matrix) -> Matrix:
        """A gain of the plant's coordinates and outputs as one of z."""
        return np.asarray(self.inward @ L * self.rows, dtype=np.float64)

    def whole(self, L: Matrix) -> Matrix:
        """A gain of z in the plant's coordinates."""
        return at_most(self.gain_limit, self.S @ L / self.rows)

    def outward(self, L: Matrix) -> Matrix:
        """L in the plant's coordinates, in few digits where they cost nothing."""
        width, whole = self.width(L), self.constraint.rounded(self.whole(L))
        # a user's constraints are those of the program alone
        for digits in (3, 6, 9) if self.constraint.user is None else ():
            text = [float(f"{x:.{digits}g}") for x in whole.ravel()]
            short = self.constraint.rounded(np.array(text).reshape(whole.shape))
            inner = self.to_z(short)
            if np.all(np.abs(inner) <= self.limit) and self.width(inner) <= width * (1 + 1e-6):
                return short
        return whole


class _Program:
    """Unknowns zeta (n,), U+ and U- (n, p), T_j (n, n) >= zeta_i |X_ji - l_i C X_j| for each j.

    flows: X_j, (k, n, n), the last one over the whole period; weights (k, n): of T_j in the cost.
    """

    def __init__(self, n: int, p: int, flows: Matrix, weights: Matrix, budget: TimeBudget) -> None:
        self.n, self.flows, self.weights = n, flows, weights
        self.budget = budget
        starts = np.cumsum([0, n, n * p, n * p])
        self.U = [starts[1] + np.arange(n * p).reshape(n, p) + sign * n * p for sign in (0, 1)]
        self.T = starts[3] + np.arange(len(flows) * n * n).reshape(len(flows), n, n)
        self.size = int(starts[3]) + self.T.size
        self.entries: list[tuple[Indices, Indices, Matrix]] = []
        self.limits: list[float] = []

    def below(self, columns: Indices, values: Matrix, limits: float | Matrix) -> None:
        """Rows a'x <= limit: columns, values (rows, terms)."""
        first = len(self.limits)
        rows = np.repeat(first + np.arange(len(columns)), columns.shape[1])
        self.entries.append((rows, columns.ravel(), np.broadcast_to(values, columns.shape).ravel()))
        self.limits += np.broadcast_to(limits, len(columns)).tolist()

    def solve(
        self,
        output: tuple[Matrix, Matrix],
        q: Matrix,
        noise: Matrix,
        contraction: float,
        *,
        constraints: Callable[[Expression, Expression], list[Expression]] | None,
    ) -> Matrix | None:
        """L; None without a solution.

        output: C (p, n) and the largest entries of L, (n, p); q, noise: (n,), (p,); constraints:
        of zeta and U = diag(zeta) L, through CVXPY.
        """
        n = self.n
        C, limit = output
        for j, X in enumerate(self.flows):
            self._absolute(j, X, C @ X)
        last = self.T[-1]
        for k in range(n):  # zeta' P + q' <= zeta', column k
            columns = np.concatenate([last[:, k], [k]])[None]
            self.below(columns, np.append(np.ones(n) / contraction, -1.0)[None], -q[k])
        self._limit(limit)
        cost = np.zeros(self.size)
        for u in self.U:
            cost[u] = noise + 1e-9
        cost[self.T] = self.weights[:, None, :]
        rows, columns, values = (np.concatenate(part) for part in zip(*self.entries, strict=True))
        sides = np.full(len(self.limits), -np.inf), np.array(self.limits)
        ends = np.zeros(self.size), np.full(self.size, np.inf)
        x = program_minimum(
            cost, (rows, columns, values), sides, ends,
            constraints=None if constraints is None else partial(self._of_gain, constraints),
            budget=self.budget,
        )  # fmt: skip
        if x is None or not (x[:n] > 0).all():
            return None
        L: Matrix = (x[self.U[0]] - x[self.U[1]]) / x[:n, None]
        return np.clip(L, -limit, limit)

    def _limit(self, limit: Matrix) -> None:
        for i, m in np.ndindex(limit.shape):
            if math.isfinite(limit[i, m]):
                self.below(np.array([[self.U[0][i, m], self.U[1][i, m], i]]),
                           np.array([[1.0, 1.0, -limit[i, m]]]), 0.0)  # fmt: skip

    def _of_gain(
        self, constraints: Callable[[Expression, Expression], list[Expression]], x: Expression
    ) -> list[Expression]:
        return constraints(x[: self.n], x[self.U[0]] - x[self.U[1]])

    def _absolute(self, j: int, X: Matrix, CX: Matrix) -> None:
        n = self.n
        for i in range(n):
            terms = np.concatenate([[i], self.U[0][i], self.U[1][i]])
            columns = np.column_stack([np.tile(terms, (n, 1)), self.T[j, i]])
            signed = np.column_stack([X[i], -CX.T, CX.T])
            for sign in (1.0, -1.0):
                self.below(columns, np.column_stack([sign * signed, -np.ones(n)]), 0.0)
