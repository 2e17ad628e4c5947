"""A common P under further convex constraints."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest

from lmi.decide.stability import decide
from lmi.find.constrained import propose_constrained
from lmi.prove.common_matrix import prove_common

F = np.array([[-1.0, 0.0], [1.0, -3.0]])
H = np.array([[2.0, 0.0], [1.0, 0.2]])
LOW, HIGH = 0.75, 3.0
# what a solver's last digits may do to an optimum
DIGITS = 1e-4


def best_condition() -> tuple[np.ndarray, float]:
    P = propose_constrained(F, H, LOW, HIGH, objective=cp.lambda_max)
    assert P is not None
    return P, float(np.linalg.cond(P))


def test_the_roundest_p_is_proved_and_rounder_than_the_one_of_largest_margin() -> None:
    P, condition = best_condition()
    assert prove_common(F, H, P, LOW, HIGH).outcome == "proved"
    usual = np.array(decide(F, H, LOW, HIGH).evidence["P"])
    assert condition <= np.linalg.cond(usual) * (1 + DIGITS)


def test_nothing_rounder_exists() -> None:
    _, condition = best_condition()

    def within(share: float) -> np.ndarray | None:
        limit = share * condition
        return propose_constrained(F, H, LOW, HIGH, lambda P: [P << limit * np.eye(2)])

    assert within(1.01) is not None
    assert within(0.98) is None


def test_an_ellipsoid_inside_a_strip() -> None:
    c = np.array([[3.0, -1.0]])
    P = propose_constrained(F, H, LOW, HIGH, lambda P: [P >> c.T @ c], cp.trace, floor=1e-6)
    assert P is not None
    assert prove_common(F, H, P, LOW, HIGH).outcome == "proved"
    # the largest |c x| over x' P x <= 1 is sqrt(c P^-1 c')
    assert (c @ np.linalg.solve(P, c.T)).item() <= 1 + DIGITS
    free = propose_constrained(F, H, LOW, HIGH, objective=cp.trace, floor=1e-2)
    assert free is not None
    assert (c @ np.linalg.solve(free, c.T)).item() > 1 + DIGITS


def test_an_unbounded_range() -> None:
    P = propose_constrained(F, H, LOW, np.inf, objective=cp.lambda_max)
    assert P is not None
    assert prove_common(F, H, P, LOW, np.inf).outcome == "proved"


def test_constraints_cannot_save_an_unstable_family() -> None:
    assert propose_constrained(F, H, 0.6, HIGH) is None


def test_constraints_that_contradict_the_inequality() -> None:
    # P must shrink along the first state, where the jump doubles it: P = I does not
    assert propose_constrained(F, H, LOW, HIGH, lambda P: [P << np.eye(2)]) is None


def test_arguments() -> None:
    with pytest.raises(ValueError, match=r"0 <= low <= high is required; got \[2, 1\]"):
        propose_constrained(F, H, 2, 1)
    with pytest.raises(ValueError, match=r"slack_wanted must lie between 0 and 1; got 1\.5"):
        propose_constrained(F, H, LOW, HIGH, slack_wanted=1.5)
