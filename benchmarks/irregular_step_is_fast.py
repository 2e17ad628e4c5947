"""A step of a length that was never met: point observer against numpy with scipy's expm.

The peer is what one writes by hand: for each row one block exponential of [[F, I, 0], [0, 0, I],
[0, 0, 0]] h, then three products; no time stamps are checked and no status is given. Floor: 3 times
as many rows a second for 2, 4 and 8 states, the median of the repeats.
"""

from __future__ import annotations

import statistics
import sys
import time

import numpy as np
from scipy.linalg import expm

from benchmarks.cases import duration
from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.base import Sample
from obsdesign.runtime.luenberger.observer import LuenbergerObserver

FLOOR = 3.0
STATES, ROWS, REPEATS = (2, 4, 8), 1000, 7


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


def main() -> bool:
    good = True
    for n in STATES:
        A, C, L = plant(n)
        ratios, rows = [], []
        for seed in range(REPEATS):
            times, y = record(seed)
            observer = LuenbergerObserver.from_gains(gains(A, C, L))
            (own, x), (peer, other) = by_observer(observer, times, y), by_hand(A, C, L, times, y)
            np.testing.assert_allclose(x, other, rtol=1e-9, atol=1e-12)
            ratios.append(peer / own)
            rows.append(own)
        ratio = statistics.median(ratios)
        good &= ratio >= FLOOR
        verdict = "ok" if ratio >= FLOOR else "BELOW THE FLOOR"
        print(f"{n} states   row {duration(statistics.median(rows))}   expm by hand x {ratio:.2f}"
              f" (worst {min(ratios):.2f})   floor {FLOOR:g}  {verdict}", flush=True)  # fmt: skip
    return good


if __name__ == "__main__":
    sys.exit(not main())
