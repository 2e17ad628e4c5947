"""The feasible set of a window as a linear program in few unknowns, in floats.

    z_k = centre_k + Z_k xi,  |xi| <= 1,      y_k - v in a strip:  |residual - H xi| <= V

The unknowns are the start box, then generators of every stage, which contain what its disturbance
may add. Nothing certified rests on these numbers: multipliers are proposed with them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.enclosure import TINY
from obsdesign.runtime.set_membership.stages import Targets, Window

# what generators may grow by to contain the box beside them
_LONGEST = 0.25


class Condensed(NamedTuple):
    """H (M, R), residual and V (M,): the strips; objective (B, R): Z'l at each place.

    rows (M, 2): stage and output of each strip.
    """

    H: Matrix
    residual: Matrix
    V: Matrix
    objective: Matrix
    rows: Indices


def condensed(window: Window, targets: Targets) -> Condensed:
    """The linear program of a window."""
    T, n = window.drift.shape
    blocks, counts = _generators(window)
    ends = np.cumsum([1 + n, *counts])
    # the middle of the state is the first column
    Z = np.zeros((n, ends[-1]))
    Z[:, 0] = 0.5 * window.start[0] + 0.5 * window.start[1]
    Z[:, 1 : 1 + n] = np.diag(window.start[1] - Z[:, 0])
    objective = np.zeros((len(targets.rows), ends[-1]))
    H = np.zeros((T, len(window.C), ends[-1]))
    kept = set(targets.places.tolist())
    if -1 in kept:
        chosen = targets.places == -1
        objective[chosen] = targets.rows[chosen] @ Z
    for k, block in enumerate(blocks):
        used, end = ends[k], ends[k + 1]
        Z[:, :used] = window.Phi[k] @ Z[:, :used]
        Z[:, 0] += window.drift[k]
        Z[:, used:end] = block
        np.matmul(window.C, Z[:, :end], out=H[k, :, :end])
        if k in kept:
            chosen = targets.places == k
            objective[chosen] = targets.rows[chosen] @ Z
    rows = np.argwhere(window.sampled)
    at = (rows[:, 0], rows[:, 1])
    low, high = window.strips[:, 0][at], window.strips[:, 1][at]
    H, objective = H[at], objective[:, 1:]
    residual = 0.5 * low + 0.5 * high - H[:, 0]
    H = H[:, 1:]
    used_columns = np.flatnonzero(np.abs(H).max(axis=0, initial=0.0) > TINY)
    return Condensed(
        H[:, used_columns], residual, 0.5 * (high - low), objective[:, used_columns], rows
    )


def _generators(window: Window) -> tuple[list[Matrix], list[int]]:
    """Generators of every stage, blocks (n, columns), then a box; their numbers of columns.

    The box is left out where the generators, a little longer, contain it too.
    """
    blocks = []
    for table, radius in zip(window.tables, window.radius[:, 0, 0], strict=True):
        own = radius[table.units]
        block, box = table.generators * own, table.remainder @ radius
        n = len(block)
        longer = None if table.cover is None else _longer(table.cover @ box, own[:n])
        if longer is not None:
            block[:, :n] *= longer
        elif box.any():
            block = np.hstack([block, np.diag(box)])
        blocks.append(block)
    return blocks, [block.shape[1] for block in blocks]


def _longer(needed: Matrix, radius: Matrix) -> Matrix | None:
    """Factors with which generators of such radii contain a box; None if large."""
    if not (needed <= _LONGEST * radius).all():
        return None
    return np.asarray(1.0 + needed / np.where(radius > 0.0, radius, 1.0))
