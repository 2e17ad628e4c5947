"""A plant of four states in two guises: our interval observer and filterpy's Kalman filter."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.problem.problem import Problem
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.workflow import design

N, PERIOD, ROWS = 4, 0.05, 2000
REPEATS = 15
# a chain of four lags, the first one measured
A = np.diag([-1.0, -2.0, -3.0, -4.0]) + np.diag([0.5, 0.5, 0.5], 1) + np.diag([0.3, 0.3, 0.3], -1)
C = np.eye(1, N)


class Filter(Protocol):
    """filterpy's Kalman filter, as far as it is used here."""

    F: Matrix
    H: Matrix
    Q: Matrix
    R: Matrix
    P: Matrix

    def predict(self) -> None: ...

    def update(self, z: Matrix) -> None: ...

    def predict_steadystate(self) -> None: ...

    def update_steadystate(self, z: Matrix) -> None: ...


def observer(measured: str) -> IntervalObserver:
    """A proved design, loaded to run: samples as events (`periodic`), slope scheme otherwise."""
    problem = Problem(
        flow={"A": A, "disturbance": {"lower": [-0.1] * N, "upper": [0.1] * N}},
        output={"C": C, "noise_bound": [0.05], "measured": measured, "period": PERIOD},
        observer={"kind": "interval", "form": "split", "objective": "narrowest", "gain_limit": 2.0},
    )
    return IntervalObserver.from_gains(design(problem).gains)


def kalman_filter() -> Filter:
    """filterpy's filter of the same plant."""
    filter_ = kalman_filter_of(A, C)
    filter_.F = expm(A * PERIOD)
    return filter_


def kalman_filter_of(A: Matrix, C: Matrix) -> Filter:
    """filterpy's filter of a plant, without the map of a step."""
    from filterpy.kalman import KalmanFilter

    filter_: Filter = KalmanFilter(dim_x=len(A), dim_z=len(C))
    filter_.H, filter_.Q, filter_.R = C, 1e-3 * np.eye(len(A)), 1e-3 * np.eye(len(C))
    return filter_


def record(seed: int = 0, rows: int = ROWS) -> tuple[Matrix, Matrix]:
    """(t, y): the plant at rest, noise inside its bounds."""
    rng = np.random.default_rng(seed)
    return np.round(np.arange(rows) * PERIOD, 2), rng.uniform(-0.04, 0.04, (rows, 1))


def side_by_side(
    ours: Callable[[], None], theirs: Callable[[], None], per: tuple[int, int]
) -> tuple[list[float], list[float]]:
    """Seconds per sample of both, alternating in one run; per: samples in a call of each."""
    mine: list[float] = []
    other: list[float] = []
    for _ in range(REPEATS):
        for call, times, count in ((ours, mine, per[0]), (theirs, other, per[1])):
            start = time.process_time()
            call()
            times.append((time.process_time() - start) / count)
    return mine, other
