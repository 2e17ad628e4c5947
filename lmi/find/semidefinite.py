"""Matrices P_w for finitely many maps: the largest margin, its cones set up here.

    maximise t   subject to   P_s - M_i' P_t M_i >= t I   for every map M_i, from its source
                 node s to its target node t (one node: the common P),
                 P_w >= floor I,   sum tr P_w = nodes * n

Unknowns are svec(P_w) (`lmi.find.conic`) and t. For a negative optimum the multipliers Z_i prove
that no P exists (`lmi.refute.infeasible` checks them). Nothing here is proved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import clarabel
import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.find.conic import maximise_last, smat, svec, triangle
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
    x, z = maximise_last(A, b, cones, tolerance=tolerance, seconds=seconds)
    P = smat(x[:-1].reshape(nodes, size))
    duals = smat(z[: k * size].reshape(k, size))
    margin = float(x[-1]) if np.isfinite(x).all() else -np.inf
    return Solution(P, margin, duals)


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


def congruences(maps: Matrix) -> Matrix:
    """The matrix of P -> M'PM on svec, for each M of (k, n, n)."""
    i, j, weights = triangle(maps.shape[-1])
    first, second = maps[:, :, i], maps[:, :, j]  # M[a, i] and M[b, j] for each entry (i, j)
    products = first[:, i] * second[:, j] + first[:, j] * second[:, i]  # (k, entry of P, entry)
    scale = np.outer(weights, weights) / 2
    result: Matrix = np.swapaxes(products * scale, -1, -2)
    return result
