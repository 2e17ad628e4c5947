"""Times between simulated events: in their range, each near the one before it."""

from __future__ import annotations

import math

import numpy as np

from obsdesign.data.simulation.event_spacings import jump_times
from tests.data.simulation.test_trajectory import plant


def test_random_dwell_times_obey_range_and_jitter() -> None:
    limited = plant(dwell_time=(0.5, 3.0), dwell_jitter=0.2)
    spacing = np.diff(jump_times(limited.events[0], "random", 500.0, np.random.default_rng(1)))
    assert spacing.min() >= 0.5 - 1e-9
    assert spacing.max() <= 3.0 + 1e-9
    assert np.abs(np.diff(spacing)).max() <= 0.2 + 1e-9
    assert spacing.max() - spacing.min() > 1.0  # it does wander
    free = np.diff(
        jump_times(
            plant(dwell_time=(0.5, math.inf)).events[0], "random", 500.0, np.random.default_rng(1)
        )
    )
    assert free.min() >= 0.5
