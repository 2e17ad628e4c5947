"""Plants with several clocks."""

from __future__ import annotations

import copy
from typing import Any

# amounts of a drug: absorbed doses, a bolus that a tenth of the tissue leaves with, two assays
DOSES: dict[str, Any] = {
    "name": "doses and two assays",
    "flow": {
        "A": [[-1, 0, 0], [1, -0.5, 0.2], [0, 0.3, -0.2]],
        "disturbance": {"lower": [0, -0.3, 0], "upper": [0, 0.3, 0]},
    },
    "event": [
        {
            "name": "dose", "E": [[1], [0], [0]], "every": [6, 14],
            "disturbance": {"lower": [-0.5, 0, 0], "upper": [0.5, 0, 0]},
        },
        {
            "name": "bolus", "G": [[1, 0, 0], [0, 1, 0], [0, 0, 0.9]], "every": [20, 40],
            "disturbance": {"lower": [0, 9, 0], "upper": [0, 10, 0]},
        },
    ],
    "sensor": [
        {"name": "plasma", "C": [[0, 0.05, 0]], "noise_bound": 0.02, "every": [0, "inf"]},
        {
            "name": "tissue", "C": [[0, 0, 1]], "noise_bound": [[-0.1, 0.2]], "every": 6,
            "jitter": 0.5, "losses": 1, "sees": "after",
        },
    ],
    "observer": {"kind": "set_membership"},
}  # fmt: skip


def two_clocks() -> dict[str, Any]:
    """A plant of [jump] and [output] that several kinds serve."""
    return {
        "name": "two tanks",
        "flow": {
            "A": [[-0.6, 0.1], [0.5, -0.4]],
            "disturbance": {"lower": [-0.01, -0.01], "upper": [0.01, 0.01]},
        },
        "jump": {
            "G": [[1, 0], [0, 0.9]], "dwell_time": [2, 5],
            "disturbance": {"lower": [0.09, 0], "upper": [0.11, 0]},
        },
        "output": {"C": [[0, 1]], "noise_bound": 0.02},
    }  # fmt: skip


def renamed(plain: dict[str, Any]) -> dict[str, Any]:
    """The same plant as one event `stroke` and one sensor `level`."""
    body = copy.deepcopy(plain)
    jump, output = body.pop("jump"), body.pop("output")
    jump["every"] = jump.pop("dwell_time")
    body["event"] = [{"name": "stroke", **jump}]
    body["sensor"] = [{"name": "level", "every": "continuous", **output}]
    return body
