"""The dwell-time family theta -> M(theta) = e^{F theta} H, at many theta at once.

An `Edge` is a pair of matrices with a range of theta; a condition on it reads
M(theta)' P M(theta) < P. One edge today; conditions between different matrices have several.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmi.exponential import expm, exponential_grid

Matrix = NDArray[np.float64]

_POINTS_PER_PERIOD = 16
_FEWEST, _MOST = 129, 4097


@dataclass(frozen=True)
class Edge:
    """F, H: (n, n); theta in [low, high], high finite (truncate an infinite range first)."""

    F: Matrix
    H: Matrix
    low: float
    high: float

    def maps(self, thetas: Matrix) -> Matrix:
        """M(theta) at each theta, (k, n, n)."""
        return expm(self.F * np.asarray(thetas)[:, None, None]) @ self.H

    def grid(self) -> tuple[Matrix, Matrix]:
        """Equally spaced (theta, M(theta)) that resolve the fastest rotation of the flow."""
        length = self.high - self.low
        fastest = float(np.abs(np.linalg.eigvals(self.F).imag).max(initial=0.0))
        wanted = _POINTS_PER_PERIOD * fastest * length / (2 * math.pi)
        count = 1 if length == 0 else int(np.clip(wanted, _FEWEST, _MOST))
        step = length / max(count - 1, 1)
        thetas: Matrix = self.low + step * np.arange(count, dtype=np.float64)
        return thetas, exponential_grid(self.F, self.low, step, count) @ self.H


def slack(P: Matrix, maps: Matrix) -> Matrix:
    """Smallest eigenvalue of I - N'N with N = L'M L^-T, P = LL': 1 - the P-norm of M, squared.

    P: (n, n) positive definite; maps: (k, n, n). Positive where the inequality holds; free of the
    scale of P.
    """
    L = np.linalg.cholesky(P)
    moved = np.linalg.solve(L, np.swapaxes(L.T @ maps, -1, -2))  # = (L' M L^-T)'
    moved = np.where(np.isfinite(moved), moved, 1e150)
    values: Matrix = 1.0 - np.linalg.norm(moved, ord=2, axis=(-2, -1)) ** 2
    return values


def worst(thetas: Matrix, slacks: Matrix, limit: float) -> list[int]:
    """Local minima of the slack below `limit`, ends included, worst first."""
    padded = np.concatenate([[math.inf], slacks, [math.inf]])
    local = (slacks <= padded[:-2]) & (slacks < padded[2:])
    found = np.flatnonzero(local & (slacks < limit))
    return sorted(found.tolist(), key=lambda k: slacks[k])
