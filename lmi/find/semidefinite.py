"""Matrices P_w for finitely many maps: largest margin by Clarabel, cones set up here.

    maximise t   subject to   P_s - M_i' P_t M_i >= t I   for every map M_i, from its source
                 node s to its target node t (one node: the common P),
                 P_w >= floor I,   sum tr P_w = nodes * n

Unknowns are svec(P_w) (upper triangle by columns, off-diagonal entries times sqrt 2) and t. For a
negative optimum the multipliers Z_i prove that no P exists (`lmi.refute.infeasible` checks them).
Nothing here is proved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import clarabel
import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.memory import require_cones

if TYPE_CHECKING:
    from scipy import sparse


# P >= floor I under trace n keeps kappa(P) near 1e4, where the solver is at its best. Larger
# ratios are reached by solving again in coordinates where the last P is the identity.
FLOOR = 1e-4


@dataclass(frozen=True)
class Solution:
    """P (nodes, n, n), the margin t, and the multiplier Z of each map (k, n, n); all floats."""

    P: Matrix
    margin: float
    multipliers: Matrix


def common_matrices(
    maps: Matrix,
    nodes: int = 1,
    source: Indices | None = None,
    target: Indices | None = None,
    *,
    tolerance: float = 1e-9,
    seconds: float = math.inf,
) -> Solution:
    """Best matrices for the maps (k, n, n). A margin of minus infinity: no numbers were found.

    source, target: (k,) node of each map; None where there is one node. A rate gamma belongs into
    the maps: M / gamma. seconds: time for the solver, whose numbers then are what it has got.
    """
    from scipy import sparse  # slow to import, and not every problem needs a solver

    k, n = maps.shape[:2]
    size = n * (n + 1) // 2
    require_cones(
        f"a search for {nodes} matrices of {n} states with {k} maps",
        [n] * (k + nodes),
        "fewer states, or a shorter range of dwell times, are required",
    )
    none = np.zeros(k, dtype=np.intp)
    ends = none if source is None else source, none if target is None else target
    A, b = _constraints(maps, *ends, nodes)
    cones = [clarabel.PSDTriangleConeT(n)] * (k + nodes) + [clarabel.ZeroConeT(1)]
    columns = nodes * size + 1
    objective = np.zeros(columns)
    objective[-1] = -1.0
    empty = sparse.csc_matrix((columns, columns))
    settings = _settings(tolerance, seconds)
    result = clarabel.DefaultSolver(empty, objective, A, b, cones, settings).solve()
    x, z = np.asarray(result.x), np.asarray(result.z)
    P = smat(x[:-1].reshape(nodes, size))
    duals = smat(z[: k * size].reshape(k, size))
    margin = float(x[-1]) if np.isfinite(x).all() else -np.inf
    return Solution(P, margin, duals)


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


def _constraints(
    maps: Matrix, source: Indices, target: Indices, nodes: int
) -> tuple[sparse.csc_matrix, Matrix]:
    """A, b of A x + s = b with s in the cones: the maps, then P_w >= floor I, then the trace."""
    from scipy import sparse

    k, n = maps.shape[:2]
    size, unit = n * (n + 1) // 2, svec(np.eye(n))
    rows, own = (k + nodes) * size + 1, np.eye(size)
    blocks = congruences(maps)
    blocks[source == target] -= own
    data, indices, counts = [], [], []
    for w in range(nodes):
        into, out = np.flatnonzero(target == w), np.flatnonzero((source == w) & (target != w))
        first = np.concatenate([into, out, [k + w]])
        order = np.argsort(first)
        parts = np.concatenate([blocks[into], np.broadcast_to(-own, (len(out) + 1, size, size))])
        where = (first[order, None] * size + np.arange(size)).reshape(-1)
        columns = np.concatenate([parts[order].reshape(-1, size), unit[None]]).T
        kept = columns != 0
        data.append(columns[kept])
        indices.append(np.broadcast_to([*where, rows - 1], columns.shape)[kept])
        counts.append(kept.sum(axis=1))
    data.append(np.tile(unit, k))
    indices.append(np.arange(k * size))
    counts.append(np.array([k * size]))
    pointers = np.concatenate([[0], np.cumsum(np.concatenate(counts))])
    A = sparse.csc_matrix(
        (np.concatenate(data), np.concatenate(indices), pointers), shape=(rows, nodes * size + 1)
    )
    b = np.zeros(rows)
    b[k * size : -1] = np.tile(-FLOOR * unit, nodes)
    b[-1] = nodes * n
    return A, b


@lru_cache(maxsize=64)
def _triangle(n: int) -> tuple[Indices, Indices, Matrix]:
    """Rows, columns and weights of the upper triangle, by columns."""
    columns = np.repeat(np.arange(n), np.arange(1, n + 1))
    rows = np.concatenate([np.arange(j + 1) for j in range(n)])
    weights = np.where(rows == columns, 1.0, np.sqrt(2.0))
    for array in (rows, columns, weights):
        array.setflags(write=False)
    return rows, columns, weights


def svec(S: Matrix) -> Matrix:
    """Scaled upper triangle of symmetric matrices (..., n, n)."""
    rows, columns, weights = _triangle(S.shape[-1])
    packed: Matrix = S[..., rows, columns] * weights
    return packed


def smat(packed: Matrix) -> Matrix:
    """Inverse of svec: symmetric matrices from (..., n (n + 1) / 2)."""
    n = int((np.sqrt(8 * packed.shape[-1] + 1) - 1) / 2)
    rows, columns, weights = _triangle(n)
    S = np.zeros((*packed.shape[:-1], n, n))
    S[..., rows, columns] = packed / weights
    S[..., columns, rows] = packed / weights
    return S


def congruences(maps: Matrix) -> Matrix:
    """The matrix of P -> M'PM on svec, for each M of (k, n, n)."""
    i, j, weights = _triangle(maps.shape[-1])
    first, second = maps[:, :, i], maps[:, :, j]  # M[a, i] and M[b, j] for each entry (i, j)
    products = first[:, i] * second[:, j] + first[:, j] * second[:, i]  # (k, entry of P, entry)
    scale = np.outer(weights, weights) / 2
    result: Matrix = np.swapaxes(products * scale, -1, -2)
    return result
