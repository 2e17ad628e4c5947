"""Random families at 97 % of the critical gain, the obvious CVXPY script, and a stopwatch."""

from __future__ import annotations

import resource
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.find.cutting_plane import propose

Result = TypeVar("Result")

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

    F: Matrix
    H: Matrix


def families(n: int) -> Iterator[Family]:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        F = rng.standard_normal((n, n))
        F -= (np.linalg.eigvals(F).real.max() + 0.5) * np.eye(n)
        H = rng.standard_normal((n, n))
        low, high = 0.0, 10.0 / float(np.linalg.norm(H, 2))
        for _ in range(10):
            gain = (low + high) / 2
            if propose(F, gain * H, LOW, HIGH).P is not None:
                low = gain
            else:
                high = gain
        yield Family(F, SHARE * low * H)


def cvxpy_script(F: Matrix, H: Matrix, low: float, high: float, points: int) -> Matrix | None:
    """P of the obvious script, one constraint per grid point; None without any."""
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
    return None if P.value is None else np.asarray(P.value)


def processor_time() -> float:
    """Seconds of this process and of children that ended: other programs do not count."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def seconds(call: Callable[[], Result], repeats: int = 1) -> tuple[float, Result]:
    """Processor time of the shortest of `repeats` >= 1 runs, and the last result."""
    start = processor_time()
    result = call()
    times = [processor_time() - start]
    for _ in range(repeats - 1):
        start = processor_time()
        result = call()
        times.append(processor_time() - start)
    return min(times), result


def duration(value: float) -> str:
    """Seconds in the unit in which they are 1 or more: s, ms or us."""
    for factor, unit in ((1.0, "s"), (1e3, "ms")):
        if value * factor >= 1.0:
            return f"{value * factor:.2f} {unit}"
    return f"{value * 1e6:.2f} us"


def report(
    what: str,
    ours: Sequence[float],
    theirs: Sequence[float],
    floor: float,
    *,
    unit: Literal["s", "MB"] = "s",
) -> bool:
    """A row: medians, the median of the ratios, and whether it is above the floor, 0 for none."""
    ratio = statistics.median(b / a for a, b in zip(ours, theirs, strict=True))
    mine, other = (
        duration(median) if unit == "s" else f"{median:.2f} {unit}"
        for median in (statistics.median(ours), statistics.median(theirs))
    )
    required = f">= {floor:.3g}" if floor else ""
    return row(what, mine, other, f"x {ratio:.2f}", required, ratio >= floor)


def row(what: str, ours: str, other: str, measured: str, required: str, is_kept: bool) -> bool:
    """Print a row of the table, and return whether it holds.

    measured: the number of the claim, `x` the ratio of the other to ours; required: its floor or
    its limit, empty where nothing is claimed.
    """
    verdict = "ok" if is_kept else "DOES NOT HOLD"
    cells = f"{what:48s} {ours:>10s} {other:>10s} {measured:>10s} {required:>10s}"
    print(f"{cells}  {verdict if required else '-'}", flush=True)
    return is_kept


def header() -> None:
    """Print what the columns of the table are."""
    print(f"{'claim':48s} {'ours':>10s} {'other':>10s} {'measured':>10s} {'required':>10s}")
