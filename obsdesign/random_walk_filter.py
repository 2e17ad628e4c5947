"""The usual alternative to an unknown-input observer: a Kalman filter with d a random walk.

    x[k+1] = e^{Ah} x[k] + (int e^{As} ds) (D d[k] + B u[k] + b),   d[k+1] = d[k] + noise
    y = C x + v

It needs to be told how fast d moves; told right, it is better than an observer that assumes nothing
of d, told wrong, worse (docs/unknown_input.md has the table).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.exponential import expm
from obsdesign.equations.unknown_input import inputs
from obsdesign.plant import Plant

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Filtered:
    """Estimates at each row after its measurement: x (rows, n), d (rows, q)."""

    t: Array
    x: Array
    d: Array


def random_walk_filter(
    plant: Plant,
    t: ArrayLike,
    y: ArrayLike,
    u: ArrayLike | None = None,
    *,
    walk: float,
    initial_variance: float = 25.0,
) -> Filtered:
    """Filter a record: t (rows,), y (rows, p) with NaN rows for missing samples, u (rows, m) held.

    walk: variance that d gains per unit of time; initial_variance: of all of [x; d], which start at
    0. The noise of y is output.noise_std. ValueError without flow.D or without noise.
    """
    flow, C, deviation = plant.flow, plant.output.C, plant.output.noise_std
    if flow.D is None or not np.all(deviation > 0):
        raise ValueError("the filter needs flow.D and a positive output.noise_std.")
    times, data = np.asarray(t, dtype=np.float64), np.asarray(y, dtype=np.float64)
    n, q = flow.D.shape
    B = inputs(flow.B, flow.lower, flow.upper)
    held = np.ones((len(times), 1))
    if flow.B is not None and u is not None:
        held = np.hstack([np.asarray(u, dtype=np.float64).reshape(len(times), -1), held])
    elif flow.B is not None:
        held = np.hstack([np.zeros((len(times), B.shape[1] - 1)), held])
    seen, R = np.hstack([C, np.zeros((len(C), q))]), np.diag(deviation**2)
    noise = np.diag(np.concatenate([np.zeros(n), np.full(q, walk)]))  # per unit of time
    z, P = np.zeros(n + q), initial_variance * np.eye(n + q)
    maps: dict[float, tuple[Array, Array]] = {}
    found = []
    for k, now in enumerate(times.tolist()):
        if k:
            h = round(now - float(times[k - 1]), 12)
            if h not in maps:
                maps[h] = _step(flow, B, h)
            move, forced = maps[h]
            z, P = move @ z + forced @ held[k - 1], move @ P @ move.T + h * noise
        if np.isfinite(data[k]).all():
            gain = np.linalg.solve(seen @ P @ seen.T + R, seen @ P).T
            z, P = z + gain @ (data[k] - seen @ z), P - gain @ (seen @ P)
            P = (P + P.T) / 2
        found.append(z)
    return Filtered(times, np.array(found)[:, :n], np.array(found)[:, n:])


def _step(flow: Any, B: Array, h: float) -> tuple[Array, Array]:
    n, q = flow.D.shape
    m = B.shape[1]
    block = np.zeros((n + q + m, n + q + m))
    block[:n] = np.hstack([flow.A, flow.D, B]) * h
    whole = expm(block)
    return whole[: n + q, : n + q], whole[: n + q, n + q :]
