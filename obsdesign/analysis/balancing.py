"""Diagonal scaling of states and time by powers of two that balances the plant."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix

# rounds of least squares in which entries far from all others lose weight
_REWEIGHTED = 8


def balancing_units(A: Matrix, C: Matrix, D: Matrix) -> tuple[Matrix, float]:
    """Return (sizes of the states (n,), pace): units in which A is balanced.

    Where A does not tie all states together, the outputs C (p, n) and inputs D (n, q) do. Powers of
    two.
    """
    from scipy.linalg import matrix_balance

    with np.errstate(all="ignore"):
        start = _even_units(A, C, D)
        scaled = A * start / start[:, None]
        if not np.isfinite(scaled).all():
            start, scaled = np.ones(len(A)), A
        balanced, (sizes, _) = matrix_balance(scaled, permute=False, separate=True)
        return np.asarray(start * sizes), float(np.abs(balanced).max(initial=0.0)) or 1.0


def _even_units(A: Matrix, C: Matrix, D: Matrix) -> Matrix:
    """Return sizes (n,) that bring most entries of A, C and D to one magnitude each.

    Sums of magnitudes by reweighted least squares: an entry that is mere rounding counts little.
    Linear in logarithms, so that other units of x, y, d or t move the answer by exactly those.
    Source: Curtis, Reid, On the automatic scaling of matrices for Gaussian elimination (1972).
    """
    (n, q), p = D.shape, len(C)
    rows, values = [], []
    for X, to, start, pace in ((A, 0, 0, 1.0), (C, n, 0, 0.0), (D, 0, n + p, 0.0)):
        for i, j in zip(*np.nonzero(X), strict=True):
            if to + i != start + j:
                row = np.zeros(n + p + q + 1)
                row[[to + i, start + j, -1]] = 1.0, -1.0, pace
                rows.append(row)
                values.append(np.log2(abs(X[i, j])))
    if not rows:
        return np.ones(n)
    table, bits, weights = np.array(rows), np.array(values), np.ones((len(rows), 1))
    for _ in range(_REWEIGHTED):
        logarithms = np.linalg.lstsq(weights * table, weights[:, 0] * bits, rcond=None)[0]
        weights = np.maximum(np.abs(table @ logarithms - bits), 1.0)[:, None] ** -0.5
    relative = np.round(logarithms[:n] - logarithms[0])  # the common factor is free
    return np.asarray(np.exp2(np.clip(relative, -500, 500)))
