"""Random plants with a nominal pattern, for set-membership bounds."""

from __future__ import annotations

from typing import Any

import numpy as np


def random_set_problem(rng: np.random.Generator) -> dict[str, Any]:
    """A problem: 1 to 6 states, a flow or discrete time, disturbances and noise of every shape."""
    n = int(rng.integers(1, 7))
    period = float(rng.choice([0.05, 0.1, 0.25]))
    flow = _flow(rng, n)
    if rng.random() < 0.2:
        largest = np.abs(np.linalg.eigvals(flow["A"])).max()
        flow |= {"dt": period / int(rng.integers(1, 4)), "A": flow["A"] / max(1.0, largest)}
    p = int(rng.integers(1, min(n, 2) + 1))
    noise: list[Any] = rng.uniform(0.01, 0.5, p).tolist()
    if rng.random() < 0.3:
        noise = [[-a, 2 * a] for a in noise]
    output = {"C": rng.standard_normal((p, n)), "noise_bound": noise}
    body = {"flow": flow, "output": output, "observer": {"kind": "set_membership"}}
    output |= {"measured": "periodic", "period": period}
    if rng.random() < 0.3:
        return body
    G = np.eye(n) + 0.3 * rng.standard_normal((n, n))
    low = period * int(rng.integers(1, 6))
    high = float(rng.choice([low + 4 * period, np.inf]))
    body["jump"] = {"G": G, "disturbance": _box(rng, n), "dwell_time": [low, high]}
    words = ["before", "after"] if "dt" in flow else ["before", "after", "none"]
    output["jump_measurement"] = str(rng.choice(words))
    if rng.random() < 0.3 and output["jump_measurement"] != "none":
        output["measured"] = "at_jumps"
        del output["period"]
    return body


def _flow(rng: np.random.Generator, n: int) -> dict[str, Any]:
    A = rng.standard_normal((n, n)) / np.sqrt(n) * 10.0 ** rng.uniform(-1, 1)
    if rng.random() < 0.3:
        A *= rng.random((n, n)) < 0.6
    if rng.random() < 0.3:
        sizes = 10.0 ** rng.uniform(-2, 2, n)
        A *= sizes[:, None] / sizes
    flow = {"A": A, "disturbance": _box(rng, n)}
    if rng.random() < 0.3:
        k = int(rng.integers(1, n + 1))
        flow |= {"disturbance_matrix": rng.standard_normal((n, k)), "disturbance": _box(rng, k)}
    if rng.random() < 0.2:
        flow |= {"D": rng.standard_normal((n, 1)), "d_bounds": _box(rng, 1)}
    return flow


def _box(rng: np.random.Generator, k: int) -> dict[str, Any]:
    """A box of k entries, some of which are one point."""
    middle, radius = rng.uniform(-1, 1, k), rng.uniform(0, 1, k) * (rng.random(k) < 0.8)
    return {"lower": middle - radius, "upper": middle + radius}
