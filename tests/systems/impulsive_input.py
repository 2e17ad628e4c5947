"""Random plants with impulses, exact records, and what an observer finds in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.runtime import Estimate, from_design
from obsdesign.runtime.base import rows_of

Train = Sequence[tuple[float, Any]]


def record(
    A: Any, H: Any, train: Train, times: Any, initial: Any, forced: Any = None
) -> np.ndarray:
    """States at the times, (rows, n), after every impulse up to then; `forced` is a constant B u."""
    n = len(A)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n] = A
    if forced is not None:
        block[:n, n] = forced
    z, now = np.append(np.asarray(initial, float), 1.0), float(times[0])
    coming = sorted((float(t), np.atleast_1d(np.asarray(g, float))) for t, g in train)
    states, steps = [], {}
    for t in times:
        while coming and coming[0][0] <= t:
            moment, weight = coming.pop(0)
            z = expm(block * (moment - now)) @ z
            z[:n] += np.asarray(H) @ weight
            now = moment
        h = round(float(t) - now, 12)
        if h not in steps:
            steps[h] = expm(block * h)
        z, now = steps[h] @ z, float(t)
        states.append(z[:n].copy())
    return np.array(states)


def rows_from(observer: Any, t: Any, y: Any, u: Any = None, **initial: Any) -> list[Estimate]:
    """All rows of a record in blocks, which also carry the events."""
    samples = list(rows_of(t, y, u))
    state = observer.init(samples[0].t, **initial)
    rows = []
    for k in range(0, len(samples), 1000):
        state = observer.block(state, samples[k : k + 1000])
        rows += state.decided
    return rows + list(observer.finish(state))


def events_of(rows: Sequence[Estimate]) -> list[Any]:
    return [event for row in rows for event in row.events]


def observer_of(body: dict[str, Any]) -> Any:
    return from_design(obsdesign.design(obsdesign.Problem.from_dict(body)))


CHAIN: dict[str, Any] = {
    "flow": {"A": [[-0.08, 0, 0], [2, -0.15, 0], [0, 0.5, -0.2]]},
    "jump": {"H": [[1], [0], [0]], "dwell_time": [25, "inf"]},
    "output": {"C": [[0, 0, 1]], "measured": "periodic", "period": 0.05},
    "observer": {"kind": "impulsive_input", "window": 20, "margin": 5},
}
