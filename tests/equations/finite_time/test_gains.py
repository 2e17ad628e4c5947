"""Gains of windows of samples: what does not fit is refused with the shape that is needed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from obsdesign.equations.finite_time.gains import FiniteTimeGains

PLAIN: dict[str, Any] = {
    "A": np.eye(3), "C": np.eye(3)[:2], "flow_lower": np.zeros(3), "flow_upper": np.zeros(3),
    "jump_measurement": "none", "period": 0.5, "method": "exact", "samples": 4,
    "window_gain": np.zeros((3, 8)), "state_error": np.zeros((3, 3)), "L": np.zeros((3, 2)),
}  # fmt: skip


def test_numbers_of_a_window() -> None:
    gains = FiniteTimeGains(**PLAIN)
    assert gains.window == 2.0
    assert gains.samples == 4
    assert gains.is_unbiased
    assert not gains.is_relative_to_start
    assert FiniteTimeGains(**PLAIN, reference="start").is_relative_to_start


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"window_gain": np.zeros((3, 4))}, r"must have shape \(3, 8\); got shape \(3, 4\)."),
        ({"samples": 3}, r"must have shape \(3, 6\); got shape \(3, 8\)."),
        ({"samples": 0}, "samples must be a whole number >= 1; got 0"),
        ({"samples": 4.5}, "samples must be a whole number >= 1; got 4.5"),
        ({"period": 0.0}, "period must be a positive number; got 0.0"),
        ({"period": float("inf")}, "period must be a positive number; got inf"),
        ({"state_error": None}, "state_error is missing: method 'exact' needs it"),
        ({"method": "approximate"}, "half_sample is missing: method 'approximate' needs it"),
        ({"method": "least_squares"}, "deviations is missing: method 'least_squares' needs it"),
        ({"radius": np.ones(3)}, "noise_bound is missing: method 'exact' needs it"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"gains.*{message}"):
        FiniteTimeGains(**PLAIN | changes)
