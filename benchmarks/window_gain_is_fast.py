"""A windowed gain costs the same at any length: at 64 impulses 5 x less than a rebuilt one.

Ours is a whole step of the observer at an impulse: flow, window, gain, jump. Theirs is the gain
alone, (12) as one writes it down, with exponentials, Gramian and inverse. Both make their
exponentials anew, as spacings never repeat; the ratio with theirs cached is printed too.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.linalg import expm

from benchmarks.cases import report, seconds
from lmi.arithmetic.arrays import Matrix, NewEntries
from obsdesign.runtime import Sample
from obsdesign.runtime.impulsive.observer import ImpulsiveObserver

Plant = tuple[Matrix, Matrix, Matrix]  # A, G, C

N, ALPHA, IMPULSES = 4, 1.05, 400
REBUILT, REPEATS = 60, 5  # gains of the obvious script; runs of both
FLOOR = 5.0


def plants() -> Iterator[Plant]:
    """Slowly damped random plants: long windows stay well-conditioned."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        turn = rng.standard_normal((N, N))
        yield (turn - turn.T) - 0.02 * np.eye(N), np.eye(N), rng.standard_normal((1, N))


def gains(A: Matrix, G: Matrix, C: Matrix, window: int) -> NewEntries:
    zeros = np.zeros(N)
    return {"A": A, "G": G, "C": C, "flow_lower": zeros, "flow_upper": zeros, "jump_lower": zeros,
            "jump_upper": zeros, "dwell_time": np.array([0.1, 0.4]), "jump_measurement": "before",
            "strategy": "full", "alpha": ALPHA, "window": window}  # fmt: skip


def ours(observers: Iterator[ImpulsiveObserver], times: Matrix) -> list[Matrix]:
    """Gains of the next observer, which knows no spacing yet, at each impulse but the first."""
    observer = next(observers)
    samples = [Sample(t, y=[-1.0], jump=True) for t in times.tolist()]
    state, _ = observer.step(observer.init(t=0.0), samples[0])
    origin, matrices = np.zeros(N), []
    for sample in samples[1:]:
        # from x = 0 a jump with y = -1 leads to L
        state, estimate = observer.step(replace(state, x=origin), sample)
        assert estimate.x is not None
        matrices.append(estimate.x[:, None])
    return matrices


def rebuilt(G: Matrix, C: Matrix, flows: list[Matrix], power: float) -> Matrix:
    """(12) from the exponentials of a window, oldest first."""
    X = flows[0]
    M, weight = X.T @ C.T @ C @ X, 1.0
    for E in flows[1:]:
        X = E @ G @ X
        weight *= ALPHA**2
        M = M + weight * X.T @ C.T @ C @ X
    return np.asarray(-power * G @ X @ np.linalg.inv(M) @ X.T @ C.T)


def theirs(plant: Plant, spacings: Matrix, window: int, store: list[Matrix]) -> list[Matrix]:
    """Gains of the obvious script; store: exponentials of all spacings, or none."""
    A, G, C = plant
    power, results = ALPHA ** (2 * (window - 1)), []
    for k in range(window, len(spacings) + 1):
        flows = store[k - window : k] or [expm(A * delta) for delta in spacings[k - window : k]]
        results.append(rebuilt(G, C, flows, power))
    return results


def main() -> bool:
    good = True
    for window in (4, 16, 64):
        mine, slow, quick = [], [], []
        for plant in plants():
            times = np.cumsum(np.random.default_rng(1).uniform(0.1, 0.4, IMPULSES))
            body = gains(*plant, window)
            observers = iter([ImpulsiveObserver.from_gains(body) for _ in range(REPEATS)])
            time, L = seconds(partial(ours, observers, times), REPEATS)
            mine.append(time / len(L))
            few = np.diff(times)[: window + REBUILT - 1]
            time, printed = seconds(partial(theirs, plant, few, window, []), REPEATS)
            slow.append(time / REBUILT)
            store = [expm(plant[0] * delta) for delta in few]
            time, _ = seconds(partial(theirs, plant, few, window, store), REPEATS)
            quick.append(time / REBUILT)
            pairs = zip(L[window - 1 :], printed, strict=False)
            off = max(np.abs(a - b).max() for a, b in pairs)
            assert off < 1e-4 * max(np.abs(b).max() for b in printed), off
        floor = FLOOR if window == 64 else 0.0
        good &= report(f"gain, window {window:2d}, exponentials anew", mine, slow, floor)
        report(f"gain, window {window:2d}, exponentials cached", mine, quick, 0.0)
    return good


if __name__ == "__main__":
    sys.exit(not main())
