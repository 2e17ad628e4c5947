"""The gain L under convex constraints: among those that meet them, one near a target.

With P and Z = P L the constraints are linear matrix inequalities (`synthesis.convex_gain`). Of
their solutions one with the least |Z - P target| is taken, in units that balance the plant: the
target itself where it meets them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.find.affine import Inequality, Unknown
from lmi.find.constrained import Expression, constrained_matrices
from obsdesign.analysis.balancing import BalancedPlant
from obsdesign.equations.regions import half_plane_inequality
from obsdesign.problem.plant import Plant
from obsdesign.synthesis.convex_gain import ConvexGain, refused_constraints

_CONDITION = 1e4
# least margin of the inequalities, relative to the unit of P and the pace of the plant
_MARGIN = 1e-4


def nearest_gain(
    plant: Plant, wanted: ConvexGain, target: Matrix, rate: float | None, pace: float
) -> Matrix | None:
    """L (n, p) that meets the constraints, near the target (n, p); None when none is found.

    rate: A - L C + rate I is made Hurwitz; None where it need not be; pace: of an A without cycles.
    The conditions are
    sufficient, so that there may be such an L where none is found. InputError for constraints that
    are not convex.
    """
    units = BalancedPlant.from_matrices(plant.flow.A, plant.output.C, own_pace=pace)
    n, p = target.shape
    goal = target / units.sizes[:, None] / units.pace * units.rows
    constraints = wanted.constraints(units.sizes, units.pace)
    with refused_constraints():
        solution = constrained_matrices(
            [Unknown(n, n, symmetric=True), Unknown(n, p)],
            _inequalities(units, wanted, rate),
            _CONDITION,
            constraints=lambda values: constraints(
                [values[0], values[1] @ np.diag(1 / units.rows)]
            ),
            objective=lambda values: _distance(values, goal),
            margin=_MARGIN,
        )
    if solution is None:
        return None
    (P, Z), _ = solution
    try:
        L: Array = units.flow_gain(np.linalg.solve(P, Z))
    except np.linalg.LinAlgError:
        return None
    return wanted.rounded(L) if np.isfinite(L).all() else None


def _inequalities(units: BalancedPlant, wanted: ConvexGain, rate: float | None) -> list[Inequality]:
    """The regions, and where there is a rate its half plane, affine in (P, Z)."""
    n = len(units.A)
    count = len(wanted.inequalities(np.zeros((n, n)), np.zeros((n, n))))

    def product(P: Array, Z: Array) -> Array:
        PF: Array = P @ units.A - Z @ units.C
        return PF

    result: list[Inequality] = [
        lambda P, Z, k=k: wanted.inequalities(product(P, Z), P, units.pace)[k][None]
        for k in range(count)
    ]
    if rate is not None:
        decay = rate / units.pace
        result.append(lambda P, Z: half_plane_inequality(product(P, Z), P, decay)[None])
    return result


def _distance(values: Sequence[Expression], goal: Matrix) -> Expression:
    import cvxpy as cp

    P, Z = values
    return cp.norm(Z - P @ goal, "fro")
