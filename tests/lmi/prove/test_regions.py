"""Norms and regions of eigenvalues are decided exactly, borders included."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.balls import exact
from lmi.prove.regions import prove_disc, prove_half_plane, prove_norm, prove_sector

ROTATION = np.array([[-1.0, 1.0], [-1.0, -1.0]])  # eigenvalues -1 +- i


@settings(max_examples=16, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 5), share=st.floats(0.5, 1.5))
def test_decisions_agree_with_floats_away_from_the_border(seed: int, n: int, share: float) -> None:
    if abs(share - 1) < 1e-6:
        return
    word = "proved" if share > 1 else "refuted"
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((n, 3))
    assert prove_norm(exact(X), share * float(np.linalg.norm(X, 2))).outcome == word
    F = rng.standard_normal((n, n)) - 4 * np.eye(n)
    modes = np.linalg.eigvals(F)
    border = float(-modes.real.max())
    assert prove_half_plane(exact(F), border / share).outcome == word or border < 0
    radius = float(abs(modes + 3).max())
    assert prove_disc(exact(F), -3.0, share * radius).outcome == word
    widest = float(abs(np.angle(-modes)).max())
    if 1e-3 < share * widest < math.pi / 2 - 1e-3:
        assert prove_sector(exact(F), share * widest).outcome == word


def test_borders_are_outside_of_regions_and_inside_of_norms() -> None:
    assert prove_norm(exact([[3.0, 0.0], [0.0, 4.0]]), 4.0).outcome == "proved"
    # (1, 1) has norm sqrt 2, which no float is: the next float below and above it
    row = exact([[1.0, 1.0]])
    root = math.sqrt(2)
    ends = sorted([root, math.nextafter(root, 2), math.nextafter(root, 0)])
    words = [prove_norm(row, end).outcome for end in ends]
    assert words == sorted(words, reverse=True)
    assert set(words) == {"proved", "refuted"}
    assert prove_half_plane(exact(ROTATION), 1.0).outcome == "refuted"
    assert prove_disc(exact(ROTATION), -1.0, 1.0).outcome == "refuted"
    # a quarter of pi is no float: below it the eigenvalue is outside
    assert prove_sector(exact(ROTATION), math.pi / 4 * (1 - 1e-12)).outcome == "refuted"
    assert prove_sector(exact(ROTATION), math.pi / 4 * (1 + 1e-12)).outcome == "proved"


@pytest.mark.parametrize("half_angle", [1e-3, 0.7, 1.57])
def test_an_eigenvalue_at_zero_is_in_no_sector(half_angle: float) -> None:
    assert prove_sector(exact(np.diag([-1.0, 0.0])), half_angle).outcome == "refuted"
    assert prove_sector(exact(np.diag([-1.0, -2.0])), half_angle).outcome == "proved"
