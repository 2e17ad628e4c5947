"""Matrix exponentials in floating point, numpy only: one matrix, stacks, grids, integrals.

Scaling and squaring of Pade approximants: N. J. Higham, The scaling and squaring method for the
matrix exponential revisited, SIAM J. Matrix Anal. Appl. 26 (2005).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Matrix = NDArray[np.float64]

# numerator coefficients of the [13/13] Pade approximant of exp, and the 1-norm up to which its
# backward error stays below the unit roundoff (Higham, Table 2.3)
_PADE = (
    64764752532480000.0, 32382376266240000.0, 7771770303897600.0, 1187353796428800.0,
    129060195264000.0, 10559470521600.0, 670442572800.0, 33522128640.0, 1323241920.0,
    40840800.0, 960960.0, 16380.0, 182.0, 1.0,
)  # fmt: skip
_THETA = 5.371920351148152


def expm(A: ArrayLike) -> Matrix:
    """e^A for a square matrix or a stack of them, (..., n, n).

    Overflow gives infinities or NaN, never a finite wrong answer.
    """
    X = np.asarray(A, dtype=np.float64)
    n = X.shape[-1]
    if n == 0 or X.size == 0:
        return X.copy()
    norms = np.abs(X).sum(axis=-2).max(axis=-1)
    if not np.isfinite(norms).all():
        return np.full_like(X, np.nan)
    largest = float(norms.max())
    squarings = max(0, int(np.ceil(np.log2(largest / _THETA)))) if largest > 0 else 0
    if squarings > 1000:
        return np.full_like(X, np.nan)
    result = _pade(X * 2.0**-squarings)
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(squarings):
            result = result @ result
    return result


def _pade(X: Matrix) -> Matrix:
    b, identity = _PADE, np.eye(X.shape[-1])
    X2 = X @ X
    X4 = X2 @ X2
    X6 = X4 @ X2
    odd = X @ (
        X6 @ (b[13] * X6 + b[11] * X4 + b[9] * X2)
        + b[7] * X6 + b[5] * X4 + b[3] * X2 + b[1] * identity
    )  # fmt: skip
    even = (
        X6 @ (b[12] * X6 + b[10] * X4 + b[8] * X2)
        + b[6] * X6 + b[4] * X4 + b[2] * X2 + b[0] * identity
    )  # fmt: skip
    return np.asarray(np.linalg.solve(even - odd, even + odd), dtype=np.float64)


def exponential_grid(F: ArrayLike, start: float, step: float, count: int) -> Matrix:
    """All e^{F (start + k step)}, k = 0..count-1, as (count, n, n); by doubling."""
    F = np.asarray(F, dtype=np.float64)
    grid = np.empty((count, *F.shape))
    if count == 0:
        return grid
    grid[0] = expm(F * start)
    power, filled = expm(F * step), 1
    with np.errstate(over="ignore", invalid="ignore"):
        while filled < count:
            more = min(filled, count - filled)
            grid[filled : filled + more] = grid[:more] @ power
            power, filled = power @ power, filled + more
    return grid


def flow_integrals(A: ArrayLike, h: float) -> tuple[Matrix, Matrix]:
    """(e^{A h}, int_0^h e^{A s} ds) from one block exponential; A may be singular."""
    A = np.asarray(A, dtype=np.float64)
    n = len(A)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:] = A, np.eye(n)
    whole = expm(block * h)
    return whole[:n, :n], whole[:n, n:]
