"""Grids of all edges of a graph, laid end to end: maps at grid points and between.

A cut is one theta of one edge, on the grid or not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.families import Edge, slack_of, transformed_between, worst

Cut = tuple[int, float]  # number of an edge, theta
# identities of F, H and left, range, gamma and number of points -> theta, maps
Grids = dict[tuple[int, int, int, float, float, float, int], tuple[Matrix, Matrix]]

# The least slack between grid points is sought near this many of its lowest points, so closely
_LOOKED, _ZOOMS = 3, 2


@dataclass(frozen=True)
class EdgeGrid:
    """k theta in all, each edge's in a row; maps are divided by the gamma of their edge.

    thetas (k,), maps (k, n, n), owner (k,): the edge of each; starts (edges,): the first of each
    edge; source, target (edges,): the nodes of each edge.
    """

    edges: tuple[Edge, ...]
    thetas: Matrix
    maps: Matrix
    owner: Matrix
    starts: Matrix
    source: Matrix
    target: Matrix

    @staticmethod
    def from_edges(edges: Sequence[Edge], points: int, known: Grids) -> EdgeGrid:
        """At least so many points an edge; what is `known` already is not computed again."""
        pieces = [_grid(edge, points, known) for edge in edges]
        counts = [len(thetas) for thetas, _ in pieces]
        return EdgeGrid(
            tuple(edges),
            np.concatenate([thetas for thetas, _ in pieces]),
            np.concatenate([maps for _, maps in pieces]),
            np.repeat(np.arange(len(edges)), counts),
            np.concatenate([[0], np.cumsum(counts)[:-1]]),
            np.array([edge.source for edge in edges]),
            np.array([edge.target for edge in edges]),
        )

    @property
    def ends(self) -> set[int]:
        """The places of the first and the last theta of every edge."""
        return {*self.starts.tolist(), *(self.starts[1:] - 1).tolist(), len(self.thetas) - 1}

    def cuts(self, places: Sequence[int]) -> list[Cut]:
        """The cuts that stand at these places of the grid."""
        return [(int(self.owner[k]), float(self.thetas[k])) for k in places]

    def maps_of(self, cuts: Sequence[Cut]) -> Matrix:
        """Maps at any theta, on the grid or not, (cuts, n, n)."""
        if len(self.edges) == 1:
            maps = self.edges[0].maps([theta for _, theta in cuts])
            return maps / self.edges[0].gamma
        return np.concatenate(
            [self.edges[edge].maps([theta]) / self.edges[edge].gamma for edge, theta in cuts]
        )

    def nodes_of(self, owner: Matrix) -> tuple[Matrix, Matrix]:
        """Source and target of each of these edges."""
        return self.source[owner], self.target[owner]

    def transformed(self, L: Matrix, maps: Matrix, owner: Matrix) -> Matrix:
        """Maps of these edges in the coordinates L (nodes, n, n)."""
        return transformed_between(L, maps, *self.nodes_of(owner))

    def worst(self, slacks: Matrix, limit: float) -> list[Cut]:
        """Local minima of the slack on the grid (k,) below the limit, worst first."""
        return self.cuts(worst(slacks, limit, self.starts))

    def least_between(self, L: Matrix, slacks: Matrix) -> tuple[Cut, float]:
        """Least slack near the lowest points of the grid: narrow margins hide between points."""
        least: tuple[Cut, float] = self.cuts([0])[0], math.inf
        for k in worst(slacks, math.inf, self.starts)[:_LOOKED]:
            number = int(self.owner[k])
            edge, nodes = self.edges[number], self.nodes_of(np.array([number]))
            near = [j for j in (k - 1, k, k + 1) if self._same_edge(j, number)]
            left, right = self.thetas[near[0]], self.thetas[near[-1]]
            for _ in range(_ZOOMS):
                points = np.linspace(left, right, 9)
                maps = edge.maps(points) / edge.gamma
                values = slack_of(transformed_between(L, maps, *nodes))
                j = int(np.argmin(values))
                left, right = points[max(j - 1, 0)], points[min(j + 1, 8)]
                if values[j] < least[1]:
                    least = (number, float(points[j])), float(values[j])
        return least

    def _same_edge(self, k: int, number: int) -> bool:
        return 0 <= k < len(self.owner) and int(self.owner[k]) == number


def _grid(edge: Edge, points: int, known: Grids) -> tuple[Matrix, Matrix]:
    parts = (id(edge.F), id(edge.H), id(edge.left))
    key = (*parts, edge.low, edge.high, edge.gamma, points)
    if key not in known:
        thetas, maps = edge.grid(points)
        known[key] = thetas, maps if edge.gamma == 1 else maps / edge.gamma
    return known[key]
