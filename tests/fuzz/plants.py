"""Small plants of every kind whose designs and proofs take milliseconds."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

BALL = {
    "A": [[-1.0, 0.0], [1.0, -2.0]],
    "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]},
}

PROBLEMS: dict[str, dict[str, Any]] = {
    "interval": {
        "name": "interval",
        "flow": BALL | {"B": [[0.0], [1.0]]},
        "jump": {"G": [[2.0, 1.0], [1.0, 3.0]], "E": [[0.0], [1.0]], "dwell_time": [0.7, 2.0],
                 "disturbance": {"lower": [-0.3, -0.3], "upper": [0.3, 0.3]}},
        "output": {"C": [[0.0, 1.0]], "noise_bound": [0.03], "jump_measurement": "before"},
        "observer": {"kind": "interval", "form": "split", "gains": {"L": [[0.0], [1.0]], "M": [[1.0], [2.8]]}},
    },
    "sampled": {
        "name": "sampled",
        "flow": BALL,
        "output": {"C": [[0.0, 1.0]], "noise_bound": 0.03, "measured": "periodic", "period": 0.1},
        "observer": {"kind": "interval", "form": "split", "gains": {"L": [[0.1], [0.5]]}},
    },
    "luenberger": {
        "name": "luenberger",
        "flow": {"A": [[-1.0, 0.0], [1.0, -2.0]]},
        "jump": {"G": [[1.1, 0.0], [0.0, 0.9]], "dwell_time": [0.5, 1.0], "dwell_jitter": 0.5},
        "output": {"C": [[0.0, 1.0]], "noise_std": [0.1]},
        "observer": {"kind": "luenberger", "gains": {"L": [[0.2], [1.0]], "M": [[0.0], [0.3]]}},
    },
    "impulsive": {
        "name": "impulsive",
        "flow": {"A": [[0.0, 1.0], [0.0, 0.0]]},
        "jump": {"dwell_time": [0.9, 1.1]},
        "output": {"C": [[1.0, 0.0]], "measured": "at_jumps"},
        "observer": {"kind": "impulsive", "strategy": "full", "window": 3, "alpha": 1.2},
    },
    "finite_time": {
        "name": "finite_time",
        "flow": {"A": [[0.0, 1.0], [-1.0, -0.2]], "B": [[0.0], [1.0]],
                 "disturbance": {"lower": [0.0, -0.1], "upper": [0.0, 0.1]}},
        "output": {"C": [[1.0, 0.0]], "noise_bound": [0.01], "measured": "periodic", "period": 0.1},
        "observer": {"kind": "finite_time", "window": 0.4, "method": "least_squares"},
    },
    "impulsive_input": {
        "name": "impulsive_input",
        "flow": {"A": [[-1.0, 0.0], [1.0, -2.0]]},
        "jump": {"H": [[1.0], [0.0]], "dwell_time": [2.0, 5.0]},
        "output": {"C": [[0.0, 1.0]], "measured": "periodic", "period": 0.05},
        "observer": {"kind": "impulsive_input", "window": 1.0, "operator": "integral", "margin": 0.25,
                     "exponents": [0.5, 1.0, 2.0, 3.0], "gains": {"K": [[0.1], [0.2]]}},
    },
    "unknown_input": {
        "name": "unknown_input",
        "flow": {"A": [[-1.0, 0.5, 0.0], [1.0, -2.0, 0.1], [0.0, 0.3, -3.0]], "D": [[1.0], [0.0], [0.5]]},
        "output": {"C": [[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]], "measured": "periodic", "period": 0.1},
        "observer": {"kind": "unknown_input", "poles": [-4.0, -5.0]},
    },
}  # fmt: skip

# the shipped examples, of any size
SHIPPED: dict[str, dict[str, Any]] = {
    path.stem: tomllib.loads(path.read_text("utf-8"))
    for path in sorted((Path(__file__).parents[2] / "examples").glob("*.toml"))
}

# names that an entry of a problem may be given
KEYS = (
    "A", "B", "C", "D", "E", "G", "H", "L", "M", "K", "S", "T1", "S2", "T", "D0", "D1", "Gp", "Gn",
    "noise_bound", "noise_std", "noise_cv", "period", "measured", "jump_measurement", "dwell_time",
    "dwell_jitter", "disturbance", "lower", "upper", "window", "alpha", "form", "objective", "poles",
    "decay_rate", "weights", "gain_limit", "width", "width_weights", "memory", "schedule", "kind",
    "method", "margin", "ratio", "exponents", "strategy", "noise_target", "differentiator",
    "threshold", "operator", "nonnegative", "state_correction", "flow", "jump", "output", "observer",
    "unknown",
)  # fmt: skip
