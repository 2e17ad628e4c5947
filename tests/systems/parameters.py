"""Plants with parameters, as dicts of a problem file."""

from __future__ import annotations

import copy
from typing import Any

Body = dict[str, Any]


def spring(**entries: Any) -> Body:
    """Spring and damper with an uncertain stiffness, kicked every 2 to 6; y = position."""
    body: Body = {
        "flow": {
            "A": [[0, 1], [0, -0.4]],
            "disturbance": {"lower": [0, -0.05], "upper": [0, 0.05]},
        },
        "jump": {
            "disturbance": {"lower": [0, -0.3], "upper": [0, 0.3]},
            "dwell_time": [2, 6],
        },
        "output": {"C": [[1, 0]], "noise_bound": [0.01]},
        "parameter": [{"name": "stiffness", "range": [0.8, 1.2], "A": [[0, 0], [-1, 0]]}],
        "state": {"lower": [-1.2, -1.2], "upper": [1.2, 1.2]},
        "observer": {"kind": "interval", "gains": {"L": [[2], [-1]], "M": [[1], [0]]}},
    }
    return copy.deepcopy(body) | copy.deepcopy(entries)


def degue(share: float, dwell_time: object = (5, 5)) -> Body:
    """Example 4.1 with the gains of the paper, every entry of A and G known up to a share of it."""
    A, G = [[-1.0, 0.0], [1.0, -2.0]], [[2.0, 1.0], [1.0, 3.0]]
    return {
        "flow": {
            "A": A,
            "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]},
            "A_radius": [[share * abs(entry) for entry in row] for row in A],
        },
        "jump": {
            "G": G,
            "disturbance": {"lower": [-0.3, -0.3], "upper": [0.3, 0.3]},
            "dwell_time": list(dwell_time),  # type: ignore[call-overload]
            "G_radius": [[share * entry for entry in row] for row in G],
        },
        "output": {"C": [[0, 1]], "noise_bound": [0.03]},
        "observer": {"kind": "interval", "gains": {"L": [[0], [1]], "M": [[1], [2.8]]}},
    }


def rooms(**entries: Any) -> Body:
    """Two rooms that exchange heat at an uncertain rate, through a door too; y = first room."""
    body: Body = {
        "flow": {
            "A": [[-0.1, 0], [0, -0.15]],
            "disturbance": {"lower": [2.15, 2.55], "upper": [2.25, 2.65]},
        },
        "jump": {
            "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]},
            "dwell_time": [1, 4],
        },
        "output": {"C": [[1, 0]], "noise_bound": [0.05]},
        "parameter": [
            {"name": "exchange", "range": [0.5, 1.5], "A": [[-1, 1], [1, -1]]},
            {"name": "door", "range": [0.1, 0.3], "G": [[-1, 1], [1, -1]]},
        ],
        "state": {"lower": [18, 18], "upper": [24, 24]},
        "observer": {"kind": "interval", "gains": {"L": [[3], [0.5]], "M": [[0.7], [0.1]]}},
    }
    return copy.deepcopy(body) | copy.deepcopy(entries)


def compartments() -> Body:
    """Two compartments, an uncertain clearance, doses of 100 every 6 to 12 hours; y = plasma."""
    return {
        "flow": {
            "A": [[-0.5, 0.2], [0.3, -0.2]],
            "disturbance": {"lower": [-0.3, 0], "upper": [0.3, 0]},
        },
        "jump": {
            "disturbance": {"lower": [96, 0], "upper": [104, 0]},
            "dwell_time": [6, 12],
        },
        "output": {"C": [[0.05, 0]], "noise_bound": [0.02]},
        "parameter": [{"name": "clearance", "range": [-0.06, 0.06], "A": [[-1, 0], [0, 0]]}],
        "state": {"lower": [-165, -140], "upper": [165, 140]},
        "observer": {"kind": "interval", "gains": {"L": [[20], [2]], "M": [[0], [0]]}},
    }
