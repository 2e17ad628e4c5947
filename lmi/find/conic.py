"""Conic programs by Clarabel: its settings, and symmetric matrices as it packs them.

Clarabel packs a symmetric matrix as svec: the upper triangle by columns, off-diagonal entries times
sqrt 2, so that inner products are kept. Nothing here is proved.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import clarabel
import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix

if TYPE_CHECKING:
    from scipy import sparse

TOLERANCE = 1e-8


def maximise_last(
    A: sparse.csc_matrix | Matrix,
    b: Matrix,
    cones: list[object],
    *,
    tolerance: float = TOLERANCE,
    seconds: float = math.inf,
) -> tuple[Matrix, Matrix]:
    """Maximise the last of the unknowns x under A x + s = b, s in the cones.

    A: (rows, unknowns); b: (rows,); cones: of Clarabel, in the order of the rows. tolerance: of the
    gap and of feasibility; seconds: time for the solver. Return x (unknowns,) and the multipliers
    (rows,) as the solver left them, which may hold nan.
    """
    from scipy import sparse  # slow to import, and not every problem needs a solver

    unknowns = A.shape[1]
    objective = np.zeros(unknowns)
    objective[-1] = -1.0
    none, A = sparse.csc_matrix((unknowns, unknowns)), sparse.csc_matrix(A)
    settings = _settings(tolerance, seconds)
    result = clarabel.DefaultSolver(none, objective, A, b, cones, settings).solve()
    return np.asarray(result.x), np.asarray(result.z)


def _settings(tolerance: float, seconds: float) -> clarabel.DefaultSettings:
    settings = clarabel.DefaultSettings()
    if math.isfinite(seconds):
        settings.time_limit = max(seconds, 1e-3)
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    settings.verbose = False
    settings.max_threads = 1
    settings.presolve_enable = False
    settings.chordal_decomposition_enable = False
    return settings


def svec(S: Matrix) -> Matrix:
    """Scaled upper triangle of symmetric matrices: (..., n, n) -> (..., n (n + 1) / 2)."""
    rows, columns, weights = triangle(S.shape[-1])
    packed: Matrix = S[..., rows, columns] * weights
    return packed


def smat(packed: Matrix) -> Matrix:
    """Inverse of svec: symmetric matrices from (..., n (n + 1) / 2)."""
    n = int((np.sqrt(8 * packed.shape[-1] + 1) - 1) / 2)
    rows, columns, weights = triangle(n)
    S = np.zeros((*packed.shape[:-1], n, n))
    S[..., rows, columns] = packed / weights
    S[..., columns, rows] = packed / weights
    return S


@lru_cache(maxsize=64)
def triangle(n: int) -> tuple[Indices, Indices, Matrix]:
    """Rows, columns and weights of the upper triangle, by columns; (n (n + 1) / 2,) each."""
    columns = np.repeat(np.arange(n), np.arange(1, n + 1))
    rows = np.concatenate([np.arange(j + 1) for j in range(n)])
    weights = np.where(rows == columns, 1.0, np.sqrt(2.0))
    for array in (rows, columns, weights):
        array.setflags(write=False)
    return rows, columns, weights
