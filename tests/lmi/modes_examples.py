"""Switched plants of the literature: pairs of modes with known minimum dwell times."""

from __future__ import annotations

import math

from lmi.modes import Modes

INF = math.inf
FLOWS: dict[str, tuple[list[list[float]], ...]] = {
    "W48": ([[0, 1], [-10, -1]], [[0, 1], [-0.1, -0.5]]),
    "W49": ([[0, 1], [-2, -1]], [[0, 1], [-9, -1]]),
    "W50": ([[-1, -1, 1], [-1, -1, 0], [-2, 1, -1]], [[-1, 0, 6], [-2, -1, -5], [0, 3, -1]]),
    # the second mode is unstable: how long may it last?
    "W60": ([[-2, 1], [5, -3]], [[0.1, 0], [0.1, 0.2]]),
}


def switched(name: str, shortest: float) -> Modes:
    """Two modes, each for at least `shortest`."""
    return Modes.from_flows(FLOWS[name], [(shortest, INF)] * 2)


def unstable_second(shortest: float, longest: float) -> Modes:
    """W60: at least `shortest` in the first mode, at most `longest` in the second."""
    return Modes.from_flows(FLOWS["W60"], [(shortest, INF), (0.001, longest)])
