"""Plants with clocks of their own whose widths are known: limits, simulated and published ones."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lmi.bounds.graph_proof import prove_graph
from lmi.find.graph_tube import proposed_tubes
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.analysis.interval.event_graph import stability_graph
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.problem.problem import Problem


def two_states(
    every: tuple[float, float], gap: float, noise: float = 0.03, sees: str = "before"
) -> dict[str, Any]:
    """Example 4.1 of Degue, Efimov, Richard without gains; x2 at samples of its own.

    The shortest time between jumps for which widths stay bounded is that of `shortest`.
    """
    flow, jump = [0.1, 0.1], [0.3, 0.3]
    return {
        "name": "two states",
        "flow": {"A": [[-1, 0], [1, -2]], "disturbance": _box(flow)},
        "event": [
            {"name": "hit", "G": [[2, 1], [1, 3]], "every": list(every), "disturbance": _box(jump)}
        ],
        "sensor": [
            {"name": "level", "C": [[0, 1]], "noise_bound": noise, "every": [0, gap], "sees": sees}
        ],
        "observer": {"kind": "interval"},
    }  # fmt: skip


def shortest(gap: float) -> float:
    """ln(3 - e^-g): with the last sample g before every jump the width neither grows nor decays."""
    return math.log(3 - math.exp(-gap))


def doses(gap: float, every: tuple[float, float] = (6, 14)) -> dict[str, Any]:
    """A drug in three compartments; plasma is sampled at least every `gap`."""
    return {
        "name": "doses",
        "flow": {
            "A": [[-1, 0, 0], [1, -0.5, 0.2], [0, 0.3, -0.2]],
            "disturbance": _box([0, 0.3, 0]),
        },
        "event": [
            {"name": "dose", "E": [[1], [0], [0]], "every": list(every),
             "disturbance": _box([4, 0, 0])},
        ],
        "sensor": [
            {"name": "plasma", "C": [[0, 0.05, 0]], "noise_bound": 0.02, "every": [0, gap]},
        ],
        "observer": {"kind": "interval"},
    }  # fmt: skip


def oral_doses(gap: float) -> dict[str, Any]:
    """Doses that come through transit compartments; plasma is sampled at least every `gap`."""
    flow = np.diag([-3.0, -3, -3, -1, -0.5, -0.2]) + np.diag([3.0, 3, 3, 1, 0.3], -1)
    flow[4, 5] = 0.2
    return {
        "name": "oral doses",
        "flow": {"A": flow.tolist(), "disturbance": _box([0, 0, 0, 0.2, 0.3, 0])},
        "event": [
            {"name": "dose", "every": [6, 14], "disturbance": _box([4, 0, 0, 0, 0, 0])},
        ],
        "sensor": [
            {"name": "plasma", "C": [[0, 0, 0, 0, 0.05, 0]], "noise_bound": 0.02,
             "every": [0, gap]},
        ],
        "observer": {"kind": "interval"},
    }  # fmt: skip


def motor(encoder: float, tacho: float) -> dict[str, Any]:
    """Position, speed, load; two sensors that are silent for at most these times."""
    return {
        "name": "motor",
        "flow": {
            "A": [[0, 1, 0], [0, -10, 1], [0, -0.02, -2]],
            "disturbance": _box([0, 0.2, 0.1]),
        },
        "sensor": [
            {"name": "encoder", "C": [[1, 0, 0]], "noise_bound": 0.005, "every": [0, encoder]},
            {"name": "tacho", "C": [[0, 1, 0]], "noise_bound": 0.02, "every": [0, tacho]},
        ],
        "observer": {"kind": "interval"},
    }  # fmt: skip


def positioning(speed: float, gps: float) -> dict[str, Any]:
    """Position, speed and the bias of an accelerometer; odometer and GPS."""
    return {
        "name": "positioning",
        "flow": {
            "A": [[0, 1, 0], [0, 0, 1], [0, 0, -0.01]],
            "disturbance": _box([0, 0.05, 0.001]),
        },
        "sensor": [
            {"name": "speed", "C": [[0, 1, 0]], "noise_bound": 0.05, "every": [0, speed]},
            {"name": "gps", "C": [[1, 0, 0]], "noise_bound": 1.0, "every": [0, gps]},
        ],
        "observer": {"kind": "interval"},
    }  # fmt: skip


def system_of(body: dict[str, Any]) -> ClockSystem:
    """Width maps of a problem without gains."""
    plant = Problem.from_dict(body).plant
    L, M = np.zeros((plant.n, plant.p)), np.zeros((len(plant.events), plant.n, plant.p))
    return ClockSystem(ClockedIntervalGains.from_plant(plant, L=L, M=M))


def is_stable(body: dict[str, Any], cells: int) -> bool:
    """Is a tube without inputs proposed on the graph of these clocks, and proved?"""
    return stable_tube(system_of(body), cells) is not None


def stable_tube(system: ClockSystem, cells: int) -> list[list[float]] | None:
    """A tube without inputs that is proved; None for none."""
    nodes = stability_graph(system, cells)
    assert nodes is not None
    for tube in proposed_tubes(nodes.graph, np.ones(len(system.f))):
        if prove_graph(nodes.graph, tube.tolist()).outcome == "proved":
            return tube.tolist()
    return None


def _box(radius: list[float]) -> dict[str, list[float]]:
    return {"lower": [-x for x in radius], "upper": radius}
