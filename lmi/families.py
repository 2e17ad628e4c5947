"""Dwell-time families theta -> M(theta) = left e^{F theta} H, at many theta at once.

An `Edge` is a family on a range of theta with the condition M(theta)' P_target M(theta) <
gamma^2 P_source. One edge from a node to itself asks for a common P; conditions between different
matrices, several jump maps in one plant, or a decay rate are more edges of the same kind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.exponential import expm, exponential_grid, times

# Grid step times |eigenvalue|: 30 points per turn of M, 15 per turn of the quadratic form in M
_STEP = 0.2
FEWEST = 48
_MOST = 4096
# after this many time constants a mode has decayed below what a margin could notice
_GONE = 14.0


@dataclass(frozen=True)
class Edge:
    """F, H, left: (n, n); theta in [low, high]; high may be infinite when F is Hurwitz."""

    F: Array
    H: Array
    low: float
    high: float
    left: Array | None = None
    source: int = 0
    target: int = 0
    gamma: float = 1.0

    def maps(self, thetas: ArrayLike) -> Array:
        """M(theta) at each theta, (k, n, n)."""
        flows = expm(self.F * np.asarray(thetas, dtype=np.float64)[:, None, None])
        return self._from_flows(flows)

    def with_slopes(self, thetas: ArrayLike) -> tuple[Array, Array]:
        """M and its derivative at each theta, (k, n, n) each."""
        flows = expm(self.F * np.asarray(thetas, dtype=np.float64)[:, None, None])
        return self._from_flows(flows), self._from_flows(self.F @ flows)

    def _from_flows(self, flows: Array) -> Array:
        products = times(flows, self.H)
        return products if self.left is None else self.left @ products

    @property
    def last(self) -> float:
        """The end of the range, or where an infinite one has nothing left to show."""
        return self.high if math.isfinite(self.high) else self.low + horizon(self.F)

    def grid(self, fewest: int = FEWEST) -> tuple[Array, Array]:
        """(theta, M(theta)) on panels of equally spaced points, ends included, at least `fewest`.

        The step resolves the fastest mode that is still alive; decayed modes cost no points.
        """
        thetas, flows = [], []
        for start, step, count in self._panels(fewest):
            thetas.append(start + step * np.arange(count))
            flows.append(exponential_grid(self.F, start, step, count))
        # rounding must not carry the last point beyond the range
        points = np.minimum(np.concatenate(thetas), self.last)
        return points, self._from_flows(np.concatenate(flows))

    def _panels(self, fewest: int) -> list[tuple[float, float, int]]:
        length = self.last - self.low
        if length == 0:
            return [(self.low, 0.0, 1)]
        if not math.isfinite(length) or not np.isfinite(self.F).all():
            return [(self.low, 0.0, 1)]
        modes = np.linalg.eigvals(self.F)
        speed, decay = np.abs(modes), np.maximum(-modes.real, 0.0)
        ends = sorted({*(_GONE / decay[decay > _GONE / length]).tolist(), length})
        panels, start = [], 0.0
        for end in _spaced(ends):
            alive = speed[decay * start < _GONE]
            fastest = float(alive.max(initial=0.0))
            wanted = math.ceil(min((end - start) * fastest / _STEP, _MOST))
            count = max(wanted, math.ceil(fewest * (end - start) / length), 1)
            panels.append((self.low + start, (end - start) / count, count))
            start = end
        first, step, count = panels[-1]
        panels[-1] = (first, step, count + 1)  # the other panels leave their end to the next
        return panels


def _spaced(ends: list[float]) -> list[float]:
    """Panel ends at least a factor two apart; the last is kept."""
    kept = [ends[-1]]
    for end in reversed(ends[:-1]):
        if end < kept[-1] / 2:
            kept.append(end)
    return kept[::-1]


def horizon(F: Array) -> float:
    """A time after which a Hurwitz flow has decayed; some time of its own for another."""
    if not np.isfinite(F).all():
        return math.inf
    modes = np.linalg.eigvals(F)
    abscissa = float(modes.real.max())
    if abscissa < 0:
        return 8.0 / -abscissa
    # modes at rest: a long time in the flow's own unit; in none where nothing moves
    size = float(np.abs(F).max()) or 1.0
    return 8.0 / max(float(np.abs(modes).max()), 1e-6 * size)


def slack(P_source: Array, maps: Array, P_target: Array | None = None) -> Array:
    """1 - |M|^2 in the norms of P_target and P_source: positive where M' P_target M < P_source.

    P: (n, n) positive definite (LinAlgError if not), maps: (k, n, n). Free of the scale of P.
    """
    L = np.linalg.cholesky(P_source)
    return slack_in(L, maps, L if P_target is None else np.linalg.cholesky(P_target))


def slack_in(L: Array, maps: Array, L_target: Array) -> Array:
    """`slack` for P_source = L L', P_target = L_target L_target'."""
    return slack_of(transformed(L, maps, L_target))


def slack_of(N: Array) -> Array:
    """1 - |N|^2 for each N of (k, n, n); minus infinity where it is not finite."""
    gram = np.swapaxes(N, -1, -2) @ N
    finite: Array = np.asarray(np.isfinite(gram).all(axis=(-2, -1)))
    if not finite.all():
        gram = np.where(finite[:, None, None], gram, 0.0)
    values: Array = 1.0 - np.linalg.eigvalsh(gram)[:, -1]
    return np.where(finite, values, -math.inf)


def transformed(L: Array, maps: Array, L_target: Array) -> Array:
    """L_target' M L^-T: the maps in coordinates where both matrices are the identity."""
    right = np.swapaxes(times(maps, np.linalg.inv(L).T), 1, 2)
    return np.swapaxes(times(np.ascontiguousarray(right), L_target), 1, 2)


def transformed_between(L: Array, maps: Array, source: Array, target: Array) -> Array:
    """`transformed` for many nodes.

    L: (nodes, n, n); source, target: (k,), the nodes of each map.
    """
    if len(L) == 1:
        return transformed(L[0], maps, L[0])
    back = np.swapaxes(np.linalg.inv(L), 1, 2)
    between: Array = np.swapaxes(L, 1, 2)[target] @ (maps @ back[source])
    return between


def worst(slacks: Array, limit: float, starts: Array | None = None) -> list[int]:
    """Local minima of the slack below `limit`, ends included, worst first.

    starts: where the points of each edge begin, for the slacks of several edges in a row.
    """
    before = np.concatenate([[math.inf], slacks[:-1]])
    after = np.concatenate([slacks[1:], [math.inf]])
    if starts is not None:
        before[starts] = math.inf
        after[starts[1:] - 1] = math.inf
    minima = np.flatnonzero((slacks <= before) & (slacks < after) & (slacks < limit))
    return sorted(minima.tolist(), key=lambda k: slacks[k])
