"""Problems of kind `set_membership` with a nominal pattern, and records without any innovation."""

from __future__ import annotations

from typing import Any

import numpy as np

from obsdesign.problem.problem import Problem
from obsdesign.runtime.base import Sample
from tests.systems.set_membership import cases


def body_of(
    name: str, period: float | None = None, dwell: list[float] | None = None, **options: Any
) -> dict[str, Any]:
    """The problem of a case: samples every period (at jumps only without one), jumps by dwell."""
    case = cases()[name]
    output: dict[str, Any] = {"C": case.C.tolist(), "noise_bound": case.V.tolist()}
    body = {
        "name": name, "output": output, "observer": {"kind": "set_membership", **options},
        "flow": {"A": case.A.tolist(), "disturbance": _box(case.b)},
    }  # fmt: skip
    output |= {"measured": "periodic", "period": period} if period else {"measured": "at_jumps"}
    if dwell is not None:
        body["jump"] = {"G": case.G.tolist(), "disturbance": _box(case.c), "dwell_time": dwell}
    return body


def problem_of(*args: Any, **options: Any) -> Problem:
    """The problem of `body_of`."""
    return Problem.from_dict(body_of(*args, **options))


def silent_samples(period: float, every: int, count: int, p: int) -> list[Sample]:
    """Measurements of the state zero without noise, a jump with every so many of them (0: none)."""
    y = np.zeros(p)
    return [
        Sample(k * period, y, jump=every > 0 and k > 0 and k % every == 0) for k in range(count)
    ]


def _box(pair: Any) -> dict[str, Any]:
    middle, radius = pair
    return {"lower": (middle - radius).tolist(), "upper": (middle + radius).tolist()}
