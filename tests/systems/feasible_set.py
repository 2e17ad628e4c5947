"""The exact feasible set of a record by linear programming (HiGHS): an oracle for tests.

The disturbance is constant on `pieces` parts of each step, so that the value of the program is a
bound from inside. With its multipliers and the true support function the dual sum is one from
outside: the exact bound lies between both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.base import Sample
from tests.systems.set_membership import Case, flow_integral

_FINE_PIECES = 64


@dataclass(frozen=True)
class Exact:
    """inside, outside (2, n): lower and upper bounds of x; inside None where no state is feasible.

    multipliers: of the strips, (2 n, M).
    """

    inside: Matrix | None
    outside: Matrix


@dataclass
class Program:
    """The feasible set after some rows: x = centre + Z xi, |residual - H xi| <= V."""

    case: Case
    pieces: int

    def __post_init__(self) -> None:
        self.centre = self.case.x0.mean(axis=0)
        self.Z = np.diag((self.case.x0[1] - self.case.x0[0]) / 2)
        self.H = np.zeros((0, self.case.n))
        self.residual, self.V = np.zeros(0), np.zeros(0)
        self.t = 0.0
        # for the walk backwards: (Phi, drift, pieces of the flow or the jump, strip rows)
        self.stages: list[tuple[Matrix, Matrix, Matrix, Matrix | None]] = []
        self._flows: dict[float, tuple[Matrix, Matrix, Matrix, Matrix]] = {}

    def add(self, sample: Sample) -> None:
        """One row: the flow to it, its measurement, its jump."""
        case, h = self.case, sample.t - self.t
        if h > 0:
            Phi, coarse, fine, total = self._flow(h)
            self._map(Phi, total @ case.b[0], coarse, fine)
        if sample.y is not None:
            y = np.asarray(sample.y)
            self.H = np.vstack([self.H, case.C @ self.Z])
            self.residual = np.concatenate([self.residual, y - case.C @ self.centre])
            self.V = np.concatenate([self.V, case.V])
            self.stages.append((np.eye(case.n), np.zeros(case.n), np.zeros((case.n, 0)), y))
        if sample.jump:
            columns = np.diag(case.c[1])
            self._map(case.G, case.c[0], columns, columns)
        self.t = sample.t

    def bounds(self, directions: Matrix | None = None) -> Exact:
        """Bounds of l'x now, l a row of `directions` (default: the states)."""
        rows = np.eye(self.case.n) if directions is None else directions
        ends = [self._bound(sign * row) for sign in (-1.0, 1.0) for row in rows]
        outside = np.reshape([end[1] for end in ends], (2, -1))
        outside[0] *= -1
        if any(end[0] is None for end in ends):
            return Exact(None, outside)
        inside = np.reshape([end[0] for end in ends], (2, -1))
        inside[0] *= -1
        return Exact(inside, outside)

    def is_empty(self) -> bool:
        """Is no state possible, with disturbances constant on the pieces?"""
        return self._bound(np.eye(self.case.n)[0])[0] is None

    def value(self, row: Matrix, mu: Matrix) -> float:
        """The dual sum for multipliers mu (M,): an upper bound of l'x."""
        p, total, last = row, 0.0, len(mu)
        p_outputs = len(self.case.C)
        for Phi, drift, columns, y in reversed(self.stages):
            if y is None:
                total += float(p @ drift + np.abs(p @ columns).sum())
                p = p @ Phi
                continue
            m = mu[last - p_outputs : last]
            total += float(m @ y + np.abs(m) @ self.case.V)
            p, last = p - m @ self.case.C, last - p_outputs
        low, high = self.case.x0
        return float(total + np.maximum(p * low, p * high).sum())

    def _bound(self, row: Matrix) -> tuple[float | None, float]:
        g = row @ self.Z
        if not len(self.H):
            value = float(row @ self.centre + np.abs(g).sum())
            return value, self.value(row, np.zeros(0))
        scale = self.V + np.abs(self.H).sum(axis=1)
        H, b = self.H / scale[:, None], np.array([self.residual + self.V, self.V - self.residual])
        b = b / scale
        size = np.abs(g).sum()
        result = linprog(
            -g / size, A_ub=np.vstack([H, -H]), b_ub=b.reshape(-1), bounds=(-1, 1), method="highs"
        )
        if result.status != 0:
            return None, np.inf
        dual = np.asarray(result.ineqlin.marginals) * size
        M = len(H)
        mu = (-dual[:M] + dual[M:]) / scale
        return float(row @ self.centre - result.fun * size), self.value(row, mu)

    def _map(self, Phi: Matrix, drift: Matrix, coarse: Matrix, fine: Matrix) -> None:
        self.centre = Phi @ self.centre + drift
        self.Z = np.hstack([Phi @ self.Z, coarse])
        self.H = np.hstack([self.H, np.zeros((len(self.H), coarse.shape[1]))])
        self.stages.append((Phi, drift, fine, None))

    def _flow(self, h: float) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        key = round(h, 9)
        if key not in self._flows:
            radius = np.diag(self.case.b[1])[:, self.case.b[1] > 0]
            blocks = []
            for count in (self.pieces, _FINE_PIECES):
                step, integral = flow_integral(self.case.A, h / count)
                part, parts = integral @ radius, []
                for _ in range(count):
                    parts.append(part)
                    part = step @ part
                blocks.append(np.hstack(parts))
            Phi, total = flow_integral(self.case.A, h)
            self._flows[key] = (Phi, blocks[0], blocks[1], total)
        return self._flows[key]


def exact_bounds(case: Case, samples: Sequence[Sample], pieces: int, first: int) -> list[Exact]:
    """Bounds after each row from row `first` on."""
    program, result = Program(case, pieces), []
    for k, sample in enumerate(samples):
        program.add(sample)
        if k >= first:
            result.append(program.bounds())
    return result
