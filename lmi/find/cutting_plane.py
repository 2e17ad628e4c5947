"""Matrices for ranges of theta: solve on a few, look at all, add the worst, repeat.

`propose` looks for one P on one range. `propose_edges` looks for the P of every node of a graph
whose edges carry families of their own: several jump maps in one plant, windows of dwell times.
What comes out is a proposal; `lmi.prove.common_matrix` decides whether it is one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.units import balance
from lmi.families import FEWEST, Edge, slack_of
from lmi.find.edge_grid import Cut, EdgeGrid, Grids
from lmi.find.semidefinite import FLOOR, Solution, common_matrices
from lmi.solvers import Solvers
from lmi.time_budget import UNLIMITED, TimeBudget

_MOST_ROUNDS = 25
_CUTS_PER_ROUND = 4
# Smallest margin, relative to P, that is worth a proof attempt
_LEAST_MARGIN = 1e-10
# On the grid, this part of the margin at the active theta is good enough
_MARGIN_SHARE = 0.3
# Solver tolerances: quick is enough where the margin is a multiple of it away from zero
_QUICK_TOLERANCE, _EXACT_TOLERANCE, _CLEAR_MULTIPLE = 1e-5, 1e-9, 100.0
# With large P a round costs more than a block: these shares of the range join the first round
_LARGE, _SPREAD = 6, (0.1, 0.35)
# Below this margin the least slack is sought between grid points too
_NARROW_MARGIN = 0.005
# Edges of a graph are short: so many points each
_POINTS_PER_EDGE = 16
# Condition numbers of the coordinates, the roots of those of P: rounds move them this far freely,
# and as far as the second only when nothing is found otherwise. Without the first they would drift
# along directions that no map can feel.
_FREE_CONDITION, _LARGEST_CONDITION = 300.0, 1e7


@dataclass(frozen=True)
class Proposal:
    """A P for every node and the theta they were made for; `matrices` None when none were found.

    matrices, coordinates (of the last try; lower triangular): (nodes, n, n). margin: least slack
    seen on the grid, relative to P. multipliers: Z (k, n, n) for each of `thetas` when the solver
    found none; they may prove that none exists. masses: their traces where P is the identity.
    optimum: the solver's last margin, negative where it found that nothing fits. owners: (k,) the
    edges that `thetas` belong to. solvers: of the matrices or multipliers; none of a guess.
    """

    matrices: Array | None
    thetas: tuple[float, ...]
    margin: float
    worst_theta: float
    multipliers: Array | None = field(default=None, repr=False)
    masses: Array | None = field(default=None, repr=False)
    coordinates: Array | None = field(default=None, repr=False)
    optimum: float = math.nan
    owners: tuple[int, ...] = ()
    solvers: Solvers = ()

    @property
    def P(self) -> Array | None:
        """The matrix of the first node: the common P where there is one node."""
        return None if self.matrices is None else self.matrices[0]

    @property
    def L(self) -> Array | None:
        """Coordinates of the first node."""
        return None if self.coordinates is None else self.coordinates[0]


def propose(
    F: Array,
    H: Array,
    low: float,
    high: float,
    seeds: Sequence[float] = (),
    *,
    start: Array | None = None,
    points: int = FEWEST,
    budget: TimeBudget = UNLIMITED,
) -> Proposal:
    """Propose P with M(theta)' P M(theta) < P at every theta of a fine grid.

    Without such a P the proposal holds the theta that forbid it. seeds: theta that must be among
    those solved for; start: a P of a neighbouring problem, whose coordinates the solver then works
    in; points: at least so many theta are looked at. Nothing is found once the budget has ended.
    """
    coordinates = None if start is None else np.linalg.cholesky(start)[None]
    edges = [Edge(F, H, low, high)]
    cuts = [(0, theta) for theta in seeds]
    return propose_edges(edges, 1, cuts, start=coordinates, points=points, budget=budget)


def propose_edges(
    edges: Sequence[Edge],
    nodes: int,
    seeds: Sequence[Cut] = (),
    *,
    start: Array | None = None,
    points: int = _POINTS_PER_EDGE,
    grids: Grids | None = None,
    budget: TimeBudget = UNLIMITED,
) -> Proposal:
    """P_w > 0, w < nodes, with M' P_target M < gamma^2 P_source on every edge, on fine grids.

    start: lower triangular coordinates (nodes, n, n) to begin in. grids: what is kept of the maps
    from one call to the next; calls that share it must share the arrays of their edges too.
    Nothing is found once the budget has ended.
    """
    with np.errstate(all="ignore"):
        grid = EdgeGrid.from_edges(edges, points, {} if grids is None else grids)
        if not np.isfinite(grid.maps).all():
            return _guess(edges[0], nodes, grid.maps.shape[-1])
        return _Search(grid, nodes, budget).run([*seeds], start)


def _guess(edge: Edge, nodes: int, n: int) -> Proposal:
    """Propose the identity where floats overflow: only the prover can decide there."""
    return Proposal(np.tile(np.eye(n), (nodes, 1, 1)), (), -math.inf, edge.low)


@dataclass(frozen=True)
class _Search:
    grid: EdgeGrid
    nodes: int
    budget: TimeBudget

    def run(self, seeds: list[Cut], start: Array | None) -> Proposal:
        """Rounds of the cutting-plane method, each in the coordinates of the last P."""
        scale = np.diag(balance(self.grid.maps))
        L = np.tile(scale, (self.nodes, 1, 1)) if start is None else start
        active, maps = self._first(L, seeds)
        best = self._proposal(None, active, -math.inf, active[0][1])
        tolerance = _QUICK_TOLERANCE
        for _ in range(_MOST_ROUNDS):
            owner = np.array([edge for edge, _ in active])
            transformed, ends = self.grid.transformed(L, maps, owner), self.grid.nodes_of(owner)
            solution = self._solution(transformed, ends, tolerance)
            if (
                tolerance == _QUICK_TOLERANCE
                and abs(solution.margin) < _CLEAR_MULTIPLE * _QUICK_TOLERANCE
            ):
                tolerance = _EXACT_TOLERANCE
                solution = self._solution(transformed, ends, tolerance)
            if self.budget.remaining() < 0:
                return best
            inner = _cholesky(solution.P)
            if inner is None:
                return best
            better = L @ inner
            if solution.margin <= _LEAST_MARGIN:
                if best.matrices is not None or not self._other_coordinates_may_fit(inner, better):
                    return self._none(active, solution, L, better, best)
                L = better
                continue
            best, more = self._judge(better, active, maps, best)
            is_conditioned = np.linalg.cond(better) < _FREE_CONDITION
            L = np.where(is_conditioned[:, None, None], better, L)
            best = replace(best, optimum=solution.margin)
            if not more:
                return best
            active = [*active, *more]
            maps = np.concatenate([maps, self.grid.maps_of(more)])
        return best

    def _solution(
        self, transformed: Array, ends: tuple[Array, Array], tolerance: float
    ) -> Solution:
        return common_matrices(
            transformed, self.nodes, *ends, tolerance=tolerance, seconds=self.budget.remaining()
        )

    def _other_coordinates_may_fit(self, inner: Array, better: Array) -> bool:
        """Nothing fits at the floor of kappa(P): may a P exist in other coordinates?

        Nodes that are short of room are split instead.
        """
        if self.nodes > 1:
            return False
        floored = np.diag(inner[0]).min() ** 2 <= 10 * FLOOR
        return bool(floored and np.linalg.cond(better[0]) <= _LARGEST_CONDITION)

    def _proposal(
        self, L: Array | None, active: list[Cut], margin: float, theta: float
    ) -> Proposal:
        matrices = None if L is None else L @ np.swapaxes(L, 1, 2)
        owners = tuple(edge for edge, _ in active)
        thetas = tuple(theta for _, theta in active)
        return Proposal(matrices, thetas, margin, theta, owners=owners, solvers=("Clarabel",))

    def _first(self, L: Array, seeds: list[Cut]) -> tuple[list[Cut], Array]:
        """The ends of every edge, and what the caller asks for.

        With one edge also the largest map in these coordinates, and where P is large more points.
        """
        grid, thetas, last = self.grid, self.grid.thetas, len(self.grid.thetas) - 1
        chosen = grid.ends
        if len(grid.edges) == 1:
            chosen.add(int(np.argmin(slack_of(grid.transformed(L, grid.maps, grid.owner)))))
        if len(grid.edges) == 1 and L.shape[-1] >= _LARGE:
            span = thetas[-1] - thetas[0]
            chosen |= {
                min(int(np.searchsorted(thetas, thetas[0] + share * span)), last)
                for share in _SPREAD
            }
        places = sorted(chosen)
        active, maps = grid.cuts(places), grid.maps[places]
        known = set(active)
        extra = [cut for cut in dict.fromkeys(seeds) if cut not in known]
        if extra:
            maps = np.concatenate([maps, grid.maps_of(extra)])
        return [*active, *extra], maps

    def _judge(
        self, L: Array, active: list[Cut], maps: Array, best: Proposal
    ) -> tuple[Proposal, list[Cut]]:
        """The better of these P and the best so far, and the theta to add (none: good enough)."""
        grid, looked_at = self.grid, len(self.grid.maps)
        owner = np.concatenate([grid.owner, [edge for edge, _ in active]])
        both = slack_of(grid.transformed(L, np.concatenate([grid.maps, maps]), owner))
        slacks, goal = both[:looked_at], float(both[looked_at:].min())
        k = int(np.argmin(slacks))
        least, (edge, theta) = float(slacks[k]), grid.cuts([k])[0]
        between = grid.least_between(L, slacks) if 0 < least < _NARROW_MARGIN else None
        if between is not None and between[1] < least:
            (edge, theta), least = between
        if least > 0 and least >= best.margin:
            best = self._proposal(L, active, least, theta)
        elif best.matrices is None:
            best = self._proposal(None, active, least, theta)
        if least > 0 and least >= _MARGIN_SHARE * goal:
            return best, []
        known = set(active)
        if between is not None:
            return best, [(edge, theta)] if (edge, theta) not in known else []
        minima = grid.worst(slacks, _MARGIN_SHARE * max(goal, 0.0))
        return best, [cut for cut in self._worst(minima) if cut not in known]

    def _worst(self, cuts: list[Cut]) -> list[Cut]:
        """The worst cuts of one edge, the worst cut of each of many."""
        if len(self.grid.edges) == 1:
            return cuts[:_CUTS_PER_ROUND]
        first: dict[int, Cut] = {}
        for cut in cuts:
            first.setdefault(cut[0], cut)
        return list(first.values())

    def _none(
        self, active: list[Cut], solution: Solution, L: Array, better: Array, best: Proposal
    ) -> Proposal:
        if best.matrices is not None:
            return best
        Z = solution.multipliers
        # inside the cone: the solver's zeros may be slightly negative
        Z = Z + 1e-9 * np.trace(Z.sum(axis=0)) * np.eye(L.shape[-1])
        masses = np.trace(Z, axis1=1, axis2=2)
        back = np.linalg.inv(L)[self.grid.source[[edge for edge, _ in active]]]
        Z = np.swapaxes(back, 1, 2) @ Z @ back
        proposal = self._proposal(None, active, best.margin, best.worst_theta)
        is_conditioned = np.linalg.cond(better) <= _LARGEST_CONDITION
        return replace(
            proposal,
            multipliers=(Z + np.swapaxes(Z, 1, 2)) / 2,
            masses=masses,
            coordinates=np.where(is_conditioned[:, None, None], better, L),
            optimum=solution.margin,
        )


def _cholesky(P: Array) -> Array | None:
    try:
        L: Array = np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        return None
    return L if np.isfinite(L).all() else None
