"""Gains at jumps for a flow that is fixed: one for all dwell times, or one per cell of them.

The inequality of `equations.luenberger` is affine in (P_w, P_w M_w) for all cells w at once, P_w
the matrix after a jump whose dwell time lay in w. Its margin is made as large as possible over the
whole range of dwell times by cutting planes. With one cell this is the common P. Convex constraints
on M go the same way, through CVXPY (`synthesis.convex_gain`). All of it in units that balance the
plant: z = D^-1 x and y in units near the size of its row of C D, so that M = D M_z / rows.
Source: C. Briat, Automatica 49 (2013), Theorem 3; with cells, its P depends on the last dwell time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import exact
from lmi.families import Edge, worst
from lmi.find.affine import Inequality, Unknown, best_margin
from lmi.find.constrained import Constraints, constrained_matrices
from lmi.solvers import Solvers
from lmi.time_budget import Remark, TimeBudget, remark_end
from obsdesign.analysis.balancing import BalancedPlant
from obsdesign.equations.estimation_error import jump_error_matrix, seen_before_jump
from obsdesign.equations.luenberger import error_system as equations
from obsdesign.problem.gain_constraints import GainConstraints
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.convex_gain import ConvexGain, inactive_constraints, refused_constraints
from obsdesign.synthesis.time_scale import event_pace

_CONDITION = 1e4
_ROUNDS = 20
_ADDED = 4
_EACH_POINTS = 24


@dataclass(frozen=True)
class JumpGains:
    """M (cells, n, p) and P (cells, n, n), and the solver that made them."""

    M: Array
    P: Array
    solvers: Solvers


def jump_gains(
    problem: Problem,
    F: Array,
    cells: Sequence[tuple[float, float]],
    pairs: Sequence[tuple[int, int]],
    budget: TimeBudget,
    *,
    wanted: ConvexGain,
) -> tuple[JumpGains | None, tuple[Remark, ...]]:
    """Gains for a flow F (n, n) and cells of dwell times, None when the solver gives nothing.

    pairs: (earlier, later) cells that may follow each other; wanted: constraints on every M. The
    remarks are those of the search. InputError for constraints that are not convex.
    """
    plant = _BalancedJumps.from_problem(problem, F, max(high for _, high in cells))
    with np.errstate(all="ignore"):
        grids = [Edge(plant.F, np.eye(len(F)), *ends).grid(_EACH_POINTS) for ends in cells]
    if not all(np.isfinite(flows).all() for _, flows in grids):
        return None, ()
    active = {(i, j, k) for i, j in pairs for k in (0, len(grids[j][0]) - 1)}
    best: JumpGains | None = None
    for _ in range(_ROUNDS):
        if out_of_time := budget.ended():
            return best, remark_end("gains at jumps", out_of_time, matters=False)
        if (solution := _solution(active, grids, plant, wanted)) is None:
            return best, ()
        P, Z, margin = solution
        try:
            M = plant.restored_gains(np.linalg.solve(P, Z))
        except np.linalg.LinAlgError:  # the solver stopped before P was positive definite
            return best, ()
        M = np.array([wanted.rounded(gain) for gain in M])
        best = JumpGains(M, plant.scaling.undone.form(P), wanted.solvers)
        more = set() if margin <= 0 else _violated((P, Z), grids, pairs, plant)
        if more <= active:
            return best, ()
        active |= more
    return best, ()


@dataclass(frozen=True)
class _BalancedJumps:
    """Flow F of the error, G and the output at jumps, in balanced units; rows: those of y (p,).

    Units of the plant, which do not depend on those of its file, and from there powers of two.
    """

    scaling: Scaling
    rows: Array
    F: Array
    G: Array
    output: Array

    @staticmethod
    def from_problem(problem: Problem, F: Array, longest: float) -> _BalancedJumps:
        """longest: the longest dwell time."""
        plant = problem.plant
        assert plant.jump is not None
        G = plant.jump.G
        output = seen_before_jump(G, plant.output.C, plant.output.jump_measurement)
        pace = event_pace(problem) or 1.0
        scaling = Scaling(BalancedPlant.from_plant(plant, pace).sizes)
        if np.isfinite(scaling.map(F)).all():
            pair = exact(scaling.map(F)), exact(scaling.map(G))
            scaling = Scaling(scaling.sizes * Scaling.from_pair(*pair, longest).sizes)
        output = scaling.columns(output)
        rows = Scaling.like(np.abs(output).max(axis=1)).sizes
        return _BalancedJumps(scaling, rows, scaling.map(F), scaling.map(G), output / rows[:, None])

    def restored_gains(self, M: Array) -> Array:
        """Gains (cells, n, p) in the units of the problem."""
        return self.scaling.sizes[:, None] * M / self.rows

    def constraints(self, wanted: ConvexGain, cells: int) -> Constraints:
        """The constraints on M for every cell."""
        single = wanted.constraints(self.scaling.sizes)
        rows = np.diag(1 / self.rows)
        return lambda values: [
            entry for i in range(cells) for entry in single((values[i], values[cells + i] @ rows))
        ]


def single_jump_gain(
    problem: Problem, F: Array, budget: TimeBudget, wanted: ConvexGain
) -> tuple[JumpGains | None, tuple[Remark, ...]]:
    """One M for all dwell times, with remarks on constraints that do not restrict it."""
    cells = [problem.require_dwell_time()]
    solution, remarks = jump_gains(problem, F, cells, [(0, 0)], budget, wanted=wanted)
    if solution is None or wanted.is_free() or wanted.user is not None:
        return solution, remarks
    free = replace(wanted, stated=GainConstraints())
    other, _ = jump_gains(problem, F, cells, [(0, 0)], budget, wanted=free)
    if other is not None:
        plant, M = problem.plant, other.M[0]
        assert plant.jump is not None
        H = jump_error_matrix(plant.jump.G, M, plant.output.C, plant.output.jump_measurement)
        remarks += inactive_constraints(wanted, M, H)
    return solution, remarks


def _solution(
    active: set[tuple[int, int, int]],
    grids: Sequence[tuple[Array, Array]],
    plant: _BalancedJumps,
    wanted: ConvexGain,
) -> tuple[Array, Array, float] | None:
    """(P, P M, margin) with the largest margin at the active (earlier, later, number of theta)."""
    count, (p, n) = len(grids), plant.output.shape
    unknowns = [Unknown(n, n, symmetric=True)] * count + [Unknown(n, p)] * count
    rows = sorted(active)
    earlier, later, _ = np.array(rows).T
    flows = np.array([grids[j][1][k] for _, j, k in rows])

    def inequality(*values: Array) -> Array:
        P, Z = np.array(values[:count]), np.array(values[count:])
        return equations.post_jump_inequality(
            P[later], Z[later], plant.G, plant.output, flows, before=P[earlier]
        )

    if wanted.is_free():
        solution = best_margin(unknowns, inequality, _CONDITION)
    else:
        constraints = plant.constraints(wanted, count)
        inequalities = [inequality, *_regions(wanted, count, plant)]
        with refused_constraints():
            solution = constrained_matrices(
                unknowns, inequalities, _CONDITION, constraints=constraints
            )
    if solution is None:
        return None
    values, margin = solution
    return np.array(values[:count]), np.array(values[count:]), margin


def _regions(wanted: ConvexGain, count: int, plant: _BalancedJumps) -> list[Inequality]:
    """The region of the error's matrix at jumps, for all cells together."""
    if not wanted.stated.has_region():
        return []

    def inequality(*values: Array) -> Array:
        pairs = zip(values[:count], values[count:], strict=True)
        return np.concatenate(
            [wanted.inequalities(P @ plant.G - Z @ plant.output, P) for P, Z in pairs]
        )

    return [inequality]


def _violated(
    solution: tuple[Array, Array],
    grids: Sequence[tuple[Array, Array]],
    pairs: Sequence[tuple[int, int]],
    plant: _BalancedJumps,
) -> set[tuple[int, int, int]]:
    """(earlier, later, number of theta) where the inequality for (P, Z) fails most."""
    P, Z = solution
    places = set()
    for i, j in pairs:
        flows = grids[j][1]
        held = equations.post_jump_inequality(P[j], Z[j], plant.G, plant.output, flows, before=P[i])
        slacks = np.linalg.eigvalsh(held)[:, 0]
        places |= {(i, j, k) for k in worst(slacks, 0.0)[:_ADDED]}
    return places


def equal_cells(F: Array, low: float, high: float, count: int) -> list[float]:
    """Borders of `count` cells: equally long, or with an infinite end equally far decayed."""
    shares = [k / count for k in range(1, count)]
    if math.isfinite(high):
        return [low + share * (high - low) for share in shares]
    rate = -float(np.linalg.eigvals(F).real.max())
    if not rate > 0:
        return [low + share * (Edge(F, F, low, high).last - low) for share in shares]
    return [low - math.log1p(-share) / rate for share in shares]
