from __future__ import annotations

import math

import numpy as np
import pytest

from lmi.arithmetic.balls import PRECISIONS, exact
from lmi.refute.spectral import _settled, refute_spectral
from tests.systems.pairs import (
    LONGEST,
    LONGEST_END,
    PAPER_41,
    PLANT_41,
    RANGE,
    RANGE_ENDS,
    SHORTEST_41,
    SHORTEST_43,
    SHORTEST_PLANT_41,
    WIDTH_43,
    radius,
)

NARROW = 1e-7  # relative distance to a threshold at which both answers are asked for


@pytest.mark.parametrize(
    ("pair", "threshold"),
    [(PAPER_41, SHORTEST_41), (PLANT_41, SHORTEST_PLANT_41), (WIDTH_43, SHORTEST_43)],
)
def test_refuted_below_the_shortest_dwell_time(pair: tuple, threshold: float) -> None:
    verdict = refute_spectral(*pair, threshold * (1 - NARROW), math.inf)
    assert verdict.outcome == "refuted"
    witness = verdict.evidence["witness"]
    assert threshold * (1 - NARROW) <= witness["theta"] <= threshold
    assert radius(*pair, witness["theta"]) >= 1 - 1e-12
    # the twin
    verdict = refute_spectral(*pair, threshold * (1 + NARROW), math.inf)
    assert verdict.outcome == "undecided"
    assert verdict.evidence["spectral_radius"] < 1
    assert verdict.evidence["reason"].startswith("largest spectral radius seen is ")


def test_the_printed_witness() -> None:
    witness = refute_spectral(*PAPER_41, 0.6580, math.inf).evidence["witness"]
    assert witness["theta"] == 0.6580
    assert witness["spectral_radius"] == pytest.approx(1.035772, abs=5e-7)
    assert witness["method"] == "det(I - M) < 0: a real eigenvalue above 1"


def test_both_ends_of_a_range() -> None:
    low, high = RANGE_ENDS
    assert refute_spectral(*RANGE, low * (1 - NARROW), 0.4).outcome == "refuted"
    assert refute_spectral(*RANGE, 0.4, high * (1 + NARROW)).outcome == "refuted"
    assert refute_spectral(*RANGE, low * (1 + NARROW), high * (1 - NARROW)).outcome == "undecided"
    assert refute_spectral(*LONGEST, 0.1, LONGEST_END * (1 + NARROW)).outcome == "refuted"
    assert refute_spectral(*LONGEST, 0.1, LONGEST_END * (1 - NARROW)).outcome == "undecided"


@pytest.mark.parametrize(
    ("F", "H", "method"),
    [
        ([[-0.1]], [[1.5]], "det(I - M) < 0"),
        ([[-0.1]], [[-1.5]], "det(I + M) < 0"),
        ([[0, 2], [-2, 0]], [[1.01, 0], [0, 1.01]], "Schur-Cohn test"),  # a complex pair
        ([[0.3, 1, 0], [-1, 0.3, 0], [0, 0, 0.3]], np.eye(3) * 0.9, ""),
    ],
)
def test_every_way_to_be_unstable(F: list, H: list, method: str) -> None:
    F, H = np.array(F, dtype=float), np.array(H, dtype=float)
    verdict = refute_spectral(F, H, 0.5, 1.0)
    assert verdict.outcome == "refuted"
    assert verdict.evidence["witness"]["method"].startswith(method)
    assert refute_spectral(F, 0.5 * H, 0.5, 1.0).outcome == "undecided"


@pytest.mark.parametrize(
    ("F", "H"),
    [
        ([[0, 0], [0, -1]], [[1, 0], [0, 0.1]]),
        ([[0, 1], [0, -1]], [[1, 7], [0, 0.1]]),
        ([[-1, 0], [1, 0]], [[0.1, 0], [7, 1]]),  # a row vector is left in place
    ],
)
def test_a_state_that_stays_is_refuted_exactly(F: list, H: list) -> None:
    F, H = np.array(F, dtype=float), np.array(H, dtype=float)
    verdict = refute_spectral(F, H, 0.5, 1.0)
    assert verdict.outcome == "refuted"
    assert verdict.evidence["witness"]["method"] == "exact invariant vector"
    # the twin: one unit in the last place less
    nearly = np.where(H == 1, np.nextafter(1.0, 0.0), H)
    assert refute_spectral(F, nearly, 0.5, 1.0).outcome == "undecided"


def test_dwell_time_zero_is_decided_exactly() -> None:
    F, H = -np.eye(2), np.array([[0.0, 1], [-1, 0]])  # eigenvalues +-i: exactly on the circle
    verdict = refute_spectral(F, H, 0.0, 1.0)
    assert verdict.outcome == "refuted"
    assert verdict.evidence["witness"]["theta"] == 0.0
    assert refute_spectral(F, np.nextafter(1.0, 0.0) * H, 0.0, 1.0).outcome == "undecided"
    assert refute_spectral(F, H, 1e-3, 1.0).outcome == "undecided"


def test_a_peak_between_coarse_grid_points() -> None:
    # e^{F theta} turns 300 times; the radius exceeds one on one narrow set per turn only
    omega = 2 * math.pi * 300
    F = np.array([[0.0, omega], [-omega, 0.0]])
    H = np.array([[1.001, 0.0], [0.0, -0.3]])
    verdict = refute_spectral(F, H, 0.2, 1.2)
    assert verdict.outcome == "refuted"
    assert radius(F, H, verdict.evidence["witness"]["theta"]) >= 1 - 1e-9


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_form_that_flow_and_jumps_leave_alone_refutes(sign: float) -> None:
    rotation = np.array([[0.0, 1.0], [-2.0, 0.0]])  # 2 x1^2 + x2^2 stays
    F = np.zeros((3, 3))
    F[:2, :2], F[2, 2] = rotation, -1.0
    H = np.diag([sign, sign, 0.5])
    S = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0]])
    S_inverse = np.array([[1.0, -2.0, -2.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    verdict = refute_spectral(S_inverse @ F @ S, S_inverse @ H @ S, 0.5, 2.0)
    assert verdict.outcome == "refuted"
    assert verdict.evidence["witness"]["method"] == "exact invariant form"
    Q = np.array(verdict.evidence["witness"]["Q"])
    F, H = S_inverse @ F @ S, S_inverse @ H @ S
    assert np.allclose(F.T @ Q + Q @ F, 0)
    assert np.allclose(H.T @ Q @ H, Q)
    # twins that shrink a little, along the flow or at jumps
    assert refute_spectral(F - 1e-6 * np.eye(3), H, 0.5, 2.0).outcome == "undecided"
    assert refute_spectral(F, (1 - 1e-6) * H, 0.5, 2.0).outcome == "undecided"


def test_what_no_precision_tells_names_the_highest() -> None:
    """A rotation by 1: two eigenvalues on the circle, neither of them real."""
    turn, unit = exact([[0.0, 1.0], [-1.0, 0.0]]), exact(np.eye(2))
    assert _settled(turn, unit, 1.0) == (None, "", max(PRECISIONS))
    assert _settled(turn, exact(0.5 * np.eye(2)), 1.0)[0] is True
