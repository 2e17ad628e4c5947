"""Tubes on graphs: least fixed points of what the passages make of a bound.

v = (1 + margin) image(v) + added: from zero upward, each round a few evaluations and then the exact
solution for the passages, times and maps that were the active ones.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.bounds.graph_tube import FloatGraph, Graph, Passage, Values
from lmi.time_budget import UNLIMITED, TimeBudget

# relative room above the image of the tube, least first: a proof needs some
_MARGINS = (2e-4, 2e-3, 1e-2)
_ROUNDS, _SWEEPS = 25, 2
# rounds without a positive solution after which a graph is given up
_MOST_UNSTABLE, _JUMP = 12, 8.0
# rounds in which a tube is lowered, and the relative change at which it has settled
_LOWERED, _SETTLED = 8, 1e-3


def proposed_tubes(
    graph: Graph, added: Matrix, budget: TimeBudget = UNLIMITED
) -> Iterator[Matrix]:  # fmt: skip
    """Tubes v (nodes, n) that floats confirm, the narrowest first; none where none was found.

    added (n,) > 0: what every entry has at least, beside what inputs make of it.
    """
    for margin in _MARGINS:
        if (v := _Search(graph.floats, margin, added).fixed_point(budget)) is None:
            return  # more room makes it harder
        yield v


def input_sizes(graph: Graph) -> Matrix:
    """What inputs add to each entry in a few passages, (n,) > 0; 1 where there are none."""
    floats = graph.floats
    v = np.full((len(graph.nodes), graph.n), 1e-300)
    for _ in range(2 * graph.n):
        v = np.maximum(v, floats.image(v))
    size: Matrix = v.max(axis=0)
    largest = float(size.max())
    return np.where(size > 1e-200, size, largest if largest > 1e-200 else 1.0)


class _Search:
    """One margin; added (n,): what every entry has at least."""

    def __init__(self, floats: FloatGraph, margin: float, added: Matrix) -> None:
        self.floats, self.margin, self.added = floats, margin, added
        self.nodes, self.n = len(floats.graph.nodes), len(floats.f)

    def fixed_point(self, budget: TimeBudget) -> Matrix | None:
        """The least fixed point; None where it diverges or is not reached."""
        v, unstable = np.tile(self.added, (self.nodes, 1)), 0
        for _ in range(_ROUNDS):
            for _ in range(_SWEEPS):
                v = self._next(v)
            solved = self._solved(v) if np.isfinite(v).all() else None
            for tube in (v, solved):
                if tube is not None and self._is_tube(tube):
                    return self._lowered(tube, budget)
            unstable = unstable + 1 if solved is None else 0
            # maps that leave u as it is are active below the fixed point, and not far above it
            v = _JUMP * v if solved is None else solved
            if unstable > _MOST_UNSTABLE or budget.remaining() < 0 or not np.isfinite(v).all():
                return None
        return None

    def _lowered(self, v: Matrix, budget: TimeBudget) -> Matrix:
        """A tube below this one: the least for the strategies that are best there, in turns."""
        for _ in range(_LOWERED):
            chosen = self._best(v)
            lower = self._solved(v, chosen)
            for _ in range(_LOWERED):
                if lower is None or self._is_tube(lower):
                    break
                lower = self._solved(lower, chosen)
            if lower is None or not self._is_tube(lower):
                return v
            has_settled = float((lower / v).min()) > 1 - _SETTLED
            v = lower if float(np.log(lower / v).sum()) < 0 else v
            if has_settled or budget.remaining() < 0:
                break
        return v

    def _best(self, v: Matrix) -> Indices:
        """The strategy of each node and entry that bounds it best, (nodes, n)."""
        values = Values(self.floats, v)
        return np.array([np.argmin(values.bounds(node), axis=0) for node in range(self.nodes)])

    def _next(self, v: Matrix) -> Matrix:
        return (1 + self.margin) * self.floats.image(v) + self.added

    def _is_tube(self, v: Matrix) -> bool:
        """Is the image of v below v by half of the margin?"""
        return bool(((1 + self.margin / 2) * self.floats.image(v) <= v).all())

    def _solved(self, v: Matrix, strategies: Indices | None = None) -> Matrix | None:
        """The fixed point of the affine maps that are active at v; None unless it is positive.

        strategies (nodes, n): of each entry, None for those that are best at v.
        """
        size = self.nodes * self.n
        A, b = np.zeros((size, size)), np.tile(self.added, self.nodes)
        evaluated = Values(self.floats, v)
        for node in range(self.nodes):
            values = evaluated.of_strategies(node)
            chosen = np.argmin([each.max(axis=0) for each in values], axis=0)
            chosen = chosen if strategies is None else strategies[node]
            for entry, place in enumerate(chosen.tolist()):
                passage = int(np.argmax(values[place][:, entry]))
                row, constant = self._active(
                    self.floats.graph.nodes[node][place][passage], entry, evaluated
                )
                A[node * self.n + entry] = (1 + self.margin) * row
                b[node * self.n + entry] += (1 + self.margin) * constant
        try:
            solution = np.asarray(np.linalg.solve(np.eye(size) - A, b), dtype=np.float64)
        except np.linalg.LinAlgError:
            return None
        is_usable = np.isfinite(solution).all() and (solution > 0).all()
        return solution.reshape(self.nodes, self.n) if is_usable else None

    def _active(self, passage: Passage, entry: int, values: Values) -> tuple[Matrix, float]:
        """Row and constant of what a passage leads to in an entry, as an affine map of all v."""
        grid, start = self.floats.grid(passage), values.start(passage)
        k = int(np.argmax(grid.flows[:, entry] @ start + grid.pushes[:, entry]))
        factors, constants = self._started(passage, values.v)
        row = (grid.flows[k, entry] @ factors.reshape(self.n, -1)).reshape(-1)
        return row, float(grid.flows[k, entry] @ constants + grid.pushes[k, entry])

    def _started(self, passage: Passage, v: Matrix) -> tuple[Matrix, Matrix]:
        """What a passage starts from as an affine map of all v: (n, nodes, n), (n,)."""
        factor, constant = np.eye(self.n), np.zeros(self.n)
        start = v[passage.source]
        events = () if passage.event is None else self.floats.events[passage.event]
        for stage in events:
            values = np.array([N @ start + k for N, k in stage])
            best = np.argmin(values, axis=0)
            N = np.array([stage[j][0][i] for i, j in enumerate(best)])
            k = np.array([stage[j][1][i] for i, j in enumerate(best)])
            factor, constant, start = N @ factor, N @ constant + k, N @ start + k
        result = np.zeros((self.n, self.nodes, self.n))
        result[:, passage.source] = factor
        if passage.held is not None:
            through = list(passage.through)
            for i in np.flatnonzero(passage.held):
                result[i], constant[i] = 0.0, 0.0
                result[i, through[int(np.argmax(v[through, i]))], i] = 1.0
        return result, constant
