"""Matrices for ranges of theta: solve on a few, look at all, add the worst, repeat.

What comes out is a proposal; `lmi.proof` decides whether it is one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.families import FEWEST, Edge, balance, moved, slack_in, worst
from lmi.semidefinite import FLOOR, Block, Solution, common_matrices

Matrix = NDArray[Any]

_ROUNDS = 25
_ADDED = 4
# Smallest margin, relative to P, that is worth a proof attempt
_LEAST = 1e-10
# On the grid, this part of the margin at the active theta is good enough
_ENOUGH = 0.3
# Solver tolerances: quick is enough where the margin is a multiple of it away from zero
_QUICK, _EXACT, _CLEAR = 1e-5, 1e-9, 100.0
# With large P a round costs more than a block: these shares of the range join the first round
_LARGE, _SPREAD = 6, (0.1, 0.35)
# Below this margin the least slack is sought between grid points too, near this many of them
_NARROW, _LOOKED, _ZOOMS = 0.005, 3, 2
# Condition numbers of the coordinates, the roots of those of P: rounds move them this far freely,
# and as far as the second only when nothing is found otherwise. Without the first they would drift
# along directions that no map can feel.
_MODERATE, _LARGEST_CONDITION = 300.0, 1e7


@dataclass(frozen=True)
class Proposal:
    """P and the theta it was made for; P is None when none was found.

    margin: least slack seen on the grid, relative to P. multipliers: Z (n, n) for each of `thetas`
    when the solver found none; they may prove that none exists. L: coordinates of the last try.
    optimum: the solver's last margin, negative where it found that no P fits.
    """

    P: Matrix | None
    thetas: tuple[float, ...]
    margin: float
    worst_theta: float
    multipliers: Matrix | None = field(default=None, repr=False)
    L: Matrix | None = field(default=None, repr=False)
    optimum: float = math.nan


def propose(
    F: Matrix,
    H: Matrix,
    low: float,
    high: float,
    seeds: Sequence[float] = (),
    start: Matrix | None = None,
    points: int = FEWEST,
) -> Proposal:
    """P with M(theta)' P M(theta) < P at every theta of a fine grid, or the theta that forbid it.

    seeds: theta that must be among those solved for; start: a P of a neighbouring problem, whose
    coordinates the solver then works in; points: at least so many theta are looked at.
    """
    edge = Edge(F, H, low, high)
    with np.errstate(all="ignore"):
        thetas, maps = edge.grid(points)
        if not np.isfinite(maps).all():
            return _guess(edge)
        return _Search(edge, thetas, maps).run([*seeds], start)


def _guess(edge: Edge) -> Proposal:
    """Where floats overflow, only the prover can tell; the identity is worth its try."""
    return Proposal(np.eye(len(edge.F)), (), -math.inf, edge.low)


@dataclass(frozen=True)
class _Search:
    edge: Edge
    thetas: Matrix
    maps: Matrix

    def run(self, seeds: list[float], start: Matrix | None) -> Proposal:
        """Rounds of the cutting-plane method, each in the coordinates of the last P."""
        L = np.diag(balance(self.maps)) if start is None else np.linalg.cholesky(start)
        active, maps = self._first(L, seeds)
        best = Proposal(None, tuple(active), -math.inf, active[0])
        tolerance = _QUICK
        for _ in range(_ROUNDS):
            blocks = [Block(moved(L, maps, L))]
            solution = common_matrices(blocks, tolerance=tolerance)
            if tolerance == _QUICK and abs(solution.margin) < _CLEAR * _QUICK:
                tolerance = _EXACT
                solution = common_matrices(blocks, tolerance=tolerance)
            inner = _cholesky(solution.P[0])
            if inner is None:
                return best
            better = L @ inner
            if solution.margin <= _LEAST:
                # at the floor of kappa(P) other coordinates may still allow one; else nothing will
                hopeless = best.P is not None or np.diag(inner).min() ** 2 > 10 * FLOOR
                if hopeless or np.linalg.cond(better) > _LARGEST_CONDITION:
                    return self._none(active, solution, L, best)
                L = better
                continue
            best, more = self._judge(better, active, maps, best)
            if np.linalg.cond(better) < _MODERATE:
                L = better
            best = replace(best, optimum=solution.margin)
            if not more:
                return best
            active = [*active, *more]
            maps = np.concatenate([maps, self.edge.maps(more)])
        return best

    def _first(self, L: Matrix, seeds: list[float]) -> tuple[list[float], Matrix]:
        """The ends, the largest map in these coordinates, and what the caller asks for."""
        last = len(self.thetas) - 1
        chosen = {0, last, int(np.argmin(slack_in(L, self.maps, L)))}
        if len(L) >= _LARGE:
            span = self.thetas[-1] - self.thetas[0]
            chosen |= {
                min(int(np.searchsorted(self.thetas, self.thetas[0] + share * span)), last)
                for share in _SPREAD
            }
        index = sorted(chosen)
        active, maps = [float(self.thetas[k]) for k in index], self.maps[index]
        extra = [theta for theta in dict.fromkeys(seeds) if theta not in active]
        if extra:
            maps = np.concatenate([maps, self.edge.maps(extra)])
        return [*active, *extra], maps

    def _judge(
        self, L: Matrix, active: list[float], maps: Matrix, best: Proposal
    ) -> tuple[Proposal, list[float]]:
        """The better of this P and the best so far, and the theta to add (none: good enough)."""
        both = slack_in(L, np.concatenate([self.maps, maps]), L)
        slacks, goal = both[: len(self.maps)], float(both[len(self.maps) :].min())
        k = int(np.argmin(slacks))
        least, theta = float(slacks[k]), float(self.thetas[k])
        between = self._between(L, slacks) if 0 < least < _NARROW else None
        if between is not None and between[1] < least:
            theta, least = between
        if least > 0 and least >= best.margin:
            best = Proposal(L @ L.T, tuple(active), least, theta)
        elif best.P is None:
            best = Proposal(None, tuple(active), least, theta)
        if least > 0 and least >= _ENOUGH * goal:
            return best, []
        if between is not None:
            return best, [theta] if theta not in active else []
        more = worst(self.thetas, slacks, _ENOUGH * max(goal, 0.0))[:_ADDED]
        return best, [float(self.thetas[j]) for j in more if self.thetas[j] not in active]

    def _between(self, L: Matrix, slacks: Matrix) -> tuple[float, float]:
        """Least slack near the lowest points of the grid: narrow margins hide between points."""
        found, last = (float(self.thetas[0]), math.inf), len(self.thetas) - 1
        for k in worst(self.thetas, slacks, math.inf)[:_LOOKED]:
            left, right = self.thetas[max(k - 1, 0)], self.thetas[min(k + 1, last)]
            for _ in range(_ZOOMS):
                points = np.linspace(left, right, 9)
                values = slack_in(L, self.edge.maps(points), L)
                j = int(np.argmin(values))
                left, right = points[max(j - 1, 0)], points[min(j + 1, 8)]
                if values[j] < found[1]:
                    found = float(points[j]), float(values[j])
        return found

    def _none(self, active: list[float], solution: Solution, L: Matrix, best: Proposal) -> Proposal:
        if best.P is not None:
            return best
        back = np.linalg.inv(L)
        Z = solution.multipliers[0]
        # inside the cone: the solver's zeros may be slightly negative
        Z = Z + 1e-9 * np.trace(Z.sum(axis=0)) * np.eye(len(L))
        Z = back.T @ Z @ back
        Z = (Z + np.swapaxes(Z, 1, 2)) / 2
        return Proposal(None, tuple(active), best.margin, best.worst_theta, Z, L, solution.margin)


def _cholesky(P: Matrix) -> Matrix | None:
    try:
        L: Matrix = np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        return None
    return L if np.isfinite(L).all() else None
