"""A windowed gain costs the same at any length: at 64 impulses 5 x less than a rebuilt one.

Gain against gain: ours slides its window and solves; theirs is (12) as one writes it down, with
exponentials, Gramian and inverse. Both make their exponentials anew, as spacings never repeat; the
ratio with theirs cached is printed too.
"""

from __future__ import annotations

import sys
import time
from typing import Any

from benchmarks.cases import report  # isort: skip - it sets the number of threads for numpy

import numpy as np
from scipy.linalg import expm

from obsdesign.runtime.impulsive.observer import ImpulsiveObserver

N, ALPHA, IMPULSES = 4, 1.05, 400
FLOOR = 5.0


def plants() -> Any:
    """Slowly damped random plants: long windows stay well-conditioned."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        turn = rng.standard_normal((N, N))
        yield (turn - turn.T) - 0.02 * np.eye(N), np.eye(N), rng.standard_normal((1, N))


def gains(A: Any, G: Any, C: Any, window: int) -> dict[str, Any]:
    zeros = np.zeros(N)
    return {"A": A, "G": G, "C": C, "flow_lower": zeros, "flow_upper": zeros, "jump_lower": zeros,
            "jump_upper": zeros, "dwell_time": np.array([0.1, 0.4]), "jump_measurement": "before",
            "strategy": "full", "alpha": ALPHA, "window": window}  # fmt: skip


def ours(A: Any, G: Any, C: Any, times: Any, window: int) -> tuple[float, list[Any]]:
    """Seconds per gain of the running observer, and its gains."""
    observer = ImpulsiveObserver.from_gains(gains(A, G, C, window))
    state = observer.init(t=0.0)
    found = []
    start = time.perf_counter()
    for t, spacing in zip(times[1:].tolist(), np.diff(times).tolist(), strict=True):
        state = observer._slide(state, spacing, t)
        found.append(observer._gain(state)[0])
    return (time.perf_counter() - start) / len(found), found[window - 1 :]


def rebuilt(A: Any, G: Any, C: Any, flows: list[Any], power: float) -> Any:
    """(12) from the exponentials of a window, oldest first."""
    X = flows[0]
    M, weight = X.T @ C.T @ C @ X, 1.0
    for E in flows[1:]:
        X = E @ G @ X
        weight *= ALPHA**2
        M = M + weight * X.T @ C.T @ C @ X
    return -power * G @ X @ np.linalg.inv(M) @ X.T @ C.T


def theirs(
    A: Any, G: Any, C: Any, times: Any, window: int, cached: bool
) -> tuple[float, list[Any]]:
    """Seconds per impulse of the obvious script, and its gains."""
    spacings = np.diff(times)
    store = [expm(A * delta) for delta in spacings]
    power, found = ALPHA ** (2 * (window - 1)), []
    start = time.perf_counter()
    for k in range(window, len(times)):
        inside = range(k - window, k)
        flows = [store[j] for j in inside] if cached else [expm(A * spacings[j]) for j in inside]
        found.append(rebuilt(A, G, C, flows, power))
    return (time.perf_counter() - start) / len(found), found


def main() -> bool:
    good = True
    for window in (4, 16, 64):
        mine, slow, quick = [], [], []
        for A, G, C in plants():
            times = np.cumsum(np.random.default_rng(1).uniform(0.1, 0.4, IMPULSES))
            own, L = ours(A, G, C, times, window)
            other, printed = theirs(A, G, C, times[: window + 60], window, False)
            other_cached, _ = theirs(A, G, C, times[: window + 60], window, True)
            off = max(np.abs(a - b).max() for a, b in zip(L, printed, strict=False))
            assert off < 1e-4 * max(np.abs(b).max() for b in printed), off
            mine.append(own)
            slow.append(other)
            quick.append(other_cached)
        floor = FLOOR if window == 64 else 0.0
        good &= report(f"gain, window {window:2d}, exponentials anew", mine, slow, floor)
        report(f"gain, window {window:2d}, exponentials cached", mine, quick, 0.0)
    return good


if __name__ == "__main__":
    sys.exit(not main())
