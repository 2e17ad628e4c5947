"""Linear programs on a nominal pattern: multipliers, and trajectories that no sample shows.

In floats: what comes out is proposed, and proved from the design file alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.find.linear_program import minimise
from obsdesign.equations.set_membership.nominal import StepMap
from obsdesign.equations.set_membership.pattern import Step

# simplex steps after which a search for a trajectory ends without one: a shorter one serves
_MOST_ITERATIONS = 3000
# of a scaled row: multipliers that cost less are not resolved by the solver's tolerance
_LEAST_NOISE = 1e-9


@dataclass(frozen=True)
class Reach:
    """The state after some steps as columns of unit size, Z (n, R); H (M, R): at the samples.

    rows (M, 2): step and output of each sample.
    """

    Z: Matrix
    H: Matrix
    rows: Matrix

    @property
    def work(self) -> int:
        """Work of a linear program, in multiplications of a simplex step for each sample."""
        return int(self.H.size * len(self.H))


def reach_of(
    steps: Sequence[Step], maps: dict[Step, StepMap], C: Matrix, start: Matrix
) -> Reach:  # fmt: skip
    """All columns of a window: the start (n, k) first, then the generators of every step."""
    n, p = len(C[0]), len(C)
    counts = np.cumsum([start.shape[1], *(maps[step].generators.shape[1] for step in steps)])
    Z = np.zeros((n, counts[-1]))
    Z[:, : counts[0]] = start
    H, rows = [np.zeros((0, counts[-1]))], [np.zeros((0, 2), dtype=int)]
    for k, step in enumerate(steps):
        used, end = counts[k], counts[k + 1]
        Z[:, :used] = maps[step].Phi @ Z[:, :used]
        Z[:, used:end] = maps[step].generators
        if step.sampled:
            H.append(C @ Z)
            rows.append(np.column_stack([np.full(p, k), np.arange(p)]))
    return Reach(Z, np.vstack(H), np.vstack(rows))


def multipliers(reach: Reach, V: Matrix, steps: int, i: int) -> Matrix | None:
    """mu (steps, p) of the least |Z'l - H'mu|_1 + |mu|'V for l = e_i; None if none is found."""
    g, (M, R) = reach.Z[i], reach.H.shape
    mu = np.zeros((steps, len(V)))
    size = np.abs(g).sum()
    if M == 0 or size == 0:
        return mu
    scale = np.abs(reach.H).sum(axis=1) + V[reach.rows[:, 1]]
    scale[scale == 0] = 1.0  # an output of nothing, without noise
    H, noise = reach.H / scale[:, None], np.maximum(V[reach.rows[:, 1]] / scale, _LEAST_NOISE)
    # mu = mu+ - mu-, H'mu + a - b = g with a, b >= 0
    eye = np.eye(R)
    rows = np.hstack([H.T, -H.T, eye, -eye])
    cost = np.concatenate([noise, noise, np.ones(2 * R)])
    low, high = np.zeros(len(cost)), np.full(len(cost), np.inf)
    x = minimise(cost, rows, (g / size, g / size), (low, high))
    if x is None:
        return None
    mu[reach.rows[:, 0], reach.rows[:, 1]] = (x[:M] - x[M : 2 * M]) * size / scale
    return mu


def hidden_trajectory(reach: Reach, V: Matrix, i: int) -> Matrix | None:
    """xi (R,) of the largest state i at the end with |H xi| <= V and |xi| <= 1; None if none."""
    g, M = reach.Z[i], len(reach.H)
    size = np.abs(g).sum()
    if size == 0:
        return np.zeros(len(g))
    noise = V[reach.rows[:, 1]]
    scale = np.abs(reach.H).sum(axis=1) + noise
    scale[scale == 0] = 1.0
    ones = np.ones(len(g))
    sides = (-noise / scale, noise / scale) if M else (noise, noise)
    rows = reach.H / scale[:, None]
    x = minimise(-g / size, rows, sides, (-ones, ones), iterations=_MOST_ITERATIONS)
    return None if x is None else _unnoticed(reach.H, noise, np.clip(x, -1.0, 1.0))


def _unnoticed(H: Matrix, noise: Matrix, xi: Matrix) -> Matrix:
    """A trajectory near xi, |xi| <= 1, which leaves |H xi| <= noise by rounding alone.

    The solver's tolerance may be large beside the noise.
    """
    free = np.abs(xi) < 1.0
    y = H @ xi
    excess = y - np.clip(y, -noise, noise)
    if not excess.any() or not free.any():
        return xi
    near = xi.copy()
    near[free] -= np.linalg.lstsq(H[:, free], excess, rcond=None)[0]
    return near / max(1.0, float(np.abs(near).max()))
