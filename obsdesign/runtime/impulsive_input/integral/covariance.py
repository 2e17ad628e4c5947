"""Covariance of the error of a free run: initial value, and growth by noise of the samples."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm, exponential_grid
from obsdesign.equations.impulsive_input.deviations import error_growth
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun


def first_covariance(run: FreeRun, y: Matrix, x: Matrix) -> Matrix:
    """As wide as an impulse that would explain the range of y (rows, p) in the first window.

    x (n,): the estimate at its first row.
    """
    C, count = run.gains.C, 64
    grid = exponential_grid(run.gains.A, 0.0, run.tau / count, count + 1)
    states = np.einsum("kij,jq->kiq", grid, run.gains.H)
    shown = np.abs(np.einsum("pi,kiq->kpq", C, states)).max(axis=0)  # (p, q)
    ranges = np.ptp(y, axis=0) + np.abs(y[0] - C @ x)
    with np.errstate(divide="ignore"):
        weights = np.where(shown > 0, ranges[:, None] / shown, 0.0).max(axis=0)
    sizes = (np.abs(states) * weights).max(axis=(0, 2))
    largest = float(sizes.max()) or 1.0
    return np.diag(np.maximum(sizes, 1e-6 * largest) ** 2)


def propagated(run: FreeRun, P: Matrix, elapsed: float, times: Matrix, spread: Matrix) -> Matrix:
    """P after a time, by P' = D P + P D' + K Q K'; Q: noise of samples times their spacing."""
    flow = expm(run.D * elapsed)
    return flow @ P @ flow.T + added_by_noise(run, elapsed, times, spread)


def added_by_noise(run: FreeRun, elapsed: float, times: Matrix, spread: Matrix) -> Matrix:
    """Growth of P by noise through K in a time: P_inf - e^{D t} P_inf e^{D' t}."""
    D, K = run.D, run.gains.K
    spacing = (times[-1] - times[0]) / max(len(times) - 1, 1)
    Q = K @ np.diag((spread**2).mean(axis=0) * spacing) @ K.T
    return error_growth(D, Q, elapsed)
