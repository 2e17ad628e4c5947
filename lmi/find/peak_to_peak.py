"""Gains of an observer against bounded disturbances, by a matrix inequality.

    e' = (A - L C) e + (E - L D) d,   |d_k| <= 1

    minimise sum mu   subject to   [ A'P + PA - YC - C'Y' + aP    PE - YD      ]  <= 0,   P >= I
                                   [ *                            -a diag(mu)  ]

with Y = P L: then e'Pe comes to at most sum mu, and |e| to its root. The rate a is given. Source:
Abedor, Nagpal, Poolla, Int. J. Robust Nonlinear Control 6 (1996). Proposals only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import clarabel
import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.find.conic import maximise_last, svec


@dataclass(frozen=True)
class PeakGain:
    """L (n, p), and what |e| comes to at most."""

    L: Matrix
    bound: float


@dataclass(frozen=True)
class DisturbedOutput:
    """A (n, n), C (p, n), E (n, k), D (p, k) of the inequality."""

    A: Matrix
    C: Matrix
    E: Matrix
    D: Matrix


def peak_gain(system: DisturbedOutput, rate: float) -> PeakGain | None:
    """The gain of the least bound for a rate a > 0; None where the solver gives none."""
    n, p = len(system.A), len(system.C)
    count = n * (n + 1) // 2
    width = system.E.shape[1]
    unknowns = count + n * p + width + 1

    def parts(x: Matrix) -> tuple[Matrix, Matrix, Matrix, float]:
        P = np.zeros((n, n))
        P[np.triu_indices(n)] = x[:count]
        P = P + np.triu(P, 1).T
        return P, x[count : count + n * p].reshape(n, p), x[count + n * p : -1], x[-1]

    def decay(x: Matrix) -> Matrix:
        P, Y, mu, _ = parts(x)
        flow = P @ system.A - Y @ system.C
        beside = P @ system.E - Y @ system.D
        return -np.block([
            [flow + flow.T + rate * P, beside], [beside.T, -rate * np.diag(mu)]
        ])  # fmt: skip

    # homogeneous: P >= t I with sum mu = 1 and the largest t
    def size(x: Matrix) -> Matrix:
        P, _, _, t = parts(x)
        return P - t * np.eye(n)

    rows = [_rows(decay, unknowns), _rows(size, unknowns)]
    total = np.zeros((1, unknowns))
    total[0, count + n * p : -1] = 1.0
    A = np.vstack([total, *(-block for block in rows)])
    b = np.zeros(len(A))
    b[0] = 1.0
    cones = [clarabel.ZeroConeT(1), clarabel.PSDTriangleConeT(n + width),
             clarabel.PSDTriangleConeT(n)]  # fmt: skip
    x, _ = maximise_last(A, b, cones)
    if not np.isfinite(x).all() or not x[-1] > 0:
        return None
    P, Y, _, t = parts(x)
    try:
        L: Matrix = np.asarray(np.linalg.solve(P, Y), np.float64)
    except np.linalg.LinAlgError:
        return None
    return PeakGain(L, 1 / math.sqrt(t)) if np.isfinite(L).all() else None


def _rows(block: Callable[[Matrix], Matrix], unknowns: int) -> Matrix:
    """The packed block as a linear map of the unknowns."""
    return np.array([svec(block(unit)) for unit in np.eye(unknowns)]).T
