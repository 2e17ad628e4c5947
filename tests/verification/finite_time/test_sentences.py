"""Claims name the windows and the states that they are about."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.balls import precision, scalar
from obsdesign.verification.finite_time import gains as verification
from obsdesign.verification.finite_time.theorem_1 import shorter_windows_claim


def test_shorter_windows_are_counted_from_the_first_to_the_last() -> None:
    A, C, L = np.array([[1.0]]), np.array([[1.0]]), np.array([[-1e-3]])
    claim = shorter_windows_claim(A, C, L, 0.5, range(2, 5))
    assert claim.evidence["samples"] == [2, 4]
    assert "is false at period 0.5 for windows of 2 to 4 samples" in claim.statement
    assert claim.verdict == "proved"


@pytest.mark.parametrize(
    ("radius", "verdict"),
    [(2.5, "undecided"), (1.9, "refuted"), (3.000001, "proved"), (30.0, "refuted")],
)
def test_a_radius_beside_the_largest_error(
    monkeypatch: pytest.MonkeyPatch, radius: float, verdict: str
) -> None:
    with precision(64):
        bounds = [scalar(1), scalar(2).union(scalar(3))]
    monkeypatch.setattr(verification, "error_radius", lambda *_: bounds)
    gains: Any = SimpleNamespace(
        flow_lower=np.zeros(2), flow_upper=np.zeros(2), window_gain=None, noise=None,
        error_bound=np.array([1.0, radius]),
    )  # fmt: skip
    claim = verification.error_radius_claim(None, gains)
    assert claim.verdict == verdict
    if verdict == "undecided":
        assert claim.evidence["reason"] == "radius of x2 is too close to the largest error"
    if verdict == "refuted":
        witness = claim.evidence["witness"]
        assert witness["state"] == 2
        assert "the estimate of x2 " in witness["reason"]
