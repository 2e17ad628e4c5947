"""The gain L under convex wishes: of all that fulfil them, one near to a gain that is proposed.

With P and Z = P L the wishes are linear matrix inequalities (`convex.py`). Of their solutions one
with the least |Z - P target| is taken, in units that balance the plant: the target itself where it
fulfils them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.find.affine import Inequality, Unknown
from lmi.find.constrained import Expression, constrained_matrices
from obsdesign.analysis.balancing import balancing_units
from obsdesign.equations.luenberger.regions import half_plane_inequality
from obsdesign.errors import InputError
from obsdesign.problem.plant import Plant
from obsdesign.synthesis.luenberger.convex import ConvexGain

_CONDITION = 1e4
# least margin of the inequalities, relative to the unit of P and the pace of the plant
_MARGIN = 1e-4


def nearest_gain(
    plant: Plant, wanted: ConvexGain, target: Matrix, rate: float | None
) -> Matrix | None:
    """L (n, p) that fulfils the wishes, near the target (n, p); None when none is found.

    rate: A - L C + rate I is made Hurwitz; None where it need not be. The conditions are
    sufficient, so that there may be such an L where none is found. InputError for constraints that
    are not convex.
    """
    n, p = plant.n, plant.p
    A, C = plant.flow.A, plant.output.C
    sizes, pace = balancing_units(A, C, np.zeros((n, 0)))
    rows = np.linalg.norm(C * sizes, axis=1)
    rows = np.where(rows > 0, rows, 1.0)
    flow, output = A * sizes / sizes[:, None] / pace, C * sizes / rows[:, None]
    goal = target / sizes[:, None] / pace * rows

    def in_units(values: Sequence[Expression]) -> list[Expression]:
        P, Z = values
        return [P, Z @ np.diag(1 / rows)]

    count = len(wanted.inequalities(np.zeros((n, n)), np.zeros((n, n))))
    inequalities: list[Inequality] = [
        lambda P, Z, k=k: wanted.inequalities(P @ flow - Z @ output, P, pace)[k][None]
        for k in range(count)
    ]
    if rate is not None:
        inequalities.append(
            lambda P, Z: half_plane_inequality(P @ flow - Z @ output, P, rate / pace)[None]
        )
    constraints = wanted.constraints(sizes, pace)
    try:
        solution = constrained_matrices(
            [Unknown(n, n, symmetric=True), Unknown(n, p)],
            inequalities,
            _CONDITION,
            constraints=lambda values: constraints(in_units(values)),
            objective=lambda values: _distance(values, goal),
            margin=_MARGIN,
        )
    except ValueError as error:
        raise InputError(f"constraints: {error}.") from None
    if solution is None:
        return None
    (P, Z), _ = solution
    try:
        L: Array = np.linalg.solve(P, Z) * sizes[:, None] * pace / rows
    except np.linalg.LinAlgError:
        return None
    return wanted.rounded(L) if np.isfinite(L).all() else None


def _distance(values: Sequence[Expression], goal: Matrix) -> Expression:
    import cvxpy as cp

    P, Z = values
    return cp.norm(Z - P @ goal, "fro")
