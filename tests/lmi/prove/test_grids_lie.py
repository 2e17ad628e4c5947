"""Families that hold on every grid point and fail between: never proved.

A block that rotates a whole number of turns per grid step looks constant on that grid: there it is
seen at its best angle only. Between the points the same map is far above 1.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from lmi.arithmetic.exponential import expm
from lmi.decide.stability import decide
from lmi.prove.common_matrix import METHODS, prove_common

LOW, HIGH = 0.0, 1.0


def trap(n: int, turns: int) -> tuple[np.ndarray, np.ndarray]:
    """e^{F theta} H with norm 0.5 at theta = k / turns and 2 in between; n states."""
    F = np.zeros((n, n))
    for i in range(0, n - 1, 2):
        F[i, i + 1], F[i + 1, i] = 2 * math.pi * turns, -2 * math.pi * turns
    F -= 0.05 * np.eye(n)
    # along the axis the image is halved; a quarter of a turn later it meets the factor 2
    H = 0.3 * np.eye(n)
    H[0, 0], H[0, 1] = 0.5, 2.0
    H[1] = 0.0
    return F, H


@pytest.mark.parametrize("n", range(2, 9))
@pytest.mark.parametrize("turns", [16, 50, 100, 200, 400])
def test_what_holds_on_a_grid_only_is_never_proved(n: int, turns: int) -> None:
    F, H = trap(n, turns)
    on_grid = expm(F * (np.arange(turns + 1) / turns)[:, None, None]) @ H
    assert np.abs(np.linalg.eigvals(on_grid)).max() < 1  # every grid point is harmless
    quarter = (np.arange(turns) + 0.75) / turns
    assert np.abs(np.linalg.eigvals(expm(F * quarter[:, None, None]) @ H)).max() > 1
    assert decide(F, H, LOW, HIGH).outcome == "refuted"


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("n", [2, 5, 8])
def test_a_certificate_that_holds_on_the_grid_is_not_taken_for_a_proof(method: str, n: int) -> None:
    F, H = trap(n, 100)
    P = np.eye(n)
    P[0, 0] = 16.0
    if n > 1:
        P[1, 1] = 300.0
    grid = expm(F * (np.arange(101) / 100)[:, None, None]) @ H
    slack = [np.linalg.eigvalsh(P - M.T @ P @ M)[0] for M in grid]
    assert min(slack) > 0
    assert prove_common(F, H, P, LOW, HIGH, method=method, steps=2000).outcome == "undecided"


@pytest.mark.parametrize("n", range(2, 9))
def test_the_twin_without_the_trap_is_proved(n: int) -> None:
    F, H = trap(n, 100)
    H[0, 1] = 0.2
    assert decide(F, H, LOW, HIGH).outcome == "proved"
