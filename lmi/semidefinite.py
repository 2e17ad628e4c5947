"""P for finitely many maps: the largest margin, by Clarabel, with the cones assembled directly.

    maximise g   subject to   P - M_i' P M_i >= g I  for every i,   I <= P <= kappa I,   g <= 1

Unknowns are svec(P) (upper triangle by columns, off-diagonal entries times sqrt 2) and g.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class Solution:
    """P (n, n) symmetric and the margin g that the solver reports; nothing here is proved."""

    P: Matrix
    margin: float


def common_matrix(maps: Matrix, kappa: float) -> Solution | None:
    """Best P for the maps (k, n, n), or None when the solver gives no usable numbers."""
    n = maps.shape[-1]
    D, size = _basis(n)
    blocks = [np.hstack([-(np.eye(size) - _congruence(M, D)), _svec_identity(n)[:, None]])
              for M in maps]  # fmt: skip
    bounds = [
        np.hstack([-np.eye(size), np.zeros((size, 1))]),
        np.hstack([np.eye(size), np.zeros((size, 1))]),
    ]
    last = np.zeros((1, size + 1))
    last[0, -1] = 1.0
    A = sparse.csc_matrix(np.vstack([*blocks, *bounds, last]))
    unit = _svec_identity(n)
    b = np.concatenate([np.zeros(size * len(blocks)), -unit, kappa * unit, [1.0]])
    cones = [clarabel.PSDTriangleConeT(n)] * (len(blocks) + 2) + [clarabel.NonnegativeConeT(1)]
    objective = np.zeros(size + 1)
    objective[-1] = -1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix((size + 1, size + 1)), objective, A, b, cones, settings
    )
    x = np.array(solver.solve().x)
    if not np.isfinite(x).all():
        return None
    P = (D @ x[:-1]).reshape(n, n)
    return Solution((P + P.T) / 2, float(x[-1]))


def _congruence(M: Matrix, D: Matrix) -> Matrix:
    """Matrix of P -> M'PM on svec."""
    return D.T @ np.kron(M.T, M.T) @ D


@lru_cache(maxsize=32)
def _basis(n: int) -> tuple[Matrix, int]:
    """Orthonormal D with vec(P) = D svec(P)."""
    columns = []
    for j in range(n):
        for i in range(j + 1):
            E = np.zeros((n, n))
            E[i, j] = E[j, i] = 1.0 if i == j else np.sqrt(0.5)
            columns.append(E.reshape(-1))
    D = np.array(columns).T
    D.setflags(write=False)
    return D, D.shape[1]


def _svec_identity(n: int) -> Matrix:
    D, _ = _basis(n)
    unit: Matrix = D.T @ np.eye(n).reshape(-1)
    return unit
