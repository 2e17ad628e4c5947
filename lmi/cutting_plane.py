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

from lmi.families import Edge, moved, slack_in, worst
from lmi.semidefinite import FLOOR, Block, Solution, common_matrices

Matrix = NDArray[Any]

_ROUNDS = 25
_ADDED = 4
# Smallest margin, relative to P, that is worth a proof attempt
_LEAST = 1e-10
# On the grid, this part of the margin at the active theta is good enough
_ENOUGH = 0.3


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
) -> Proposal:
    """P with M(theta)' P M(theta) < P at every theta of a fine grid, or the theta that forbid it.

    seeds: theta that must be among those solved for; start: a P of a neighbouring problem, whose
    coordinates the solver then works in.
    """
    edge = Edge(F, H, low, high)
    with np.errstate(all="ignore"):
        thetas, maps = edge.grid()
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
        n = len(self.edge.F)
        L = np.eye(n) if start is None else np.linalg.cholesky(start)
        active = self._first(L, seeds)
        best = Proposal(None, tuple(active), -math.inf, active[0])
        for _ in range(_ROUNDS):
            maps = self.edge.maps(active)
            solution = common_matrices([Block(moved(L, maps, L))])
            inner = _cholesky(solution.P[0])
            if inner is None:
                return best
            better = L @ inner
            if solution.margin <= _LEAST:
                # at the floor of kappa(P) other coordinates may still allow one; else nothing will
                if best.P is not None or np.diag(inner).min() ** 2 > 10 * FLOOR:
                    return self._none(active, solution, L, best)
                if np.abs(np.linalg.cond(better)) > 1e7:
                    return self._none(active, solution, L, best)
                L = better
                continue
            L = better
            best, more = self._judge(L, active, best)
            best = replace(best, optimum=solution.margin)
            if not more:
                return best
            active = sorted({*active, *more})
        return best

    def _first(self, L: Matrix, seeds: list[float]) -> list[float]:
        """The ends, the largest map in these coordinates, and what the caller asks for."""
        slacks = slack_in(L, self.maps, L)
        largest = float(self.thetas[int(np.argmin(slacks))])
        return sorted({self.edge.low, self.edge.last, largest, *seeds})

    def _judge(
        self, L: Matrix, active: list[float], best: Proposal
    ) -> tuple[Proposal, list[float]]:
        """The better of this P and the best so far, and the theta to add (none: good enough)."""
        slacks = slack_in(L, self.maps, L)
        goal = float(slack_in(L, self.edge.maps(active), L).min())
        k = int(np.argmin(slacks))
        least, theta = float(slacks[k]), float(self.thetas[k])
        if least > 0 and least >= best.margin:
            best = Proposal(L @ L.T, tuple(active), least, theta)
        elif best.P is None:
            best = Proposal(None, tuple(active), least, theta)
        if least >= _ENOUGH * goal and least > 0:
            return best, []
        more = [float(self.thetas[j]) for j in worst(self.thetas, slacks, _ENOUGH * max(goal, 0.0))]
        return best, [theta for theta in more[:_ADDED] if theta not in active]

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
