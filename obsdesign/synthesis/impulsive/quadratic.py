"""The quadratic strategy: one P for all spacings, a gain for each cell of the last spacing.

With S = G e^{A delta}, H = C e^{A delta} some gain L(delta) makes the error after an impulse at
most gamma times that after the one before, in the norm of P, if and only if

    N' (gamma^2 P - S' P S) N > 0,   N a basis of ker H,

which is linear in P. The best gain is L = -S W H' (H W H')^-1, W = P^-1. It is kept constant on
cells of spacings, which are halved until the proof for each of them succeeds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import exact
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.units import balance
from lmi.find.affine import Unknown, best_margin
from lmi.prove.common_matrix import prove_common
from lmi.rank.hidden_mode import propose_hiding
from lmi.rank.stack import Stack
from lmi.solvers import Solvers
from lmi.time_budget import Remark, TimeBudget, remark_end
from obsdesign.analysis.impulsive_noise import estimate
from obsdesign.equations.estimation_error import seen_before_jump
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from obsdesign.problem.options import ImpulsiveOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate

_GRID, _CONDITION = 25, 1e8
_CELLS = 128
# factors per impulse that are tried, the fastest first; finer steps would gain nothing that a user
# would notice
_FACTORS = (0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.995)


@dataclass(frozen=True)
class CommonMatrix:
    """P (n, n), and the solver that made it; none where every output sees all states."""

    P: Matrix
    solvers: Solvers = ()


@np.errstate(all="ignore")
def quadratic_candidate(problem: Problem, budget: TimeBudget) -> Candidate:
    """Return the table of gains with the smallest factor that is proved; zeros where none is."""
    plant = problem.plant
    assert plant.jump is not None
    low, high = problem.require_dwell_time()
    A, G = plant.flow.A, plant.jump.G
    C = seen_before_jump(G, plant.output.C, plant.output.jump_measurement)
    rate = problem.options_as(ImpulsiveOptions).decay_rate
    limit = math.exp(-rate * high) * (1 - 1e-9)
    factors = {*(f for f in _FACTORS if f < limit), *([limit] if limit < 1 else [])}
    remarks: tuple[Remark, ...] = ()
    for gamma in sorted(factors):
        proposal = common_matrix((A, G, C), (low, high), gamma)
        if proposal is None:
            continue
        P = proposal.P
        # a little room between the search and the proof
        looser = min(1.01 * gamma, (1 + gamma) / 2)
        looser = min(looser, limit) if rate > 0 else looser
        table, more = _table((A, G, C), P, (low, high), looser, budget)
        remarks += more
        if table is not None:
            gains = _gains(problem, *table)
            certificates = {
                "contracting": {"P": P.tolist(), "gamma": looser},
                "rate": {"estimated": estimate(problem, gains)},
            }
            return Candidate(
                "quadratic", gains, certificates, True, remarks=remarks, solvers=proposal.solvers
            )
    zeros = _gains(problem, np.array([low, high]), np.zeros((1, plant.n, plant.p)))
    forever = Stack(exact(A), exact(G), exact(C), exact(np.eye(plant.n)), plant.n + 1)
    theta = propose_hiding(forever, low, high)
    hiding = {} if theta is None else {"detectable": {"witness": {"thetas": [theta]}}}
    return Candidate("quadratic", zeros, hiding, remarks=remarks)


def _gains(problem: Problem, cells: Matrix, table: Matrix) -> ImpulsiveGains:
    plant = problem.plant
    return ImpulsiveGains.from_plant(plant, strategy="quadratic", cells=cells, table=table)


def common_matrix(
    plant: tuple[Matrix, Matrix, Matrix], ends: tuple[float, float], gamma: float
) -> CommonMatrix | None:
    """P of the inequality on a grid of spacings, or None; floats, in balanced coordinates."""
    A, G, C = plant
    flows = expm(A * np.linspace(*ends, _GRID)[:, None, None])
    if not np.isfinite(flows).all():
        return None
    units = balance(np.abs(G @ flows) + np.abs(flows))
    S = units[:, None] * (G @ flows) / units
    H = C @ flows / units
    size = min(np.linalg.matrix_rank(h) for h in H)
    kernels = np.stack([np.linalg.svd(h)[2][size:].T for h in H])
    if kernels.shape[2] == 0:
        return CommonMatrix(np.diag(units**2))
    turned = np.swapaxes(kernels, 1, 2)

    def inequality(P: Matrix) -> Matrix:
        inside = gamma**2 * P - np.swapaxes(S, 1, 2) @ P @ S
        return np.asarray(turned @ inside @ kernels)

    solution = best_margin([Unknown(len(A), len(A), symmetric=True)], inequality, _CONDITION)
    if solution is None or solution[1] <= 0:
        return None
    P = units[:, None] * solution[0][0] * units
    return CommonMatrix((P + P.T) / 2, ("Clarabel",))


def best_gain(A: Matrix, G: Matrix, C: Matrix, P: Matrix, spacing: float) -> Matrix:
    """L = -S W H' (H W H')^-1 at one spacing, by a least-squares problem instead of inverses."""
    flow = expm(A * spacing)
    # W = Z Z', Z = L^-T of P = L L': rows of (H Z)' weigh the measurements
    Z = np.linalg.inv(np.linalg.cholesky(P)).T
    return -(G @ flow @ Z) @ np.linalg.pinv(C @ flow @ Z)


def _table(
    plant: tuple[Matrix, Matrix, Matrix],
    P: Matrix,
    ends: tuple[float, float],
    gamma: float,
    budget: TimeBudget,
) -> tuple[tuple[Matrix, Matrix] | None, tuple[Remark, ...]]:
    """Cells and gains for which the contraction is proved; None if there would be too many."""
    A, G, C = plant
    exact_A, exact_G, exact_C = exact(A), exact(G), exact(C)
    todo, borders, gains = [ends], [ends[0]], []

    def is_proved(L: Matrix, start: float, end: float) -> bool:
        H = exact_G + exact(L) @ exact_C
        verdict = prove_common(exact_A, H, P, start, end, form="after_jump", gamma=gamma)
        return verdict.outcome == "proved"

    while todo and budget.remaining() > 0:
        start, end = todo.pop()
        try:
            L = best_gain(A, G, C, P, (start + end) / 2)
            is_likely = _is_likely(A, G + L @ C, P, (start, end), gamma)
        except np.linalg.LinAlgError:
            return None, ()
        if is_likely and is_proved(L, start, end):
            borders.append(end)
            gains.append(L)
        elif len(todo) + len(gains) >= _CELLS or end - start < 1e-3 * (ends[1] - ends[0]):
            return None, ()
        else:
            middle = (start + end) / 2
            todo += [(middle, end), (start, middle)]
    if todo:
        return None, remark_end("cells of spacings", budget.ended(), matters=False)
    return (np.array(borders), np.array(gains)), ()


def _is_likely(A: Matrix, H: Matrix, P: Matrix, ends: tuple[float, float], gamma: float) -> bool:
    """Whether |H e^{A theta}|, in the norm of P, is at most gamma at both ends, in floats."""
    root = np.linalg.cholesky(P).T
    maps = root @ H @ expm(A * np.array(ends)[:, None, None])
    turned = np.linalg.solve(root.T, np.swapaxes(maps, 1, 2))
    return bool(np.linalg.norm(turned, 2, axis=(1, 2)).max() <= gamma)
