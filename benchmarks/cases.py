"""Random families at 97 % of the critical gain, the obvious CVXPY script, and a stopwatch."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from lmi.find.cutting_plane import propose

LOW, HIGH = 0.1, 2.1
SHARE = 0.97
SEEDS = range(9)

# pairs that a common P does not prove to their limit: sampled data, and two random ones
SAMPLED = (
    np.array([[0, 1, 0], [-2, 0.1, 1], [0, 0, 0]]),
    np.array([[1.0, 0, 0], [0, 1, 0], [1, 0, 0]]),
)
ALTERNATING = (
    np.array([[-0.57, -0.69], [-0.79, 0.58]]),
    np.array([[-0.46, -0.04], [-2.62, -0.82]]),
)
MIXED = (
    np.array([[-0.31, -1.14, -2.13], [0.33, -0.14, -2.63], [-0.32, 0.15, -2.68]]),
    np.array([[-1.31, 0.66, -0.43], [0.46, -0.44, 2.56], [1.18, -0.76, -0.32]]),
)


@dataclass(frozen=True)
class Family:
    """x -> e^{F theta} H x, theta in [LOW, HIGH]; P exists up to 1 / SHARE of this gain."""

    F: np.ndarray
    H: np.ndarray


def families(n: int) -> Iterator[Family]:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        F = rng.standard_normal((n, n))
        F -= (np.linalg.eigvals(F).real.max() + 0.5) * np.eye(n)
        H = rng.standard_normal((n, n))
        low, high = 0.0, 10.0 / np.linalg.norm(H, 2)
        for _ in range(10):
            gain = (low + high) / 2
            if propose(F, gain * H, LOW, HIGH).P is not None:
                low = gain
            else:
                high = gain
        yield Family(F, SHARE * low * H)


def cvxpy_script(F: np.ndarray, H: np.ndarray, low: float, high: float, points: int) -> Any:
    """What people write: one constraint per grid point."""
    import cvxpy as cp
    from scipy.linalg import expm

    n = len(F)
    P = cp.Variable((n, n), symmetric=True)
    constraints = [P >> np.eye(n)]
    for theta in np.linspace(low, high, points):
        M = expm(F * theta) @ H
        constraints.append(P - M.T @ P @ M >> 1e-6 * np.eye(n))
    problem = cp.Problem(cp.Minimize(0), constraints)
    try:
        problem.solve(solver=cp.CLARABEL)
    except cp.error.SolverError:  # at its limit the solver gives up; a bisection reads it as "no"
        return None
    return P.value


def seconds(call: Callable[[], Any], repeats: int = 1) -> tuple[float, Any]:
    """Shortest of a few runs, and the last result."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = call()
        times.append(time.perf_counter() - start)
    return min(times), result


def report(
    what: str, ours: list[float], theirs: list[float], floor: float, unit: str = "ms"
) -> bool:
    """One line: medians, the median of the ratios, and whether it is above the floor.

    ours, theirs: in seconds (unit "ms") or in megabytes (unit "MB").
    """
    ratio = statistics.median(b / a for a, b in zip(ours, theirs, strict=True))
    verdict = "ok" if ratio >= floor else "BELOW THE FLOOR"
    factor = 1e3 if unit == "ms" else 1.0
    mine, other = statistics.median(ours) * factor, statistics.median(theirs) * factor
    print(f"{what:42s} ours {mine:9.2f} {unit}   theirs {other:10.1f} {unit}   "
          f"ratio {ratio:8.1f}   floor {floor:g}  {verdict}", flush=True)  # fmt: skip
    return ratio >= floor
