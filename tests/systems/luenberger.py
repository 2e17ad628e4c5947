"""A plant with jumps for tests of point observers, as a file would have it."""

from __future__ import annotations

import copy
from typing import Any

import obsdesign

BASE: dict[str, Any] = {
    "flow": {"A": [[0, 1, 0], [-2, 0.1, 0.5], [0, 0, 0.2]]},
    "jump": {"G": [[1, 0, 0], [0, -0.7, 0], [0.1, 0, 1]], "dwell_time": [0.3, 2.0]},
    "output": {"C": [[1, 0, 0], [0, 0, 1]]},
    "observer": {"kind": "luenberger"},
}


def problem(**changes: Any) -> obsdesign.Problem:
    """The plant with other entries, named block__key."""
    body = copy.deepcopy(BASE)
    for path, value in changes.items():
        block, key = path.split("__")
        body[block][key] = value
    return obsdesign.Problem.from_dict(body)
