"""Proof of a tube on a graph, in balls: the hypotheses of the theorem of `graph_tube`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.bounds.graph_tube import Graph, Passage, Values
from lmi.bounds.tube import Affine, prove_below
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict, proved, undecided


def prove_graph(
    graph: Graph, tube: Sequence[Sequence[float]], budget: TimeBudget = UNLIMITED
) -> Verdict:
    """Prove that a tube v (nodes, n) is invariant and attracts; undecided otherwise."""
    v = np.asarray(tube, dtype=np.float64)
    if v.shape != (len(graph.nodes), graph.n):
        return undecided(f"the tube must be {len(graph.nodes)}x{graph.n}")
    if not (np.isfinite(v).all() and (v > 0).all()):
        return undecided("the tube is not positive")
    if not all(graph.nodes) or not all(map(all, graph.nodes)):
        return undecided("a strategy without passages bounds nothing")
    with np.errstate(all="ignore"):
        values = Values(graph.floats, v)
    exact_v, steps, count = exact(v), 0, 0
    for node, strategies in enumerate(graph.nodes):
        if out_of_time := budget.ended():
            return undecided("the proof did not come to its end", **out_of_time)
        chosen, below = values.best(node), _NodeProof(graph, exact_v, node)
        for place in np.unique(chosen):
            for passage in strategies[int(place)]:
                verdict = below.proved(passage, chosen == place)
                if verdict.outcome != "proved":
                    return undecided(f"{verdict.evidence['reason']}, at node {node}", node=node)
                steps += verdict.evidence["steps"]
                count += 1
    return proved(method="mean value form in balls", passages=count, steps=steps)


class _NodeProof:
    """Is what passages lead to below v (nodes, n) at a node? In powers of two like v there.

    Many passages of a node share a flow, and with it the exponentials of their proofs.
    """

    def __init__(self, graph: Graph, v: Exact, node: int) -> None:
        self.graph, self.v = graph, v
        self.units = Scaling.like(to_float(v[node]))
        self.rows, self.bound = exact(np.eye(graph.n)), self.units.rows(v[node])
        self.systems: dict[tuple[tuple[bool, ...] | None, int], Affine] = {}

    def proved(self, passage: Passage, entries: NDArray[np.bool_]) -> Verdict:
        """Proved where it is in these entries, else undecided."""
        if passage.unbounded is not None and (entries & passage.unbounded).any():
            return undecided("an entry has no bound")
        start = self.units.rows(self.graph.start(passage, self.v))
        key = (passage.held, passage.flow)
        if key not in self.systems:
            W, f = self.graph.flow(passage)
            self.systems[key] = Affine(self.units.map(W), self.units.rows(f), start)
        system = replace(self.systems[key], start=start)
        rows, bound = self.rows[entries], self.bound[entries]
        return prove_below(system, rows, bound, passage.low, passage.high)
