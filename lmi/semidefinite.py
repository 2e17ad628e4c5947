"""Matrices P_w for finitely many maps: the largest margin, by Clarabel, cones assembled directly.

    maximise t   subject to   gamma^2 P_s - M_i' P_t M_i >= t I   for every map M_i from node t's
                 past to node s (one node: the common P),   P_w >= floor I,   sum tr P_w = nodes * n

Unknowns are svec(P_w) (upper triangle by columns, off-diagonal entries times sqrt 2) and t. For a
negative optimum the multipliers Z_i prove that no P exists (`lmi.infeasible` checks them).
Nothing here is proved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Matrix = NDArray[np.float64]
Indices = NDArray[np.intp]

# P >= floor I under trace n keeps kappa(P) near 1e4, where the solver is at its best. Larger
# ratios are reached by solving again in coordinates where the last P is the identity.
FLOOR = 1e-4


@dataclass(frozen=True)
class Block:
    """gamma^2 P_source - M' P_target M > 0 for each M of maps (k, n, n)."""

    maps: Matrix
    source: int = 0
    target: int = 0
    gamma: float = 1.0


@dataclass(frozen=True)
class Solution:
    """P (nodes, n, n), the margin t, and per block the multipliers Z (k, n, n); all floats."""

    P: Matrix
    margin: float
    multipliers: tuple[Matrix, ...]


def common_matrices(
    blocks: Sequence[Block], nodes: int = 1, floor: float = FLOOR, tolerance: float = 1e-9
) -> Solution:
    """Best matrices for the blocks. A margin of minus infinity: the solver gave no numbers."""
    n = blocks[0].maps.shape[-1]
    size = n * (n + 1) // 2
    counts = [len(block.maps) for block in blocks]
    A, b = _constraints(blocks, nodes, n, floor)
    cones = [clarabel.PSDTriangleConeT(n)] * (sum(counts) + nodes) + [clarabel.ZeroConeT(1)]
    columns = nodes * size + 1
    objective = np.zeros(columns)
    objective[-1] = -1.0
    none = sparse.csc_matrix((columns, columns))
    result = clarabel.DefaultSolver(none, objective, A, b, cones, _settings(tolerance)).solve()
    x, z = np.asarray(result.x), np.asarray(result.z)
    P = smat(x[:-1].reshape(nodes, size))
    duals = smat(z[: sum(counts) * size].reshape(-1, size))
    pieces = np.split(duals, np.cumsum(counts)[:-1])
    margin = float(x[-1]) if np.isfinite(x).all() else -np.inf
    return Solution(P, margin, tuple(pieces))


def _settings(tolerance: float) -> clarabel.DefaultSettings:
    settings = clarabel.DefaultSettings()
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    settings.verbose = False
    settings.max_threads = 1
    settings.presolve_enable = False
    settings.chordal_decomposition_enable = False
    return settings


def _constraints(
    blocks: Sequence[Block], nodes: int, n: int, floor: float
) -> tuple[sparse.csc_matrix, Matrix]:
    """A, b of A x + s = b with s in the cones: map blocks, then P_w >= floor I, then the trace."""
    size, unit = n * (n + 1) // 2, svec(np.eye(n))
    total = sum(len(block.maps) for block in blocks)
    pieces: list[list[tuple[int, Matrix]]] = [[] for _ in range(nodes)]
    row = 0
    for block in blocks:
        count, moved = len(block.maps), congruences(block.maps)
        own = block.gamma**2 * np.eye(size)
        if block.source == block.target:
            pieces[block.source].append((row, (moved - own).reshape(-1, size)))
        else:
            pieces[block.target].append((row, moved.reshape(-1, size)))
            pieces[block.source].append((row, np.tile(-own, (count, 1))))
        row += count * size
    for w in range(nodes):
        pieces[w].append((row + w * size, -np.eye(size)))
        pieces[w].append((row + nodes * size, unit[None]))
    rows = row + nodes * size + 1
    dense = [(first + np.arange(len(part)), part) for node in pieces for first, part in node]
    widths = [len(node) for node in pieces]
    data, indices, pointers = [], [], [0]
    start = 0
    for width in widths:
        node = dense[start : start + width]
        where = np.concatenate([index for index, _ in node])
        order = np.argsort(where, kind="stable")
        data.append(np.concatenate([part for _, part in node])[order].T.reshape(-1))
        indices.append(np.tile(where[order], size))
        pointers += [pointers[-1] + len(where) * (k + 1) for k in range(size)]
        start += width
    data.append(np.tile(unit, total))
    indices.append(np.arange(total * size))
    pointers.append(pointers[-1] + total * size)
    A = sparse.csc_matrix(
        (np.concatenate(data), np.concatenate(indices), np.array(pointers)),
        shape=(rows, nodes * size + 1),
    )
    b = np.zeros(rows)
    b[row : row + nodes * size] = np.tile(-floor * unit, nodes)
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
    moved = first[:, i] * second[:, j] + first[:, j] * second[:, i]  # (k, entry of P, entry)
    scale = np.outer(weights, weights) / 2
    result: Matrix = np.swapaxes(moved * scale, -1, -2)
    return result
