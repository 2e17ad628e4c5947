"""A P that the flow itself never lets grow: one exponential settles every later theta.

If F'P + PF < 0 and M(low)' P M(low) < P, then M(theta)' P M(theta) < P for all theta >= low, since
the flow only shrinks the norm. Such a P need not exist, but where modes are far apart it spares the
prover the steps of the fastest one. A proposal; `lmi.prove.common_matrix` decides.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.exponential import expm
from lmi.find.affine import Unknown, best_margin

Matrix = NDArray[np.float64]

# so many units of the fastest mode within the range make steps expensive
_STIFF = 300.0
_CONDITION = 1e6


def is_stiff(F: Matrix, length: float) -> bool:
    """Would a proof by small steps over a range of this length be long?"""
    return bool(np.linalg.norm(F, 2) * length > _STIFF) if np.isfinite(F).all() else False


def propose_dissipative(F: Matrix, H: Matrix, low: float) -> Matrix | None:
    """P for all theta >= low, (n, n) symmetric, or None if the solver finds none."""
    with np.errstate(all="ignore"):
        M = expm(F * low) @ H
    if not np.isfinite(M).all() or np.linalg.eigvals(F).real.max() >= 0:
        return None
    n = len(F)
    # each state in its own time, so that slow ones count as much as fast ones
    pace = np.diag(1.0 / np.sqrt(np.maximum(np.abs(np.diag(F)), 1e-12 * np.abs(F).max())))

    def both(P: Matrix) -> Matrix:
        return np.stack([P - M.T @ P @ M, -pace @ (F.T @ P + P @ F) @ pace])

    found = best_margin([Unknown(n, n, symmetric=True)], both, _CONDITION)
    if found is None or found[1] <= 0:
        return None
    P = found[0][0]
    return (P + P.T) / 2
