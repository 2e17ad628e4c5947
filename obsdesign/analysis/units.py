"""Units of a plant's own, in which its entries are of like size: those of a file drop out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

# rounds of least squares in which entries far from all others lose weight
_REWEIGHTED = 8


def own_units(A: Matrix, C: Matrix, D: Matrix) -> tuple[Matrix, float]:
    """(sizes of the states (n,), pace): units that balance A, so that those of x drop out.

    Where A does not tie all states together, C (p, n) and D (n, q) do: what shows the states and
    what drives them. Powers of two.
    """
    from scipy.linalg import matrix_balance

    with np.errstate(all="ignore"):
        start = _even_units(A, C, D)
        moved = A * start / start[:, None]
        if not np.isfinite(moved).all():
            start, moved = np.ones(len(A)), A
        balanced, (sizes, _) = matrix_balance(moved, permute=False, separate=True)
        return np.asarray(start * sizes), float(np.abs(balanced).max(initial=0.0)) or 1.0


def _even_units(A: Matrix, C: Matrix, D: Matrix) -> Matrix:
    """Sizes (n,) that bring the entries of A, C and D to one magnitude each, most of them.

    Sums of magnitudes by reweighted least squares: an entry that is mere rounding counts little.
    Linear in logarithms, so that other units of x, y, d or t move the answer by exactly those.
    Source: Curtis, Reid, On the automatic scaling of matrices for Gaussian elimination (1972).
    """
    (n, q), p = D.shape, len(C)
    rows, values = [], []
    for X, to, since, pace in ((A, 0, 0, 1.0), (C, n, 0, 0.0), (D, 0, n + p, 0.0)):
        for i, j in zip(*np.nonzero(X), strict=True):
            if to + i != since + j:
                row = np.zeros(n + p + q + 1)
                row[[to + i, since + j, -1]] = 1.0, -1.0, pace
                rows.append(row)
                values.append(np.log2(abs(X[i, j])))
    if not rows:
        return np.ones(n)
    table, bits, weights = np.array(rows), np.array(values), np.ones((len(rows), 1))
    for _ in range(_REWEIGHTED):
        found = np.linalg.lstsq(weights * table, weights[:, 0] * bits, rcond=None)[0]
        weights = np.maximum(np.abs(table @ found - bits), 1.0)[:, None] ** -0.5
    relative = np.round(found[:n] - found[0])  # the common factor is free
    return np.asarray(np.exp2(np.clip(relative, -500, 500)))
