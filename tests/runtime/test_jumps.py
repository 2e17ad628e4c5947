"""Jumps of point estimates and of bounds, by their formulas."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.runtime.interval.maps import jump_maps
from obsdesign.runtime.interval.model import observer_model
from obsdesign.runtime.jump import corrected_jump

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("when", ["before", "after", "none"])
@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("measured", [False, True])
def test_a_jump_is_that_of_the_plant_and_is_corrected(
    when: str, known: bool, measured: bool
) -> None:
    rng = np.random.default_rng(0)
    G, C, M = rng.standard_normal((2, 2)), rng.standard_normal((1, 2)), rng.standard_normal((2, 1))
    E, drift = rng.standard_normal((2, 1)), rng.standard_normal(2)
    x, w, y = rng.standard_normal(2), np.array([3.0]), np.array([-1.5])
    gains: Any = SimpleNamespace(jump_matrix=G, jump_drift=drift, E=E, C=C, jump_measurement=when)
    after = G @ x + drift + (E @ w if known else 0.0)
    if measured and when != "none":
        after = after + M @ (y - C @ (x if when == "before" else after))
    jumped = corrected_jump(gains, x, w if known else None, y if measured else None, M)
    np.testing.assert_allclose(jumped, after, rtol=1e-12)
    with pytest.raises(ValueError, match="w must have 1 entries; got 2"):
        corrected_jump(gains, x, [1.0, 2.0])


def test_a_jump_without_its_measurement_widens_bounds_by_the_jump_alone() -> None:
    """The stored split is that of G - M C: without y a jump has the smallest one, |G|."""
    design = obsdesign.design(obsdesign.load_problem(EXAMPLES / "degue_4_1.toml"))
    gains = IntervalGains.from_document(design.gains)
    assert gains.Gp is not None
    gains = replace(gains, Gp=gains.Gp + 0.5)  # above the error's matrix: a wide bound is one
    maps = jump_maps(observer_model(gains), gains)
    assert set(maps) == {False, True}
    size = np.abs(gains.jump_matrix)
    assert (size <= maps[False].R).all()
    assert (size * (1 + 1e-12) >= maps[False].R).all()
    error = np.abs(gains.jump_matrix - gains.M @ gains.C)
    assert (error * (1 - 1e-12) <= maps[True].R).all()
