"""A step of a length that was never met: two observers against scipy's expm.

`luenberger` against what one writes by hand: for each row one block exponential of [[F, I, 0],
[0, 0, I], [0, 0, 0]] h, then three products; no time stamps are checked and no status is given.
Whole records, cells of lengths that are made on the way included. `interval` against filterpy's
predict and update with a new expm(A h): the median row, and beside it what a cell of lengths costs
once. Floor: 3 times as fast for 2, 4 and 8 states, the median of the repeats.
"""

from __future__ import annotations

import statistics
import sys
import time

import numpy as np
from scipy.linalg import expm

from benchmarks.cases import duration, row
from benchmarks.filters import kalman_filter_of
from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.interval.splits import metzler_split
from obsdesign.runtime.base import Sample
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.runtime.luenberger.observer import LuenbergerObserver

FLOOR = 3.0
STATES, ROWS, REPEATS = (2, 4, 8), 1000, 7
PUSH, NOISE = 0.1, 0.05


def plant(n: int) -> tuple[Matrix, Matrix, Matrix]:
    """A, C, L of a chain of lags, the first one measured."""
    A = np.diag(-np.arange(1.0, n + 1)) + 0.5 * np.eye(n, k=1) + 0.3 * np.eye(n, k=-1)
    return A, np.eye(1, n), np.full((n, 1), 0.8)


def record(seed: int) -> tuple[Matrix, Matrix]:
    """Times with lengths of their own between them, and measurements."""
    rng = np.random.default_rng(seed)
    return 100.0 + np.cumsum(rng.uniform(0.05, 0.15, ROWS)), rng.normal(size=(ROWS, 1))


def gains(A: Matrix, C: Matrix, L: Matrix) -> dict[str, object]:
    """Those of a design without jumps."""
    none = [0.0] * len(A)
    return {
        "A": A.tolist(), "C": C.tolist(), "L": L.tolist(), "M": (0 * L).tolist(), "G": None,
        "flow_lower": none, "flow_upper": none, "noise_bound": [0.0], "jump_measurement": "none",
    }  # fmt: skip


def by_hand(A: Matrix, C: Matrix, L: Matrix, times: Matrix, y: Matrix) -> tuple[float, Matrix]:
    """Seconds of a row, and the last estimate."""
    n = len(A)
    F, x, before, start = A - L @ C, np.zeros(n), y[0], times[0] - 0.1
    began = time.process_time()
    for t, value in zip(times.tolist(), y, strict=True):
        h = t - start
        block = np.zeros((3 * n, 3 * n))
        block[:n, :n], block[:n, n : 2 * n] = F * h, np.eye(n) * h
        block[n : 2 * n, 2 * n :] = np.eye(n)
        flow, once, ramp = np.hsplit(expm(block)[:n], 3)
        x = flow @ x + once @ (L @ before) + ramp @ (L @ (value - before))
        before, start = value, t
    return (time.process_time() - began) / len(y), x


def by_observer(observer: LuenbergerObserver, times: Matrix, y: Matrix) -> tuple[float, Matrix]:
    """Likewise; its state starts as the peer's."""
    samples = [Sample(t, value) for t, value in zip(times.tolist(), y, strict=True)]
    state = observer.init(times[0] - 0.1)
    began = time.process_time()
    for sample in samples:
        state, estimate = observer.step(state, sample)
    assert estimate.x is not None
    return (time.process_time() - began) / len(y), estimate.x


def interval_observer(A: Matrix, C: Matrix, L: Matrix) -> IntervalObserver:
    """Bounds of a plant that is pushed, its noise bounded."""
    n = len(A)
    D0, D1 = (X.tolist() for X in metzler_split(A - L @ C))
    bounds = {"flow_lower": [-PUSH] * n, "flow_upper": [PUSH] * n, "noise_bound": [NOISE]}
    split = {"form": "split", "D0": D0, "D1": D1}
    return IntervalObserver.from_gains(gains(A, C, L) | bounds | split)


def rows_of_bounds(observer: IntervalObserver, times: Matrix, y: Matrix) -> list[float]:
    """Seconds of each row."""
    ends, seconds = np.ones(observer.n), []
    state = observer.init(times[0] - 0.1, lower=-ends, upper=ends)
    for sample in [Sample(t, value) for t, value in zip(times.tolist(), y, strict=True)]:
        began = time.perf_counter()
        state, estimate = observer.step(state, sample)
        seconds.append(time.perf_counter() - began)
        assert estimate.status == "ok"
    return seconds


def rows_of_filter(A: Matrix, C: Matrix, times: Matrix, y: Matrix) -> list[float]:
    """Seconds of each row of filterpy's filter."""
    kalman, before, seconds = kalman_filter_of(A, C), times[0] - 0.1, []
    for t, value in zip(times.tolist(), y[:, None], strict=True):
        began = time.perf_counter()
        kalman.F = expm(A * (t - before))
        kalman.predict()
        kalman.update(value)
        seconds.append(time.perf_counter() - began)
        before = t
    return seconds


def cell_seconds(observer: IntervalObserver) -> float:
    """Processor seconds of a cell of lengths."""
    kernels = observer.kernels
    kernels.for_step(1.0, 100.0)["both"]  # what all cells share
    began = time.process_time()
    kernels.for_step(0.1, 100.0)["both"]
    return time.process_time() - began


def point_estimates(n: int) -> bool:
    A, C, L = plant(n)
    ratios, rows = [], []
    for seed in range(REPEATS):
        times, y = record(seed)
        observer = LuenbergerObserver.from_gains(gains(A, C, L))
        (own, x), (peer, other) = by_observer(observer, times, y), by_hand(A, C, L, times, y)
        np.testing.assert_allclose(x, other, rtol=1e-9, atol=1e-12)
        ratios.append(peer / own)
        rows.append(own)
    return verdict(f"luenberger {n} states", rows, ratios, "numpy")


def bounds(n: int) -> bool:
    A, C, L = plant(n)
    ratios, rows = [], []
    for seed in range(REPEATS):
        times, y = record(seed)
        y = np.clip(0.4 * NOISE * y, -NOISE, NOISE)
        own = statistics.median(rows_of_bounds(interval_observer(A, C, L), times, y))
        peer = statistics.median(rows_of_filter(A, C, times, y))
        ratios.append(peer / own)
        rows.append(own)
    cell = statistics.median(cell_seconds(interval_observer(A, C, L)) for _ in range(REPEATS))
    row(f"a cell of lengths, interval {n} states", duration(cell), "", "", "", True)
    return verdict(f"interval {n} states", rows, ratios, "filterpy")


def verdict(what: str, rows: list[float], ratios: list[float], peer: str) -> bool:
    ratio = statistics.median(ratios)
    own = duration(statistics.median(rows))
    what = f"irregular, {what}, {peer}, worst {min(ratios):.1f}"
    return row(what, own, "", f"x {ratio:.2f}", f">= {FLOOR:g}", ratio >= FLOOR)


def main() -> bool:
    return all([*map(point_estimates, STATES), *map(bounds, STATES)])


if __name__ == "__main__":
    sys.exit(not main())
