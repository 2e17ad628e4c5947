"""Recursions along the rows of a record by doubling, and running integrals against kernels."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.impulsive_input.features import kernel_weights

# (a, b, h): the cells between rows a, a + 1, ..., b all have the length h
Run = tuple[int, int, float]


def accumulated(flow: Matrix, forced: Matrix, start: Matrix) -> Matrix:
    """x_j = flow x_{j-1} + forced_j, all j by doubling: x = sum of flow^i forced_{j-i}."""
    x = forced.copy()
    x[0] += flow @ start
    return doubled(flow, x)


def doubled(flow: Matrix, x: Matrix) -> Matrix:
    """x_j + flow x_{j-1} + flow^2 x_{j-2} + ..., in place; x (L, n), or (L, k, n) of rows."""
    power, reach = flow, 1
    while reach < len(x):
        x[reach:] = x[reach:] + x[:-reach] @ power.T
        power, reach = power @ power, 2 * reach
    return x


def running_integrals(runs: list[Run], error: Matrix, lams: Matrix, start: Matrix) -> Matrix:
    """Running integrals at all rows but the first, (L, p, k), from `start` there.

    All lams (k,) decay; error (L + 1, p) is linear between rows.
    """
    sums = np.empty((len(error) - 1, error.shape[1], len(lams)))
    at = start
    for a, b, h in runs:
        newer, older = kernel_weights(lams, h)
        pieces = error[a + 1 : b + 1, :, None] * newer + error[a:b, :, None] * older
        factor, reach = np.exp(lams * h), 1
        pieces[0] += factor * at
        while reach < len(pieces):
            pieces[reach:] = pieces[reach:] + factor * pieces[:-reach]
            factor, reach = factor * factor, 2 * reach
        sums[a:b] = pieces
        at = pieces[-1]
    return sums


def integrals_at(
    t: Matrix, error: Matrix, integrals: Matrix, lams: Matrix, times: Matrix
) -> Matrix:
    """Running integrals at any times of a track, the residual linear between its rows."""
    last = len(t) - 1
    cell = np.clip(np.searchsorted(t, times, side="right") - 1, 0, max(last - 1, 0))
    width = t[np.minimum(cell + 1, last)] - t[cell]
    share = (times - t[cell]) / np.where(width > 0, width, 1.0)
    # a window may end on a row: time stamps are decimal
    share = np.where(np.abs(share) < 1e-6, 0.0, np.where(np.abs(share - 1) < 1e-6, 1.0, share))
    cell = np.where(share == 1, np.minimum(cell + 1, last), cell)
    share = np.where(share == 1, 0.0, share)
    integrals_there = integrals[cell]
    between = np.flatnonzero(share)
    if len(between):
        at, v = cell[between], (share * width)[between]
        newer, older = kernel_weights(lams, v)
        part = share[between][:, None]
        there = error[at] + part * (error[at + 1] - error[at])
        integrals_there[between] = (
            np.exp(lams * v[:, None])[:, None, :] * integrals[at]
            + newer[:, None, :] * there[:, :, None]
            + older[:, None, :] * error[at][:, :, None]
        )
    return integrals_there
