"""Bounds of positive systems whose events come at independent times: a tube on a graph.

    u' = W u + f         W Metzler, f >= 0, between events, of one flow or of several
    u+ = T(u)            at an event: stages, each the least of affine maps N u + k, N >= 0, k >= 0

A node stands for a set of instants, v at it for a bound of u there. A `Passage` says that u at a
node is at most what the flow makes of T(v) at another one after a time in [low, high]; a strategy
is a list of passages of which one applies, whichever it is, so that the largest bounds u; where
there are several strategies each of them bounds u, entry by entry.

Theorem. If v > 0 and for every node and entry a strategy has all its passages strictly below v,
then every u enters the tube and stays, from any size. Proof: let m be the largest ratio of u to v
over the times that passages look back at, m >= 1. Flow and events take m v to at most m times what
they make of v (they are monotone, and the least of affine maps with k >= 0 is subhomogeneous), so
that u <= m (1 - e) v now: the ratio is below m, and over the next stretch of such a time at most
the larger of 1 and (1 - e) m.

Held entries of a passage do not flow: they keep the largest v of the nodes that the passage goes
through, which bounds u there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.balls import Exact, to_float
from lmi.arithmetic.exponential import expm
from lmi.families import horizon

# grid step of floats that steer, times the norm of the flow
_STEP = 0.03
_FEWEST, _MOST = 5, 1500


@dataclass(frozen=True)
class Least:
    """u -> the least, entry by entry, of N u + k; exact (n, n), (n,) each."""

    maps: tuple[tuple[Exact, Exact], ...]

    def __call__(self, u: Exact) -> Exact:
        """Its value at an exact u (n,)."""
        values = [N @ u + k for N, k in self.maps]
        return np.array([min(entries) for entries in zip(*values, strict=True)], dtype=object)

    def homogeneous(self) -> Least:
        """The same with k = 0 in all maps."""
        return Least(tuple((N, 0 * k) for N, k in self.maps))


@dataclass(frozen=True)
class Passage:
    """From node `source` through an event, in a time in [low, high].

    event: its place in `Graph.events`, None for none; flow: that of `Graph.flows`.
    held: (n,), which entries do not flow, None: all do; through: nodes whose bounds they keep;
    silent: (n,), entries of which the passage is taken to bound nothing, None: it bounds all that
    flow.
    """

    source: int
    event: int | None
    low: float
    high: float
    held: tuple[bool, ...] | None = None
    through: tuple[int, ...] = ()
    silent: tuple[bool, ...] | None = None
    flow: int = 0

    @property
    def key(self) -> _Flow:
        """What its flow depends on."""
        return self.low, self.high, self.held, self.flow

    @cached_property
    def unbounded(self) -> NDArray[np.bool_] | None:
        """(n,): entries that it bounds nothing of; None for none."""
        masks = [mask for mask in (self.held, self.silent) if mask is not None]
        return np.any(masks, axis=0) if masks else None


Strategy = tuple[Passage, ...]
# low, high, held, flow
_Flow = tuple[float, float, tuple[bool, ...] | None, int]


@dataclass(frozen=True)
class Graph:
    """flows: W (n, n), f (n,) exact; events: stages of each; nodes: strategies of each."""

    flows: tuple[tuple[Exact, Exact], ...]
    events: tuple[tuple[Least, ...], ...]
    nodes: tuple[tuple[Strategy, ...], ...]

    @property
    def n(self) -> int:
        """Number of entries of u."""
        return len(self.flows[0][1])

    def without_inputs(self) -> Graph:
        """The same with f = 0 and k = 0 in all maps."""
        flows = tuple((W, 0 * f) for W, f in self.flows)
        events = tuple(tuple(stage.homogeneous() for stage in stages) for stages in self.events)
        return Graph(flows, events, self.nodes)

    def has_inputs(self) -> bool:
        """Is any f or k other than 0?"""
        maps = (own for stages in self.events for stage in stages for own in stage.maps)
        return any(any(k) for _, k in (*self.flows, *maps))

    def passages(self) -> Iterator[Passage]:
        """Passages of all strategies of all nodes."""
        for strategies in self.nodes:
            for strategy in strategies:
                yield from strategy

    def start(self, passage: Passage, v: Exact) -> Exact:
        """Start of the flow of a passage: the bound that its event makes of v (nodes, n)."""
        start: Exact = v[passage.source]
        for stage in () if passage.event is None else self.events[passage.event]:
            start = stage(start)
        if passage.held is None:
            return start
        kept: Exact = np.where(passage.held, v[list(passage.through)].max(axis=0), start)
        return kept

    def flow(self, passage: Passage) -> tuple[Exact, Exact]:
        """W (n, n) and f (n,) of a passage."""
        W, f = self.flows[passage.flow]
        if passage.held is None:
            return W, f
        held = np.array(passage.held)
        return np.where(held[:, None], W * 0, W), np.where(held, f * 0, f)

    @cached_property
    def floats(self) -> FloatGraph:
        """The same in floats, on grids of times."""
        return FloatGraph(self)


@dataclass(frozen=True)
class Grid:
    """A passage at the times of a grid: u = maps @ [start; 1], (k, n, n + 1)."""

    maps: Matrix

    @property
    def flows(self) -> Matrix:
        """What start is multiplied by, (k, n, n)."""
        return self.maps[:, :, :-1]

    @property
    def pushes(self) -> Matrix:
        """What is added, (k, n)."""
        return self.maps[:, :, -1]

    def largest(self, starts: Matrix) -> Matrix:
        """The largest u of each start over the times, entry by entry; (s, n) each."""
        count, n, _ = self.maps.shape
        columns = np.vstack([starts.T, np.ones(len(starts))])
        # one product: a stack of small ones takes several times as long
        values = self.maps.reshape(-1, n + 1) @ columns
        largest: Matrix = values.reshape(count, n, -1).max(axis=0).T
        return largest


class FloatGraph:
    """A graph in floats; what it says steers searches and proofs, and proves nothing.

    Passages of all strategies of all nodes in one order; groups of those that share a flow.
    """

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.flows = [(to_float(W), to_float(f)) for W, f in graph.flows]
        self.events = [
            [[(to_float(N), to_float(k)) for N, k in stage.maps] for stage in stages]
            for stages in graph.events
        ]
        self.passages = list(graph.passages())
        counts = [len(strategy) for strategies in graph.nodes for strategy in strategies]
        self.of_strategy = np.cumsum([0, *counts])
        self.of_node = np.cumsum([0, *(len(strategies) for strategies in graph.nodes)])
        self.groups: dict[_Flow, list[int]] = {}
        for place, own in enumerate(self.passages):
            self.groups.setdefault(own.key, []).append(place)
        self.unbounded = np.array([
            np.zeros(graph.n, dtype=bool) if own.unbounded is None else own.unbounded
            for own in self.passages
        ])  # fmt: skip
        self._grids: dict[_Flow, Grid] = {}

    def grid(self, key: _Flow) -> Grid:
        """The flow of a passage at times from its lowest to its highest."""
        if key not in self._grids:
            self._grids[key] = self._made(*key)
        return self._grids[key]

    def _made(self, low: float, high: float, held: tuple[bool, ...] | None, flow: int) -> Grid:
        W, f = self.flows[flow]
        n = len(f)
        if math.isinf(high) or float(np.linalg.eigvals(W).real.max()) < 0:
            high = min(high, low + 4 * horizon(W))  # nothing is left to show after it
        if held is not None:
            W, f = np.where(np.array(held)[:, None], 0.0, W), np.where(held, 0.0, f)
        wanted = (high - low) * float(np.abs(W).sum(axis=1).max(initial=0.0)) / _STEP
        count = 1 if high == low else int(np.clip(np.ceil(wanted), _FEWEST, _MOST)) + 1
        Z = np.zeros((n + 1, n + 1))
        Z[:n, :n], Z[:n, n] = W, f
        whole = expm(Z * np.linspace(low, high, count)[:, None, None])
        return Grid(np.ascontiguousarray(whole[:, :n]))

    def image(self, v: Matrix) -> Matrix:
        """What all nodes make of v, (nodes, n)."""
        image: Matrix = np.minimum.reduceat(Values(self, v).bounds, self.of_node[:-1])
        return image


class Values:
    """What the passages of a graph lead to from v (nodes, n).

    largest (passages, n): infinite where a passage bounds nothing; bounds (strategies, n).
    """

    def __init__(self, floats: FloatGraph, v: Matrix) -> None:
        self.floats, self.v = floats, v
        self._after: dict[tuple[int, int | None], Matrix] = {}
        self._widest: dict[tuple[int, ...], Matrix] = {}
        self.largest = np.empty((len(floats.passages), floats.graph.n))
        with np.errstate(over="ignore", invalid="ignore"):  # a flow that grows beyond floats
            for key, places in floats.groups.items():
                starts = np.array([self.start(floats.passages[k]) for k in places])
                if key[1] > 0.0:
                    starts = floats.grid(key).largest(starts)
                self.largest[places] = starts
        self.largest[floats.unbounded | np.isnan(self.largest)] = np.inf
        self.bounds: Matrix = np.maximum.reduceat(self.largest, floats.of_strategy[:-1])

    def start(self, passage: Passage) -> Matrix:
        """What the flow of a passage starts from, (n,)."""
        key = (passage.source, passage.event)
        if key not in self._after:
            start: Matrix = self.v[passage.source]
            for stage in () if passage.event is None else self.floats.events[passage.event]:
                start = np.min([N @ start + k for N, k in stage], axis=0)
            self._after[key] = start
        if passage.held is None:
            return self._after[key]
        if passage.through not in self._widest:
            self._widest[passage.through] = self.v[list(passage.through)].max(axis=0)
        kept: Matrix = np.where(passage.held, self._widest[passage.through], self._after[key])
        return kept

    def best(self, node: int) -> Indices:
        """The strategy of a node that bounds each entry best, (n,)."""
        first, last = self.floats.of_node[node : node + 2]
        best: Indices = np.argmin(self.bounds[first:last], axis=0)
        return best

    def of_strategy(self, node: int, place: int) -> Matrix:
        """What each passage of a strategy of a node leads to, (passages, n)."""
        k = self.floats.of_node[node] + place
        return self.largest[self.floats.of_strategy[k] : self.floats.of_strategy[k + 1]]
