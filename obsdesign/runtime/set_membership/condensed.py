"""The feasible set of a window as a linear program in few unknowns, in floats.

    z_k = centre_k + Z_k xi,  |xi| <= 1,      y_k - v in a strip:  |residual - H xi| <= V

The unknowns are the start box, then generators of every stage, which contain what its disturbance
may add. A smaller program has disturbances that are constant on parts of a step. Nothing certified
rests on these numbers: multipliers are proposed with them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.enclosure import TINY
from obsdesign.runtime.set_membership.stages import Targets, Window

# what generators may grow by to contain the box beside them
_LONGEST = 0.25
# widths, in parts of what the generators exceed along them, below which emptiness is searched
_NEARLY_EMPTY = 4.0

# (generators (n, columns), the part of each that constant disturbances do not reach) of a stage
Generated = tuple[Matrix, Matrix]


class Condensed(NamedTuple):
    """H (M, R), residual and V (M,): the strips; objective (B, R): Z'l at each place.

    rows (M, 2): stage and output of each strip. excess (R,): the part of each generator by which
    it exceeds what disturbances add that are constant on parts of a step.
    """

    H: Matrix
    residual: Matrix
    V: Matrix
    objective: Matrix
    rows: Indices
    excess: Matrix

    def by_stage(self, mu: Matrix, window: Window) -> Matrix:
        """Multipliers (B, stages, p) of a window from those of its strips, mu (B, M)."""
        placed = np.zeros((len(mu), len(window), len(window.C)))
        placed[:, self.rows[:, 0], self.rows[:, 1]] = mu
        return placed

    @property
    def least(self) -> tuple[Matrix, Matrix, Matrix]:
        """H (M, R), residual, V of the smaller program, the set of which is a feasible part."""
        kept = self.excess < 1.0
        return self.H[:, kept] * (1.0 - self.excess[kept]), self.residual, self.V

    def is_nearly_empty(self, mu: Matrix, opposite: Indices) -> bool:
        """Is a width by multipliers mu (B, M) no more than some times what generators exceed?

        The width over a smaller set is smaller by that excess at least: it is concave in the radii.
        opposite (B,): where the same bound from below is.
        """
        reach = np.abs(self.objective - mu @ self.H)
        upper = reach.sum(axis=1) + mu @ self.residual + np.abs(mu) @ self.V
        less = upper - _NEARLY_EMPTY * (reach @ self.excess)
        return bool((less + less[opposite] < 0.0).any())


def condensed(window: Window, targets: Targets) -> Condensed:
    """The linear program of a window; its set contains the feasible one."""
    T, n = window.drift.shape
    generators = _generators(window)
    ends = np.cumsum([1 + n, *(block.shape[1] for block, _ in generators)])
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
    for k, (block, _) in enumerate(generators):
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
    excess = np.concatenate([np.zeros(n), *(part for _, part in generators)])
    return Condensed(
        H[:, used_columns], residual, 0.5 * (high - low), objective[:, used_columns], rows,
        excess[used_columns],
    )  # fmt: skip


def _generators(window: Window) -> list[Generated]:
    """Generators of every stage that contain what its disturbance adds, then a box.

    The box is left out where the generators, a little longer, contain it too.
    """
    generators = []
    for table, radius in zip(window.tables, window.radius[:, 0, 0], strict=True):
        own = radius[table.units]
        block, box = table.generators * own, table.remainder @ radius
        n, excess = len(block), np.zeros(block.shape[1])
        longer = None if table.cover is None else _longer(table.cover @ box, own[:n])
        if longer is not None:
            block[:, :n] *= longer
            excess[:n] = 1.0 - 1.0 / longer
        elif box.any():
            block = np.hstack([block, np.diag(box)])
            excess = np.concatenate([excess, np.ones(n)])
        generators.append((block, excess))
    return generators


def _longer(needed: Matrix, radius: Matrix) -> Matrix | None:
    """Factors with which generators of such radii contain a box; None if large."""
    if not (needed <= _LONGEST * radius).all():
        return None
    return np.asarray(1.0 + needed / np.where(radius > 0.0, radius, 1.0))
