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
    counts = [n, *(table.generators.shape[1] + n for table in window.tables)]
    ends = np.cumsum(counts)
    Z = np.zeros((n, ends[-1]))
    centre = 0.5 * window.start[0] + 0.5 * window.start[1]
    Z[:, :n] = np.diag(window.start[1] - centre)
    objective = np.zeros((len(targets.rows), ends[-1]))
    p = len(window.C)
    H = np.zeros((T, p, ends[-1]))
    residual = np.zeros((T, p))
    middle = 0.5 * window.strips[:, 0] + 0.5 * window.strips[:, 1]
    kept = set(targets.places.tolist())
    if -1 in kept:
        chosen = targets.places == -1
        objective[chosen] = targets.rows[chosen] @ Z
    for k, table in enumerate(window.tables):
        used, end = ends[k], ends[k + 1]
        Z[:, :used] = window.Phi[k] @ Z[:, :used]
        radius = window.radius[k, 0, 0]
        inner = used + len(table.units)
        Z[:, used:inner] = table.generators * radius[table.units]
        Z[np.arange(n), np.arange(inner, end)] = table.remainder @ radius
        centre = window.Phi[k] @ centre + window.drift[k]
        if window.sampled[k]:
            H[k] = window.C @ Z
            residual[k] = middle[k] - window.C @ centre
        if k in kept:
            chosen = targets.places == k
            objective[chosen] = targets.rows[chosen] @ Z
    rows = np.argwhere(np.repeat(window.sampled[:, None], p, axis=1))
    V = 0.5 * (window.strips[:, 1] - window.strips[:, 0])
    at = (rows[:, 0], rows[:, 1])
    used_columns = np.flatnonzero(np.abs(H).max(axis=(0, 1)) > TINY)
    return Condensed(H[at][:, used_columns], residual[at], V[at], objective[:, used_columns], rows)
