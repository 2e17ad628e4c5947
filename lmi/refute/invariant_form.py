"""A quadratic form that flow and jumps leave alone: where it is not zero, nothing decays.

x' = F x, x+ = H x with F'Q + Q F = 0 and H'Q H = Q (or -Q) for some symmetric Q != 0: |x'Q x| is
constant for every sequence of jumps. (A rotation with any jump that keeps lengths, say.) Decided in
rational numbers; a Stein inequality, which is strict, cannot show it.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Exact, fixed_vector, to_float

LARGEST = 16  # states; the equations have n (n + 1) / 2 unknowns
_NEARLY = 1e-9  # relative singular value above which floats rule a solution out


def invariant_form(F: Exact, H: Exact) -> Matrix | None:
    """Q, (n, n) floats nearest to an exact one, largest entry 1; None if there is none.

    F, H: exact rationals (n, n); None as well for more than `LARGEST` states.
    """
    if len(F) > LARGEST:
        return None
    for sign in (1, -1):
        if not _possible(to_float(F), to_float(H), sign):
            continue
        solution = fixed_vector([_equations(F, H, sign)])
        if solution is not None:
            entries = np.array(solution, dtype=np.float64)
            return _symmetric(entries / np.abs(entries).max(), len(F))
    return None


def _possible(F: Matrix, H: Matrix, sign: int) -> bool:
    """Not ruled out by floats, which are much faster than elimination in rationals."""
    sizes = [max(float(np.abs(X).max()), 1e-300) for X in (F, H)]
    with np.errstate(all="ignore"):
        rows = np.asarray(_equations(F / sizes[0], H, sign), dtype=np.float64)
    if not np.isfinite(rows).all():
        return True
    values = np.linalg.svd(rows, compute_uv=False)
    return bool(values[-1] <= _NEARLY * max(values[0], 1.0))


def _equations(F: Exact | Matrix, H: Exact | Matrix, sign: int) -> Exact:
    """F'Q + Q F and H'Q H - sign Q, on and above the diagonal, for each symmetric unit Q."""
    n = len(F)
    upper = np.triu_indices(n)
    columns = []
    for i, j in zip(*upper, strict=True):
        E = 0 * F
        E[i, j] = E[j, i] = E[i, j] + 1
        columns.append(np.concatenate([(F.T @ E + E @ F)[upper], (H.T @ E @ H - sign * E)[upper]]))
    return np.array(columns).T


def _symmetric(entries: Matrix, n: int) -> Matrix:
    Q = np.zeros((n, n))
    Q[np.triu_indices(n)] = entries
    return Q + np.triu(Q, 1).T
