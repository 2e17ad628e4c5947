"""Vectors for positive systems: linear programs (HiGHS) by cutting planes. Proposals only.

    maximise t   subject to   (r(theta_i)' B)_j + t <= v_j for all i, j,   sum v = n,   v >= 0

for the four conditions of `lmi.prove.positive`, whose rows are linear in v.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import exact, to_float
from lmi.families import Edge
from lmi.prove.positive import FORMS, SIDES, prove_copositive
from lmi.verdict import Verdict, undecided

_ROUNDS = 30


def decide_copositive(F: ArrayLike, H: ArrayLike, low: float, high: float) -> Verdict:
    """Proved by one vector (evidence: "vector", "side", "form"), or undecided.

    F, H: (n, n) floats or exact rationals, F Metzler and H >= 0 (otherwise undecided).
    """
    F_exact, H_exact = exact(F), exact(H)
    scaling = Scaling.from_pair(F_exact, H_exact, high)
    flow, jump = to_float(scaling.map(F_exact)), to_float(scaling.map(H_exact))
    if not looks_positive(flow, jump):
        return undecided("the flow is not Metzler, or the jump not nonnegative")
    for side in SIDES:
        for form in FORMS:
            v = propose_vector(flow, jump, low, high, side=side, form=form)
            if v is None:
                continue
            v = scaling.vector(v, side)
            verdict = prove_copositive(F_exact, H_exact, v, low, high, side=side, form=form)
            if verdict.outcome == "proved":
                evidence = {"vector": v.tolist(), **verdict.evidence}
                return Verdict("proved", evidence, ("HiGHS",))
    return undecided("no vector was found, which is not instability")


def looks_positive(F: Matrix, H: Matrix) -> bool:
    """F Metzler and H >= 0, finite; floats."""
    positive = (F - np.diag(np.diag(F)) >= 0).all() and (H >= 0).all()
    return bool(positive and np.isfinite(F).all() and np.isfinite(H).all())


def propose_vector(
    F: Matrix, H: Matrix, low: float, high: float, *, side: str, form: str
) -> Matrix | None:
    """v > 0, (n,), with the inequality on a fine grid of theta; None when the program has none."""
    n = len(F)
    edge = Edge(F, np.eye(n), low, high)
    with np.errstate(all="ignore"):
        _, flows = edge.grid()
        maps = flows @ H if form == "before_jump" else H @ flows
    if not np.isfinite(maps).all():
        return None
    # left: v'M < v' is M'v < v; right: M v < v
    operators = np.swapaxes(maps, 1, 2) if side == "left" else maps
    active = sorted({0, len(operators) // 2, len(operators) - 1})
    for _ in range(_ROUNDS):
        v = _program(operators[active])
        if v is None:
            return None
        ratios = (operators @ v / v).max(axis=1)
        worst = int(np.argmax(ratios))
        if ratios[worst] < 1:
            return v
        if worst in active:
            return None
        active = sorted({*active, worst})
    return None


def _program(operators: Matrix) -> Matrix | None:
    """v of the largest t for these maps; None when t is not positive."""
    k, n, _ = operators.shape
    rows = (operators - np.eye(n)).reshape(k * n, n)
    sums = np.concatenate([np.ones(n), [0.0]])
    A = np.vstack([np.hstack([rows, np.ones((k * n, 1))]), sums])
    sides = np.full(k * n + 1, -np.inf), np.zeros(k * n + 1)
    sides[0][-1] = sides[1][-1] = n
    bounds = np.array([*np.zeros(n), -np.inf]), np.array([*np.full(n, np.inf), 1.0])
    from lmi.find.linear_program import minimise  # slow to import, and few pairs need it

    x = minimise(-np.eye(n + 1)[-1], A, sides, bounds)
    if x is None or x[-1] <= 1e-9 or not (x[:n] > 0).all():
        return None
    return x[:n]
