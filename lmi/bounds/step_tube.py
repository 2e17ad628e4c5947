"""Bounds of positive systems in discrete time on a graph of states of its clocks.

    u+ = T(u)            along an arc: stages, each the least of affine maps N u + k, N, k >= 0

A node is a state of the clocks after a step, v at it a bound of u there; arcs are all that the
clocks allow, each with its kind of step.

Theorem. If v > 0 and T(v at its source) < v at its target for every arc, then every u enters the
tube v and stays, from any size. Proof: let u <= m v, m >= 1. T is monotone, and subhomogeneous, as
the least of affine maps with k >= 0, so that T(u) <= m T(v) <= m (1 - e) v: after the step the
ratio is at most the larger of 1 and (1 - e) m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.bounds.graph_tube import Least
from lmi.verdict import Verdict, proved, undecided


@dataclass(frozen=True)
class StepGraph:
    """Kinds of steps on a graph of nodes; n: entries of u.

    step_maps: the stages of each kind; arcs (arcs, 3): source, kind, target.
    """

    step_maps: tuple[tuple[Least, ...], ...]
    arcs: Indices
    nodes: int
    n: int

    def without_inputs(self) -> StepGraph:
        """The same with k = 0 in all maps."""
        step_maps = tuple(
            tuple(stage.homogeneous() for stage in stages) for stages in self.step_maps
        )
        return StepGraph(step_maps, self.arcs, self.nodes, self.n)

    @cached_property
    def floats(self) -> list[list[list[tuple[Matrix, Matrix]]]]:
        """The stages of each kind of step in floats."""
        return [
            [[(to_float(N), to_float(k)) for N, k in stage.maps] for stage in stages]
            for stages in self.step_maps
        ]

    def values(self, v: Matrix) -> Matrix:
        """What every arc makes of v (nodes, n), in floats: (arcs, n)."""
        result = np.empty((len(self.arcs), self.n))
        for kind, stages in enumerate(self.floats):
            own = self.arcs[:, 1] == kind
            u = v[self.arcs[own, 0]]
            for stage in stages:
                u = np.min([u @ N.T + k for N, k in stage], axis=0)
            result[own] = u
        return result

    def image(self, v: Matrix) -> Matrix:
        """The largest value that arcs lead to, in floats: (nodes, n)."""
        result = np.zeros((self.nodes, self.n))
        np.maximum.at(result, self.arcs[:, 2], self.values(v))
        return result


def prove_steps(graph: StepGraph, values: Sequence[Sequence[float]]) -> Verdict:
    """Prove that a tube v (nodes, n) is invariant and attracts, in rationals; else undecided."""
    v = np.asarray(values, dtype=np.float64)
    if v.shape != (graph.nodes, graph.n):
        return undecided(f"the tube must be {graph.nodes}x{graph.n}")
    if not (np.isfinite(v).all() and (v > 0).all()):
        return undecided("the tube is not positive")
    exact_v, known = exact(v), dict[tuple[int, int], Exact]()
    for source, kind, target in graph.arcs.tolist():
        if (source, kind) not in known:
            u = exact_v[source]
            for stage in graph.step_maps[kind]:
                u = stage(u)
            known[source, kind] = u
        below = known[source, kind] < exact_v[target]
        if not below.all():
            return undecided(
                f"the tube is left by entry {int(np.argmin(below)) + 1} from node {source} to node "
                f"{target}", node=target,
            )  # fmt: skip
    return proved(method="rational arithmetic", arcs=len(graph.arcs))
