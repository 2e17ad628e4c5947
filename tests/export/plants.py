"""Designs that are exported in tests: one of each way a step can be."""

from __future__ import annotations

from typing import Any

from obsdesign.document import Design
from tests.systems.designs import designed

INF = float("inf")
ROTATION = {"A": [[-0.5, 1.0], [-1.0, -0.5]], "B": [[0.0], [1.0]]}
BOX = {"disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.2]}}
JUMP = {"G": [[0.9, 0.1], [0.0, 0.8]], "E": [[1.0], [0.0]], "dwell_time": [0.3, INF]}
OUTPUT = {"C": [[1.0, 0.0]], "noise_bound": [[-0.02, 0.04]]}
PERIODIC = {"measured": "periodic", "period": 0.1}


def problem(kind: str, output: dict[str, Any], jump: dict[str, Any] | None, **gains: Any) -> Any:
    """A problem in two states with inputs, named for the comments of C."""
    body: dict[str, Any] = {
        "name": "two rooms */ of a house", "flow": ROTATION | (BOX if kind == "interval" else {}),
        "output": OUTPUT | output, "observer": {"kind": kind} | gains,
        "names": {"states": ["position", "speed"], "units": {"position": "m"}, "time_unit": "s"},
    }  # fmt: skip
    return body | ({} if jump is None else {"jump": jump})


def windowed(flow: dict[str, Any], jump: dict[str, Any] | None = None, **output: Any) -> Any:
    """A plant that is known a window of samples after a jump."""
    body = {
        "flow": {"A": [[-0.5, 1.0], [-1.0, 0.1]]} | flow, "output": {"C": [[1.0, 0.0]], "measured":
        "periodic", "period": 0.1} | output, "observer": {"kind": "finite_time", "window": 0.5},
    }  # fmt: skip
    return body | ({} if jump is None else {"jump": jump | {"dwell_time": [1.0, INF]}})


def impulses(dwell: list[float], when: str, **options: Any) -> Any:
    """A plant that is measured at its jumps."""
    flow = {"A": [[-0.1, 1.0, 0.0], [0.0, -0.1, 1.0], [0.0, 0.0, -0.2]], "B": [[0], [0], [1]]}
    return {
        "flow": flow, "jump": {"G": [[1, 0, 0], [0, 0.9, 0], [0, 0, 1]], "dwell_time": dwell},
        "output": {"C": [[1, 0, 0]], "measured": "at_jumps", "jump_measurement": when},
        "observer": {"kind": "impulsive"} | options,
    }  # fmt: skip


UNKNOWN: dict[str, Any] = {
    "flow": {
        "A": [[-1.0, 0.5, 0.0], [0.2, -0.7, 0.3], [0.0, 0.1, -2.0]], "D": [[1.0], [0.0], [0.5]],
        "B": [[0.0], [1.0], [0.0]],
    },
    "output": {"C": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]}, "observer": {"kind": "unknown_input"},
}  # fmt: skip
PROBLEMS: dict[str, tuple[Any, tuple[float, ...]]] = {
    "continuous": (problem("interval", {}, None), (0.05, 0.02)),
    "jumps": (problem("interval", {}, JUMP), (0.05,)),
    "jumps_after": (problem("interval", {"jump_measurement": "after"}, JUMP), (0.05,)),
    "jumps_unseen": (problem("interval", {"jump_measurement": "none"}, JUMP), (0.05,)),
    "periodic": (problem("interval", PERIODIC, None), ()),
    "periodic_jumps": (problem("interval", PERIODIC, JUMP), ()),
    "periodic_after": (problem("interval", PERIODIC | {"jump_measurement": "after"}, JUMP), ()),
    "periodic_unseen": (problem("interval", PERIODIC | {"jump_measurement": "none"}, JUMP), ()),
    "point": (problem("luenberger", {}, JUMP | {"dwell_time": [0.3, 2.0]}), (0.05, 0.02)),
    "point_smooth": (problem("luenberger", {}, None), (0.05,)),
    "point_after": (problem("luenberger", {"jump_measurement": "after"}, JUMP), (0.05,)),
    "point_jitter": (
        problem("luenberger", {}, JUMP | {"dwell_time": [0.3, 2.0], "dwell_jitter": 0.1}), (0.05,)
    ),
    "window": (windowed({}), ()),
    "window_driven": (windowed({"B": [[0.0], [1.0]]}), ()),
    "window_jumps": (windowed({"B": [[0.0], [1.0]]}, JUMP), ()),
    "window_after": (windowed({}, JUMP, jump_measurement="after"), ()),
    "unknown": (UNKNOWN, (0.05, 0.1)),
} | {
    name: (impulses(dwell, when, **options), (0.1,))
    for name, dwell, when, options in (
        ("impulses", [0.2, 0.4], "before", {}),
        ("impulses_equal", [0.3, 0.3], "after", {"window": 4}),
        ("impulses_table", [0.2, 0.3], "before", {"strategy": "quadratic"}),
    )
}  # fmt: skip


def design_named(name: str) -> tuple[Design, tuple[float, ...]]:
    """The design of a problem, and the steps that it is exported for."""
    body, steps = PROBLEMS[name]
    return designed(body, allow_undecided=True), steps
