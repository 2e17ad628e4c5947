"""The covariance of the error of a free run: at first, and as noise of the samples adds to it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.exponential import expm, exponential_grid
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun, Track
from obsdesign.runtime.impulsive_input.integral.rows import IntegralLive

Array = NDArray[Any]


def first_covariance(run: FreeRun, H: Array, track: Track, stop: int) -> Array:
    """As wide as an impulse that would explain the range of y in the first window."""
    count = 64
    grid = exponential_grid(run.A, 0.0, run.tau / count, count + 1)
    states = np.einsum("kij,jq->kiq", grid, H)
    shown = np.abs(np.einsum("pi,kiq->kpq", run.C, states)).max(axis=0)  # (p, q)
    ranges = np.ptp(track.y[:stop], axis=0) + np.abs(track.y[0] - run.C @ track.x[0])
    with np.errstate(divide="ignore"):
        weights = np.where(shown > 0, ranges[:, None] / shown, 0.0).max(axis=0)
    sizes = (np.abs(states) * weights).max(axis=(0, 2))
    largest = float(sizes.max()) or 1.0
    return np.diag(np.maximum(sizes, 1e-6 * largest) ** 2)


def covariance_at(run: FreeRun, live: IntegralLive, times: Array, spread: Array) -> Array | None:
    """P at times[0] by P' = D P + P D' + K Q K'; Q: noise of these samples times their spacing."""
    P = live.covariance
    if P is None:
        return None
    elapsed = max(float(times[0]) - live.since, 0.0)
    flow = expm(run.D * elapsed)
    return flow @ P @ flow.T + added_by_noise(run, times, spread, elapsed)


def added_by_noise(run: FreeRun, times: Array, spread: Array, elapsed: float) -> Array:
    """What noise through K adds to P in a time: P_inf - e^{D t} P_inf e^{D' t}."""
    D, K, n = run.D, run.K, len(run.D)
    spacing = (times[-1] - times[0]) / max(len(times) - 1, 1)
    Q = K @ np.diag((spread**2).mean(axis=0) * spacing) @ K.T
    operator = np.kron(np.eye(n), D) + np.kron(D, np.eye(n))
    limit = np.linalg.solve(operator, -Q.reshape(-1)).reshape(n, n)
    flow = expm(D * elapsed)
    found = limit - flow @ limit @ flow.T
    return np.asarray((found + found.T) / 2)
