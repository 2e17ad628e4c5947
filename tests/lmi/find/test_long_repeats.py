"""Sequences that destabilise by many repeats of one dwell time, and their twins."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from lmi.decide.stability import decide
from lmi.verdict import Verdict
from tests.systems.pairs import SAMPLED

# ten dwell times of 0.206 and one of 1.0 have spectral radius 1.00477; 0.21371 is proved
LOW, HIGH = 0.209, 1.0


def radius(F: np.ndarray, H: np.ndarray, verdict: Verdict) -> float:
    product = np.eye(len(F))
    for theta in verdict.evidence["witness"]["thetas"]:
        product = expm(F * float(theta)) @ H @ product
    return float(np.abs(np.linalg.eigvals(product)).max())


def test_ten_short_dwell_times_and_a_long_one() -> None:
    F, H = (np.asarray(X, dtype=float) for X in SAMPLED)
    word = expm(F) @ H @ np.linalg.matrix_power(expm(F * 0.206) @ H, 10)
    assert np.abs(np.linalg.eigvals(word)).max() == pytest.approx(1.00477, abs=5e-6)
    verdict = decide(F, H, LOW, HIGH)
    assert verdict.outcome == "refuted"
    assert len(verdict.evidence["witness"]["thetas"]) > 6
    assert radius(F, H, verdict) >= 1


@pytest.mark.parametrize("case", ["transposed", "faster", "other coordinates"])
def test_the_same_family_is_refuted_too(case: str) -> None:
    F, H = (np.asarray(X, dtype=float) for X in SAMPLED)
    scale = 4.0 if case == "faster" else 1.0
    if case == "transposed":  # words read backwards
        F, H = F.T, H.T
    if case == "other coordinates":
        T = np.array([[1.0, 0.5, 0.0], [-0.25, 2.0, 0.1], [0.3, 0.0, 1.0]])
        F, H = (np.linalg.solve(T, X @ T) for X in (F, H))
    verdict = decide(F * scale, H, LOW / scale, HIGH / scale)
    assert verdict.outcome == "refuted"
    assert radius(F * scale, H, verdict) >= 1


def test_a_slightly_smaller_jump_is_not_refuted() -> None:
    """The twin: growth per jump is 1.0004 at most here, and 0.99 of it decays."""
    F, H = (np.asarray(X, dtype=float) for X in SAMPLED)
    assert decide(F, 0.99 * H, LOW, HIGH).outcome != "refuted"
