"""Exponents that leave time and weight of an impulse least uncertain, by CasADi and IPOPT.

    minimise  log (deviation of time) + log (deviation of weight)       (`NoisyImpulses`)
    over      Lambda
    such that lambda_1 <= lambda_bar (what (15) neglects),  lambda_i - lambda_{i+1} >= spacing

at the age where the exponents of the start evaluate impulses, and with the error of the state that
they leave; noise enters directly and through K. Features are whitened by an orthogonalisation of
the kernels at nodes of Gauss's rule: no Gramian is formed. Derivatives are exact. What is found is
rated with its own age and error.
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
        D, C, tau = window.D, window.C, window.tau
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
        residual = _residual_noise(self.impulses, ages, weights * tau)
        V, J, raw, noise = [], [], [], []
        for row, response, root, shown in zip(C, responses, roots, residual, strict=True):
            V.append(Q.T @ ca.DM((row @ free) @ half / root))
            jump = float(row @ window.H[:, 0]) / (root * sizes[0])
            features = Q.T @ ca.DM(response / (root * sizes))
            J.append(features + ca.horzcat(at_onset * jump, 0 * at_onset))
            raw.append(root * R.T)
            noise.append(ca.DM(shown).T @ Q)
        V, J, noise = ca.vertcat(*V), ca.vertcat(*J), ca.horzcat(*noise)
        covariance = noise.T @ noise + V @ V.T
        if self.impulses.weighting == "plain":
            back = ca.diagcat(*raw)
            image = back @ J
            X = ca.solve(image.T @ image, image.T @ back)
            spread = X @ covariance @ X.T
        else:
            spread = ca.inv(J.T @ ca.solve(covariance, J))
        return 0.5 * (ca.log(spread[0, 0]) + ca.log(spread[1, 1]))


def _residual_noise(impulses: NoisyImpulses, ages: Matrix, weights: Matrix) -> Matrix:
    """Residuals at nodes, (p, nodes, nodes p), of unit noise at nodes: direct, and through K.

    Both are times the root of the node's weight, residuals in units of their own noise. What noise
    of an age makes of the residual jumps there: a node's own counts half.
    """
    (p, n), count, roots = impulses.window.C.shape, len(ages), np.sqrt(impulses.intensity)
    since = ages - ages[:, None]
    flows = expm(impulses.window.D * np.maximum(since, 0.0).reshape(-1, 1, 1))
    through = (impulses.window.C @ flows.reshape(-1, n, n) @ impulses.K) * roots / roots[:, None]
    share = np.where(since > 0, 1.0, np.where(since == 0, 0.5, 0.0))
    share *= np.sqrt(weights * weights[:, None])
    noise = -through.reshape(count, count, p, p) * share[:, :, None, None]
    noise[np.arange(count), np.arange(count)] += np.eye(p)
    return np.asarray(noise.transpose(2, 0, 1, 3).reshape(p, count, count * p))


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
