"""Tubes on graphs: least fixed points of what the passages make of a bound.

v = (1 + margin) image(v) + added: from zero upward, each round a few evaluations and then the exact
solution for the passages, times and maps that were the active ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.bounds.graph_tube import FloatGraph, Graph, Passage, Values
from lmi.time_budget import UNLIMITED, TimeBudget

# a column of all v (nodes, n), and its factor
_Term = tuple[int, float]
# relative room above the image of the tube, least first: a proof needs some
MARGINS = (2e-4, 2e-3, 1e-2)
_ROUNDS, _SWEEPS = 60, 2
# rounds without a positive solution after which a graph is given up
_MOST_UNSTABLE, _JUMP = 12, 8.0
# rounds in which a tube is lowered, and the relative change at which it has settled
_LOWERED, _LEAST_CHANGE = 8, 1e-3


def proposed_tubes(
    graph: Graph, added: Matrix, budget: TimeBudget = UNLIMITED,
    margins: Sequence[float] = MARGINS,
) -> Iterator[Matrix]:  # fmt: skip
    """Tubes v (nodes, n) that floats confirm, the narrowest first; none where none was found.

    added (n,) > 0: what every entry has at least, beside what inputs make of it; margins: relative
    room above the image of the tube, least first: a proof needs some.
    """
    for margin in margins:
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
        self.nodes, self.n = len(floats.graph.nodes), floats.graph.n

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
            has_settled = float((lower / v).min()) > 1 - _LEAST_CHANGE
            v = lower if float(np.log(lower / v).sum()) < 0 else v
            if has_settled or budget.remaining() < 0:
                break
        return v

    def _best(self, v: Matrix) -> Indices:
        """The strategy of each node and entry that bounds it best, (nodes, n)."""
        values = Values(self.floats, v)
        return np.array([values.best(node) for node in range(self.nodes)])

    def _next(self, v: Matrix) -> Matrix:
        return (1 + self.margin) * self.floats.image(v) + self.added

    def _is_tube(self, v: Matrix) -> bool:
        """Is the image of v below v by half of the margin, and v finite?"""
        is_below = (1 + self.margin / 2) * self.floats.image(v) <= v
        return bool((is_below & np.isfinite(v)).all())

    def _solved(self, v: Matrix, strategies: Indices | None = None) -> Matrix | None:
        """The fixed point of the affine maps that are active at v; None unless it is positive.

        strategies (nodes, n): of each entry, None for those that are best at v.
        """
        b, rows = np.tile(self.added, self.nodes), list[list[_Term]]()
        evaluated = Values(self.floats, v)
        for node in range(self.nodes):
            chosen = evaluated.best(node) if strategies is None else strategies[node]
            for entry, place in enumerate(chosen.tolist()):
                passage = int(np.argmax(evaluated.of_strategy(node, place)[:, entry]))
                own = self.floats.graph.nodes[node][place][passage]
                terms, constant = self._active(own, entry, evaluated)
                b[len(rows)] += (1 + self.margin) * constant
                rows.append([(column, (1 + self.margin) * factor) for column, factor in terms])
        solution = _fixed_point(rows, b)
        if solution is None or not (np.isfinite(solution).all() and (solution > 0).all()):
            return None
        return solution.reshape(self.nodes, self.n)

    def _active(self, passage: Passage, entry: int, values: Values) -> tuple[list[_Term], float]:
        """What a passage leads to in an entry, as an affine map of all v: its terms, a constant."""
        grid, start = (
            self.floats.grid(passage.key),
            values.start(passage),
        )
        k = int(np.argmax(grid.flows[:, entry] @ start + grid.pushes[:, entry]))
        flow, constant, n = grid.flows[k, entry], float(grid.pushes[k, entry]), self.n
        terms = list[_Term]()
        if passage.held is not None:
            through = list(passage.through)
            for i in np.flatnonzero(passage.held).tolist():
                largest = through[int(np.argmax(values.v[through, i]))]
                terms.append((largest * n + i, float(flow[i])))
            flow = np.where(passage.held, 0.0, flow)
        factor, added = self._started(passage, values.v)
        terms += zip(range(passage.source * n, passage.source * n + n), flow @ factor, strict=True)
        return terms, constant + float(flow @ added)

    def _started(self, passage: Passage, v: Matrix) -> tuple[Matrix, Matrix]:
        """What events make of v at the source, as an affine map of it: (n, n), (n,)."""
        factor, constant = np.eye(self.n), np.zeros(self.n)
        start = v[passage.source]
        for stage in () if passage.event is None else self.floats.events[passage.event]:
            values = np.array([N @ start + k for N, k in stage])
            best = np.argmin(values, axis=0)
            N = np.array([stage[j][0][i] for i, j in enumerate(best)])
            k = np.array([stage[j][1][i] for i, j in enumerate(best)])
            factor, constant, start = N @ factor, N @ constant + k, N @ start + k
        return factor, constant


def _fixed_point(rows: Sequence[Sequence[_Term]], b: Matrix) -> Matrix | None:
    """x = A x + b for sparse rows of A; None where it has no unique solution."""
    from scipy import sparse  # slow to import, and only several clocks need it
    from scipy.sparse.linalg import splu

    counts = np.cumsum([0, *(len(row) for row in rows)])
    columns = np.array([column for row in rows for column, _ in row])
    factors = np.array([factor for row in rows for _, factor in row])
    A = sparse.csr_array((factors, columns, counts), shape=(len(b), len(b)))
    try:
        solution: Matrix = splu((sparse.eye_array(len(b)) - A).tocsc()).solve(b)
    except RuntimeError:  # singular
        return None
    return solution
