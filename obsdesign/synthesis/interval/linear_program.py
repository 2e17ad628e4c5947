"""Gains and a copositive function of the clock in one linear program (HiGHS).

V = zeta(tau)' w, tau the time since the last jump, falls along the width system if

    zeta' + 1'Y + q <= 0,    Y = X A - U C + 2 Delta,    X A - U C + Delta >= 0 off the diagonal
    1'N <= (1 - eps) zeta(theta)',    N = X(0) G - Z C_J + 2 Theta >= Theta

with X = diag zeta > 0, U = X L, Z = X(0) M. (Delta = Theta = 0 for the form `cooperative`.) With
zeta, U, Delta linear on segments all of it is affine there, so that both ends of every segment
decide. The gain U / zeta depends on the clock; constant gains are read off it, to be improved and
analysed exactly afterwards.
Constraints on the gains go through CVXPY with the same rows (`constraints.py`).
Source: clock-dependent conditions for positive systems after C. Briat, Automatica 49 (2013).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.find.constrained import Expression
from lmi.time_budget import TimeBudget
from obsdesign.synthesis.interval.constraints import diagonal_constraints, program_minimum
from obsdesign.synthesis.interval.task import Task

_MARGIN = 1e-3  # of contraction, where nothing else makes the inequalities strict


@dataclass
class _Program:
    """Rows a'x <= b in sparse triplets."""

    size: int = 0
    values: list[float] = field(default_factory=list)
    columns: list[int] = field(default_factory=list)
    rows: list[int] = field(default_factory=list)
    limits: list[float] = field(default_factory=list)

    def block(self, *shape: int) -> Indices:
        """Return the indices of new variables."""
        count = math.prod(shape)
        variables = np.arange(self.size, self.size + count).reshape(shape)
        self.size += count
        return variables

    def below(self, terms: list[tuple[Indices, Matrix]], limit: float) -> None:
        """Add a row: the sum of coefficients times variables is at most the limit."""
        row = len(self.limits)
        for columns, values in terms:
            self.columns += np.ravel(columns).tolist()
            self.values += np.ravel(np.broadcast_to(values, np.shape(columns))).tolist()
            self.rows += [row] * np.size(columns)
        self.limits.append(limit)

    def solve(
        self,
        cost: Matrix,
        bounds: list[tuple[float | None, float | None]],
        budget: TimeBudget,
        constraints: Callable[[Expression], list[Expression]] | None,
    ) -> Matrix | None:
        """Minimiser, or None; constraints: of the variables, beside the rows, through CVXPY."""
        entries = (np.array(self.rows), np.array(self.columns), np.array(self.values))
        sides = np.full(len(self.limits), -np.inf), np.array(self.limits)
        low = np.array([-np.inf if end is None else end for end, _ in bounds])
        high = np.array([np.inf if end is None else end for _, end in bounds])
        return program_minimum(
            cost, entries, sides, (low, high), constraints=constraints, budget=budget
        )


@dataclass(frozen=True)
class _Variables:
    """Indices: zeta (k, n), U (2, k, n, p), Z (2, n, p), Delta (k, n, n), Theta (n, n), gamma.

    The positive and the negative part of U and Z come first and second.
    """

    zeta: Indices
    U: Indices
    Z: Indices
    Delta: Indices
    Theta: Indices
    gamma: int

    @classmethod
    def in_program(cls, program: _Program, k: int, n: int, p: int) -> _Variables:
        """New variables of a program with k nodes."""
        return cls(
            zeta=program.block(k, n),
            U=program.block(2, k, n, p),
            Z=program.block(2, n, p),
            Delta=program.block(k, n, n),
            Theta=program.block(n, n),
            gamma=int(program.block(1)[0]),
        )


def clock_gains(
    task: Task, low: float, nodes: int, narrow: bool, budget: TimeBudget
) -> list[tuple[Matrix, Matrix]] | None:
    """Constant gains (L, M), in z, to try, for dwell times from `low` on; None if infeasible.

    narrow: minimise the bound on the weighted time average of the width (on the pre-jump width, if
    the task says so and jumps never stay away for ever); otherwise small gains.
    """
    n, p = task.A.shape[0], task.C.shape[0]
    clock = _clock(task, low, nodes)
    k = len(clock)
    program = _Program()
    variables = _Variables.in_program(program, k, n, p)
    _flow_rows(program, task, variables, clock, narrow)
    if task.G is not None:
        margin = 0.0 if narrow else _MARGIN
        _jump_rows(program, task, variables, clock, low=low, margin=margin)
    if narrow:
        _cost_rows(program, task, variables, clock, low)
    bounds = _bounds(program, task, variables, narrow)
    cost = np.zeros(program.size)
    cost[variables.gamma] = 1.0 if narrow else 0.0
    small = 1e-9 if narrow else 1.0
    cost[variables.U.ravel()], cost[variables.Z.ravel()] = small / k, small
    cost[variables.zeta.ravel()] = small / k
    constraints = partial(_gain_constraints, task, variables) if task.is_constrained else None
    x = program.solve(cost, bounds, budget, constraints)
    return None if x is None else list(_constant(x, variables))


def _gain_constraints(task: Task, variables: _Variables, x: Expression) -> list[Expression]:
    """Constraints on the gains: for L on the average over the clock, which `_constant` yields."""
    zeta, U, Z = variables.zeta, variables.U, variables.Z
    k = len(zeta)
    holds = []
    for name, entry in task.constraints.items():
        pace = task.pace if name == "L" else 1.0
        if name == "L":
            P = sum(x[row] for row in zeta) / k
            gain = sum(x[U[0, i]] - x[U[1, i]] for i in range(k)) / k
            X, output = task.A, task.C
        else:
            assert task.G is not None
            P, gain = x[zeta[0]], x[Z[0]] - x[Z[1]]
            X, output = task.G, task.C_jump
        holds += diagonal_constraints(
            entry, (P, gain), (X, output), task.S, task.rows, pace=pace
        )  # fmt: skip
    return holds


def _clock(task: Task, low: float, nodes: int) -> Matrix:
    """Times since the jump: the shortest dwell time among them, and a while beyond it."""
    if task.G is None:
        return np.array([0.0])
    if math.isfinite(task.high):
        end = task.high
    else:
        end = low + 1.0 / max(float(np.abs(np.diag(task.A)).max()), 1e-12)
    share = np.linspace(0.0, 1.0, nodes) ** 1.5
    first = low * share if low > 0 else np.zeros(1)
    later = low + (end - low) * np.linspace(0.0, 1.0, max(nodes // 3, 3)) if end > low else first
    return np.unique(np.concatenate([first, later]))


def _column_sum(
    task: Task, j: int, zeta: Indices, U: Indices, Delta: Indices
) -> list[tuple[Indices, Matrix]]:
    """1'Y, column j, at one node."""
    C = np.broadcast_to(task.C[:, j], U.shape[1:])
    return [(zeta, task.A[:, j]), (U[0], -C), (U[1], C), (Delta[:, j], np.array(2.0))]


def _flow_rows(
    program: _Program, task: Task, variables: _Variables, clock: Matrix, narrow: bool
) -> None:
    zeta, U, Delta = variables.zeta, variables.U, variables.Delta
    n = len(task.A)
    q = task.weights if narrow and not _is_at_jumps(task) else np.zeros(n)
    for k in range(len(clock)):
        for i in range(n):
            for j in range(n):
                if i != j:
                    C = task.C[:, j]
                    program.below(
                        [(zeta[k, i], np.array(-task.A[i, j])), (U[0, k, i], C),
                         (U[1, k, i], -C), (Delta[k, i, j], np.array(-1.0))], 0.0,
                    )  # fmt: skip
    for k in range(len(clock) - 1):
        slope = 1.0 / (clock[k + 1] - clock[k])
        for end in (k, k + 1):
            for j in range(n):
                change = [(zeta[k + 1, j], np.array(slope)), (zeta[k, j], np.array(-slope))]
                terms = _column_sum(task, j, zeta[end], U[:, end], Delta[end])
                program.below([*change, *terms], -q[j])
    if task.G is None or math.isinf(task.high):  # from the last node on zeta and U stand still
        margin = 0.0 if narrow else _MARGIN
        for j in range(n):
            terms = _column_sum(task, j, zeta[-1], U[:, -1], Delta[-1])
            room = float(np.abs(task.A).max()) * margin
            program.below([*terms, (zeta[-1, j], np.array(room))], -q[j])


def _jump_rows(
    program: _Program, task: Task, variables: _Variables, clock: Matrix, *, low: float,
    margin: float,
) -> None:  # fmt: skip
    zeta, Z, Theta = variables.zeta, variables.Z, variables.Theta
    assert task.G is not None
    n = len(task.A)
    q = task.weights if margin == 0 and _is_at_jumps(task) else np.zeros(n)
    for i in range(n):
        for j in range(n):
            C = task.C_jump[:, j]
            program.below(
                [(zeta[0, i], np.array(-task.G[i, j])), (Z[0, i], C), (Z[1, i], -C),
                 (Theta[i, j], np.array(-1.0))], 0.0,
            )  # fmt: skip
    for k in np.flatnonzero(clock >= low):
        for j in range(n):
            C = np.broadcast_to(task.C_jump[:, j], Z.shape[1:])
            program.below(
                [(zeta[0], task.G[:, j]), (Z[0], -C), (Z[1], C), (Theta[:, j], np.array(2.0)),
                 (zeta[k, j], np.array(margin - 1.0))], -q[j],
            )  # fmt: skip


def _is_at_jumps(task: Task) -> bool:
    """Is the pre-jump width minimised? Where jumps may stay away, the average stands in for it."""
    return task.pre_jump and math.isfinite(task.high)


def _cost_rows(
    program: _Program, task: Task, variables: _Variables, clock: Matrix, low: float
) -> None:
    """Rows: the input to V from jump to jump is at most gamma times the time between them."""
    zeta, U, Z, gamma = variables.zeta, variables.U, variables.Z, variables.gamma
    k = len(clock)
    noise = np.broadcast_to(2 * task.V, U.shape[2:])
    steps = np.diff(clock)
    kick = [(zeta[0], task.h0), (Z[0], noise), (Z[1], noise)] if task.G is not None else []
    for last in range(k):
        if clock[last] < low or clock[last] == 0:
            continue
        share = np.zeros(k)
        share[:last] += steps[:last] / 2
        share[1 : last + 1] += steps[:last] / 2
        flow = [(zeta[i], share[i] * task.f0) for i in range(last + 1)] + [
            (U[s, i], share[i] * noise) for i in range(last + 1) for s in (0, 1)
        ]
        per = 1.0 if _is_at_jumps(task) else clock[last]
        program.below([*flow, *kick, (np.array(gamma), np.array(-per))], 0.0)
    if task.G is None or math.isinf(task.high):
        settled = [(zeta[-1], task.f0), (U[0, -1], noise), (U[1, -1], noise)]
        program.below([*settled, (np.array(gamma), np.array(-1.0))], 0.0)


def _bounds(
    program: _Program, task: Task, variables: _Variables, narrow: bool
) -> list[tuple[float | None, float | None]]:
    """Signs, gains that are not open, caps: |U| <= limit times zeta."""
    zeta, U, Z = variables.zeta, variables.U, variables.Z
    top = np.full(program.size, np.inf)
    least = np.zeros(program.size)
    least[zeta.ravel()] = 0.0 if narrow else 1.0
    for block, is_open in ((U, task.open_L), (Z, task.open_M)):
        if not is_open:
            top[block.ravel()] = 0.0
    if task.positive:
        top[variables.Delta.ravel()] = top[variables.Theta.ravel()] = 0.0
    for index in np.ndindex(*U.shape[1:]):
        limit = task.limit_L[index[1], index[2]]
        if task.open_L and math.isfinite(limit):
            u = U[(slice(None), *index)]
            program.below([(u, np.ones(2)), (zeta[index[0], index[1]], np.array(-limit))], 0.0)
    for index in np.ndindex(*Z.shape[1:]):
        limit = task.limit_M[index]
        if task.open_M and math.isfinite(limit):
            z = Z[(slice(None), *index)]
            program.below([(z, np.ones(2)), (zeta[0, index[0]], np.array(-limit))], 0.0)
    return [(a, None if math.isinf(b) else b) for a, b in zip(least, top, strict=True)]


def _constant(x: Matrix, variables: _Variables) -> Iterator[tuple[Matrix, Matrix]]:
    """Gains that do not depend on the clock: on average, at its end, at its start."""
    zeta, U, Z = variables.zeta, variables.U, variables.Z
    scale = np.maximum(x[zeta], 1e-12)
    flow, jump = x[U[0]] - x[U[1]], x[Z[0]] - x[Z[1]]
    M = jump / scale[0][:, None]
    yield flow.mean(axis=0) / scale.mean(axis=0)[:, None], M
    yield flow[-1] / scale[-1][:, None], M
    yield flow[0] / scale[0][:, None], M
