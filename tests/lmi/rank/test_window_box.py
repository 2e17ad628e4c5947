"""Floats above an exponential, entry by entry; states that are not seen."""

from __future__ import annotations

import numpy as np
import pytest
from flint import arb, arb_mat, ctx

from lmi.arithmetic.balls import exact
from lmi.rank.stack import Stack
from lmi.rank.window_box import _exponential
from lmi.rank.witness import _check_vector


@pytest.mark.parametrize("size", [0.01, 0.2, 3.0, 20.0])
@pytest.mark.parametrize("shape", ["chain", "full"])
def test_an_exponential_is_bounded_in_every_entry(size: float, shape: str) -> None:
    """Of a chain of 20 states the last entries come from powers that the series leaves out."""
    n = 20 if shape == "chain" else 4
    X = np.diag(np.ones(n - 1), 1) if shape == "chain" else np.ones((n, n)) / n
    X = size * X
    above = _exponential(X)
    ctx.prec = 200
    exact = arb_mat([[arb(float(x)) for x in row] for row in X]).exp()
    for i in range(n):
        for j in range(n):
            assert arb(float(above[i, j])) >= exact[i, j].mid()
    assert above.max() <= 1.001 * float(max(exact.entries(), key=float)) + 1e-12


@pytest.mark.parametrize("size", [0.01, 1.0, 300.0])
def test_a_state_that_is_not_seen_has_its_largest_entry_one(size: float) -> None:
    unit, C = exact(np.eye(2)), exact([[1.0, 0.0]])
    still = Stack(exact(np.zeros((2, 2))), unit, C, unit, blocks=2)
    verdict = _check_vector(still, np.array([1.0]), size * np.eye(2))
    assert verdict.outcome == "refuted"
    assert np.abs(verdict.evidence["witness"]["null_vector"]) == pytest.approx([0.0, 1.0])
