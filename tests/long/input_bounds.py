"""Does an unknown input ever leave its bounds? Random plants, slopes and noise at their extremes.

    python -m tests.long.input_bounds [RUNS] [FIRST_SEED]

Random plants (n = 1..3, q = 1..2, jumps or none) with an unknown input that zigzags at its largest
rate between its bounds, noise at its ends and samples that are missing. Prints the runs and the
rows outside; exits with 1 on any.
"""

from __future__ import annotations

import sys

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.problem.problem import Problem
from obsdesign.runtime.base import Sample
from obsdesign.runtime.set_membership.input_bounds import InputBoundsObserver

_ROWS = 40
_ROUNDING = 1e-9


def violations(seed: int, stated: float = 1.0) -> int:
    """Rows of one run at which x or d is outside its bounds, or the bounds cross.

    stated: the rate that the observer is given, as part of the true one.
    """
    rng = np.random.default_rng(seed)
    n, q = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    rate, V = 10.0 ** rng.uniform(-1, 1, q), 10.0 ** rng.uniform(-3, -1, n)
    lower, upper = -rng.uniform(0.1, 3, q), rng.uniform(0.1, 3, q)
    A, D = rng.normal(size=(n, n)), rng.normal(size=(n, q))
    G = np.eye(n) + 0.3 * rng.normal(size=(n, n))
    body = {
        "flow": {
            "A": A, "D": D, "d_bounds": {"lower": lower, "upper": upper, "rate": stated * rate},
            "disturbance": {"lower": [-0.05] * n, "upper": [0.05] * n},
        },
        "jump": {"G": G, "dwell_time": [0, "inf"]},
        "output": {"C": np.eye(n), "noise_bound": V},
        "observer": {"kind": "set_membership"},
    }  # fmt: skip
    plant = Problem.from_dict(body).plant
    gains = SetMembershipGains.from_plant(plant, window=int(rng.integers(2, 9)), steps=3)
    observer = InputBoundsObserver(gains)
    h = 10.0 ** rng.uniform(-2, -0.5)
    x, d = rng.uniform(-1, 1, n), rng.uniform(lower, upper)
    state = observer.init(0.0, lower=-np.ones(n), upper=np.ones(n))
    slope, outside = rate * rng.choice([-1.0, 1.0], q), 0
    for k in range(1, _ROWS):
        slope = np.where(rng.random(q) < 0.2, -slope, slope)
        # turned back where it would leave its bounds
        slope = np.where((d + h * slope > upper) | (d + h * slope < lower), -slope, slope)
        slope = np.where((d + h * slope > upper) | (d + h * slope < lower), 0.0, slope)
        b = 0.05 * rng.choice([-1.0, 1.0], n)
        x, d = _moved(A, D, (x, d), (slope, b), h)
        slope = np.where(slope == 0, rate, slope)
        jump = bool(rng.random() < 0.2)
        y = x + V * rng.choice([-1.0, 1.0], n)
        y[rng.random(n) < 0.2] = np.nan
        x = G @ x if jump else x
        state, estimate = observer.step(state, Sample(h * k, y, jump=jump))
        assert estimate.lower is not None
        assert estimate.upper is not None
        assert estimate.d_bounds is not None
        slack = _ROUNDING * (1 + np.abs(x).max())
        is_inside = (
            ((estimate.lower <= x + slack) & (x - slack <= estimate.upper)).all()
            and (estimate.d_bounds[0] <= d + slack).all()
            and (d - slack <= estimate.d_bounds[1]).all()
        )
        outside += not is_inside or "crossed" in estimate.status
    return outside


def _moved(
    A: Matrix, D: Matrix, start: tuple[Matrix, Matrix], held: tuple[Matrix, Matrix], h: float
) -> tuple[Matrix, Matrix]:
    """x and d after a step h with a slope of d and b that are held."""
    (n, q), (x, d), (slope, b) = D.shape, start, held
    size = n + 2 * q + n
    M = np.zeros((size, size))
    M[:n, :n], M[:n, n : n + q] = A, D
    M[:n, n + 2 * q :] = np.eye(n)
    M[n : n + q, n + q : n + 2 * q] = np.eye(q)
    end = expm(M * h) @ np.concatenate([x, d, slope, b])
    return end[:n], end[n : n + q]


def main(runs: int = 1000, first: int = 0) -> int:
    """Run that many plants; the exit code."""
    outside = sum(violations(seed) for seed in range(first, first + runs))
    print(f"{runs} runs, {outside} rows outside")
    return int(outside > 0)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
