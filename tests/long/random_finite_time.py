"""Random plants for finite-time estimators: exact to rounding, bounds hold and are attained.

python tests/long/random_finite_time.py [cases] [first seed]
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.data.simulation import simulate
from obsdesign.problem.options import FiniteTimeOptions
from obsdesign.runtime import from_design

FINE = 16  # pieces of a period on which the worst disturbance is constant


def problem(rng: np.random.Generator, method: str, bounded: bool) -> obsdesign.Problem:
    n = int(rng.integers(1, 7))
    p = int(rng.integers(1, min(n, 3) + 1))
    A = rng.standard_normal((n, n)) / np.sqrt(n) + rng.uniform(-0.5, 0.5) * np.eye(n)
    k, period = 4 * n, float(rng.choice([0.1, 0.25, 0.5]))
    flow: dict[str, Any] = {"A": A, "B": rng.standard_normal((n, 2))}
    output = {"C": rng.standard_normal((p, n)), "measured": "periodic", "period": period}
    if bounded:
        half = rng.uniform(0, 0.2, n)
        flow["disturbance"] = {"lower": -half, "upper": 2 * half}
        output["noise_bound"] = rng.uniform(0, 0.1, p)
    observer: dict[str, Any] = {"kind": "finite_time", "window": k * period, "method": method}
    if method == "exact":
        observer["gains"] = {"L": 0.3 * rng.standard_normal((n, p))}
    return obsdesign.Problem(flow=flow, output=output, observer=observer)


def attained(design: Any) -> float:
    """Error under switching signals, relative to the radius: the least over the states."""
    gains = design.gains
    G, A, C, k, period = (
        gains[name] for name in ("window_gain", "A", "C", "samples", "period")
    )  # fmt: skip
    n, p = len(A), len(C)
    half = (gains["flow_upper"] - gains["flow_lower"]) / 2
    weights, R = [], np.zeros((n, n))
    parts = expm(-A * (period * (np.arange(FINE) + 0.5) / FINE)[:, None, None])
    for j in range(int(k)):
        R = R @ expm(-A * period) + G[:, j * p : (j + 1) * p] @ C
        weights.append(R @ parts)
    errors = np.abs(G) @ np.tile(gains["noise_bound"], int(k))
    errors = errors + np.abs(np.array(weights)).sum(axis=(0, 1)) @ half * period / FINE
    return float(np.min(errors / np.where(gains["radius"] > 0, gains["radius"], 1.0)))


def main(cases: int, first: int) -> None:
    refused, worst, least = 0, 0.0, 1.0
    for seed in range(first, first + cases):
        rng = np.random.default_rng(seed)
        method, bounded = str(rng.choice(["least_squares", "exact"])), bool(rng.integers(2))
        task = problem(rng, method, bounded)
        outcome = obsdesign.investigate(task)
        if outcome.verdict != "proved" or outcome.design is None:
            refused += 1
            continue
        window, period = task.options_as(FiniteTimeOptions).window, task.plant.output.sample_period
        assert window is not None
        kind = str(rng.choice(["extreme", "random", "sine"])) if bounded else "zero"
        record = simulate(
            task.plant, until=3 * window, step=period / 2, disturbance=kind, rng=rng
        )  # fmt: skip
        observer: Any = from_design(outcome.design)
        batch = observer.run_batch(record.t, record.block("y"), record.block("u"))
        full = np.array([status == "ok" for status in batch.status])
        x = record.block("x")
        assert full.any(), seed
        if bounded:
            assert (batch.lower <= x).all(), seed
            assert (x <= batch.upper).all(), seed
            least = min(least, attained(outcome.design))
        else:
            size = {c.id: c for c in outcome.claims}["unbiased"].evidence["amplification"]
            error = np.abs(batch.x - x)[full].max() / (size * np.abs(x).max())
            worst = max(worst, float(error))
    print(f"{cases} plants, {refused} refused; largest error {worst:.1e} of amplification "
          f"times |x|; bounds attained to {least:.6f} at least")  # fmt: skip


if __name__ == "__main__":
    main(*(int(x) for x in [*sys.argv[1:], "100", "0"][:2]))
