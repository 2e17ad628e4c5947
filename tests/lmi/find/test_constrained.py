"""Matrix inequalities under further convex constraints, through CVXPY."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cvxpy as cp
import numpy as np
import pytest

from lmi.arithmetic.arrays import Matrix
from lmi.families import Edge
from lmi.find.affine import Unknown, best_margin
from lmi.find.constrained import constrained_matrices
from lmi.prove.common_matrix import prove_common

F = np.array([[-1.0, 0.0], [1.0, -3.0]])
H = np.array([[2.0, 0.0], [1.0, 0.2]])
LOW, HIGH = 0.75, 3.0
KAPPA = 1e4
COMMON = [Unknown(2, 2, symmetric=True)]
# what a solver's last digits may do to an optimum
DIGITS = 1e-4


def shrinks(low: float = LOW, high: float = HIGH) -> Callable[[Matrix], Matrix]:
    """P - M(theta)' P M(theta) on a grid of the range."""
    maps = Edge(F, H, low, high).grid(24)[1]
    return lambda P: P - np.swapaxes(maps, 1, 2) @ P @ maps


def common(low: float = LOW, high: float = HIGH, **options: Any) -> Matrix | None:
    solution = constrained_matrices(COMMON, [shrinks(low, high)], KAPPA, **options)
    return None if solution is None else solution[0][0]


def roundest() -> Matrix:
    P = common(objective=lambda values: cp.lambda_max(values[0]), margin=1e-3)
    assert P is not None
    return P


def test_without_constraints_it_is_the_margin_of_the_direct_route() -> None:
    solution = constrained_matrices(COMMON, [shrinks()], 50.0)
    direct = best_margin(COMMON, shrinks(), 50.0)
    assert solution is not None
    assert direct is not None
    assert solution[1] == pytest.approx(direct[1], abs=1e-5)
    # several unknowns: a gain beside P, and no symmetry to be lost
    rng = np.random.default_rng(5)
    A, C = rng.standard_normal((3, 3)), rng.standard_normal((2, 3))
    both = [Unknown(3, 3, symmetric=True), Unknown(3, 2)]

    def lyapunov(P: Matrix, Z: Matrix) -> Matrix:
        flow = P @ A - Z @ C
        return -(flow + flow.T)[None]

    gains = constrained_matrices(
        both, [lyapunov], 100.0, constraints=lambda v: [cp.norm(v[1]) <= 4]
    )
    assert gains is not None
    P, Z = gains[0]
    assert np.linalg.norm(Z, 2) <= 4 * (1 + DIGITS)
    held = np.linalg.eigvalsh(lyapunov(P, Z)[0])[0]
    assert held >= gains[1] - 1e-5 > 0


def test_the_roundest_p_is_proved_and_nothing_rounder_exists() -> None:
    P = roundest()
    condition = float(np.linalg.cond(P))
    assert prove_common(F, H, P, LOW, HIGH).outcome == "proved"

    def within(share: float) -> float:
        limit = share * condition * np.eye(2)
        solution = constrained_matrices(
            COMMON, [shrinks()], KAPPA, constraints=lambda v: [v[0] << limit]
        )
        return -np.inf if solution is None else solution[1]

    assert within(1.01) > 1e-3
    assert within(0.98) < 1e-3


def test_an_ellipsoid_inside_a_strip() -> None:
    c = np.array([[3.0, -1.0]])

    def trace(values: Any) -> Any:
        return cp.trace(values[0])

    P = common(objective=trace, margin=1e-4, constraints=lambda v: [v[0] >> c.T @ c])
    free = common(objective=trace, margin=1e-4)
    assert P is not None
    assert free is not None
    assert prove_common(F, H, P, LOW, HIGH).outcome == "proved"
    # the largest |c x| over x' P x <= 1 is sqrt(c P^-1 c')
    assert (c @ np.linalg.solve(P, c.T)).item() <= 1 + DIGITS
    assert (c @ np.linalg.solve(free, c.T)).item() > 1 + DIGITS


def test_constraints_cannot_save_an_unstable_family() -> None:
    assert common(0.6, objective=lambda v: 0, margin=1e-4) is None
    solution = constrained_matrices(COMMON, [shrinks(0.6)], KAPPA)
    assert solution is not None
    assert solution[1] < 0


def test_constraints_that_contradict_the_inequality() -> None:
    # P must shrink along the first state, where the jump doubles it: P = I does not
    solution = constrained_matrices(
        COMMON, [shrinks()], KAPPA, constraints=lambda v: [v[0] << np.eye(2)]
    )
    assert solution is not None
    assert solution[1] < 0
    assert common(constraints=lambda v: [v[0] << 0.5 * np.eye(2)]) is None


def test_constraints_that_are_not_convex() -> None:
    with pytest.raises(ValueError, match="must be convex by CVXPY's rules"):
        common(constraints=lambda v: [cp.norm(v[0]) >= 1])
