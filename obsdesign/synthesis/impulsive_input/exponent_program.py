"""Exponents that leave time and weight of an impulse least uncertain, by CasADi and IPOPT.

    minimise  log (deviation of time) + log (deviation of weight)       (`NoisyImpulses`)
    over      Lambda
    such that lambda_1 <= lambda_bar (what (15) neglects),  lambda_i - lambda_{i+1} >= spacing

at the age where the exponents of the start evaluate impulses, and with the error of the state that
they leave. Features are whitened by an orthogonalisation of the kernels at nodes of Gauss's rule:
no Gramian is formed. Derivatives are exact. What is found is rated with its own age and error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from lmi.arithmetic.exponential import expm
from lmi.time_budget import TimeBudget
from obsdesign.equations.impulsive_input.deviations import NoisyImpulses, window_nodes

Expression = Any  # SX or MX of CasADi, whose type hints exclude formulas for both
_ITERATIONS = 40  # of IPOPT, from one start
_TOLERANCE = 1e-5  # of the objective, which is a logarithm
_SLACK = 1e-9


@dataclass(frozen=True)
class ExponentProgram:
    """Exponents start_1 > ... > start_m, kept between `fastest` and start_1.

    age: where impulses are evaluated; covariance (n, n): of the error of the state before.
    """

    impulses: NoisyImpulses
    age: float
    covariance: Matrix
    fastest: float

    def solutions(self, starts: list[Matrix], budget: TimeBudget) -> list[Matrix]:
        """Decreasing exponents that IPOPT reaches from each start, where it converges."""
        corner, tau = self.impulses.window.exponents, self.impulses.window.tau
        m, spacing = len(corner), float((-np.diff(corner)).min(initial=math.inf)) * tau
        first, sets = float(corner[0]) * tau, list[Matrix]()
        if budget.remaining() <= 0:
            return sets
        solver = self._solver(budget)
        for start in starts:
            solution = solver(
                x0=start * tau, lbx=self.fastest * tau, ubx=first,
                lbg=spacing * (1 - _SLACK), ubg=math.inf,
            )  # fmt: skip
            if solver.stats()["success"]:
                z = np.asarray(solution["x"], dtype=np.float64).ravel()[:m] / tau
                sets.append(np.minimum(z, corner[0]))
            if budget.remaining() < 0:
                break
        return sets

    def _solver(self, budget: TimeBudget) -> Expression:
        """IPOPT over Lambda tau, with gaps between exponents."""
        import casadi as ca

        m = len(self.impulses.window.exponents)
        z = ca.MX.sym("z", m)
        program = {"x": z, "f": self._cost(ca, z), "g": z[: m - 1] - z[1:]}
        quiet: NewEntries = {
            "ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False,
            "show_eval_warnings": False, "ipopt.tol": _TOLERANCE,
            "ipopt.max_iter": budget.scaled(_ITERATIONS),
        }  # fmt: skip
        if math.isfinite(seconds := budget.remaining()):
            quiet["ipopt.max_cpu_time"] = max(seconds, 0.05)
        return ca.nlpsol("exponents", "ipopt", program, quiet)

    def _cost(self, ca: Expression, z: Expression) -> Expression:
        """Half the logarithms of both variances, up to a constant, for exponents z / tau."""
        window, roots = self.impulses.window, np.sqrt(self.impulses.intensity)
        unit = float(roots.max())
        roots, half = roots / unit, _root(self.covariance) * math.sqrt(window.tau) / unit
        D, C, tau, n = window.D, window.C, window.tau, len(window.D)
        ages, weights = window_nodes(tau, self.age)
        weights = weights / tau
        kernels = ca.exp(ca.DM(ages / tau) @ z.T) * ca.repmat(ca.DM(np.sqrt(weights)), 1, z.numel())
        Q, R = _orthonormal(ca, kernels)
        at_onset = ca.solve(R.T, ca.exp(z * (self.age / tau)))  # the kernels where y may jump
        since = np.maximum(self.age - ages, 0.0)[:, None, None]
        shown = ((ages <= self.age) * np.sqrt(weights))[:, None, None]
        h = (expm(D * since) @ window.H) * shown
        free = expm(D * (tau - ages)[:, None, None]) * np.sqrt(weights)[:, None, None]
        responses = [np.hstack([row @ D @ h, row @ h]) for row in C]
        sizes = np.linalg.norm(np.vstack(responses), axis=0)  # units of time and weight
        V, J, raw = [], [], []
        for row, response, root in zip(C, responses, roots, strict=True):
            V.append(Q.T @ ca.DM((row @ free) @ half / root))
            jump = float(row @ window.H[:, 0]) / (root * sizes[0])
            features = Q.T @ ca.DM(response / (root * sizes))
            J.append(features + ca.horzcat(at_onset * jump, 0 * at_onset))
            raw.append(root * R.T)
        V, J = ca.vertcat(*V), ca.vertcat(*J)
        if self.impulses.weighting == "plain":
            back = ca.diagcat(*raw)
            image = back @ J
            X = ca.solve(image.T @ image, image.T @ back)
            spread = X @ X.T + (X @ V) @ (X @ V).T
        else:
            both = V.T @ J
            spread = ca.inv(J.T @ J - both.T @ ca.solve(ca.DM.eye(n) + V.T @ V, both))
        return 0.5 * (ca.log(spread[0, 0]) + ca.log(spread[1, 1]))


def _orthonormal(ca: Expression, X: Expression) -> tuple[Expression, Expression]:
    """(Q, R) of X by Gram and Schmidt's method, each column twice."""
    columns: list[Expression] = []
    R = []
    for k in range(X.shape[1]):
        column, coefficients = X[:, k], ca.MX(X.shape[1], 1)
        for _ in range(2 if columns else 0):
            Q = ca.horzcat(*columns)
            onto = Q.T @ column
            column = column - Q @ onto
            coefficients[: len(columns)] += onto
        size = ca.norm_2(column)
        coefficients[k] = size
        columns.append(column / size)
        R.append(coefficients)
    return ca.horzcat(*columns), ca.horzcat(*R)


def _root(P: Matrix) -> Matrix:
    """X with X X' = P, for P positive semidefinite."""
    sizes, directions = np.linalg.eigh(P)
    return np.asarray(directions * np.sqrt(np.maximum(sizes, 0.0)))
