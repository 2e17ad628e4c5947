"""Declared bounds of disturbances and noise, and what is refused beside them."""

from __future__ import annotations

import re

import numpy as np
import pytest

from obsdesign.runtime.bounds import declared_noise


@pytest.mark.parametrize(("low", "got"), [(-0.1, 0.4), (-0.10001, 0.3)])
def test_a_refusal_shows_the_bounds_as_they_are_declared(low: float, got: float) -> None:
    """Stored as middle and radius, they are rounded outward."""
    declared = declared_noise(np.array([0.2]), np.array([0.1]))
    assert declared.lower[0] < -0.1
    value = got if got > 0.3 else low
    with pytest.raises(ValueError, match=re.escape(f"bounds [-0.1, 0.3]; got {value}.")):
        declared.completed(([low], [got]))
    declared.completed(([-0.1], [0.3]))
