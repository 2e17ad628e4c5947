"""Does the state ever leave its bounds in discrete time, and the width its claim?

    python -m tests.long.random_discrete_time [PLANTS] [FIRST_SEED]

Random plants (n = 1..3, up to two events, one to three sensors with gaps of one to six steps, before
and after events), disturbances at corners, all times that the clocks allow. Trajectories are
rational: nothing is rounded. Kinds interval and set_membership. The widths of kind interval are compared
with `event_width` where the observer starts from the state itself: whatever happens before widens, so
that no row may be wider. Prints rows, rows outside, contradictions and widths above the
claim; exits with 1 on any.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from obsdesign import workflow
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Estimate
from tests.systems.discrete_time import exact_record

_ROWS = 120


def random_body(rng: np.random.Generator) -> dict[str, Any]:
    """A random plant: |A| mostly decays."""
    n, dt = int(rng.integers(1, 4)), float(rng.choice([0.1, 0.5, 3.0]))
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.7)
    A *= rng.uniform(0.3, 1.15) / max(np.abs(np.linalg.eigvals(np.abs(A))).max(), 0.1)
    flow: dict[str, Any] = {"dt": dt, "A": A, "disturbance": _box(rng, n)}
    events = [_event(rng, n, k, dt) for k in range(rng.integers(0, 3))]
    sensors = [_sensor(rng, n, k, dt) for k in range(rng.integers(1, 4))]
    return {"flow": flow, "sensor": sensors} | ({"event": events} if events else {})


def _event(rng: np.random.Generator, n: int, k: int, dt: float) -> dict[str, Any]:
    low = int(rng.integers(1, 5))
    every = [round(low * dt, 9), round((low + int(rng.integers(0, 4))) * dt, 9)]
    G = np.eye(n) + 0.4 * rng.normal(size=(n, n))
    return {"name": f"event_{k}", "G": G, "every": every, "disturbance": _box(rng, n)}


def _sensor(rng: np.random.Generator, n: int, k: int, dt: float) -> dict[str, Any]:
    p = int(rng.integers(1, 3))
    gap = round(dt * int(rng.integers(1, 7)), 9)
    noise: Any = rng.uniform(0.01, 0.3, p).tolist()
    if rng.random() < 0.3:
        noise = [[-0.5 * v, v] for v in noise]
    C = rng.normal(size=(p, n)) * (rng.random((p, n)) < 0.7)
    C[:, 0] += 0.5
    sees = str(rng.choice(["before", "after"]))
    return {"name": f"sensor_{k}", "C": C, "noise_bound": noise, "every": [0, gap], "sees": sees}


def _box(rng: np.random.Generator, n: int) -> dict[str, Any]:
    middle, radius = 0.1 * rng.normal(size=n), rng.uniform(0, 0.2, n) * (rng.random(n) < 0.8)
    return {"lower": middle - radius, "upper": middle + radius}


def tried(seed: int, kind: str) -> dict[str, int]:
    """Counts of one plant: rows, outside, contradictions, wide, designs."""
    rng = np.random.default_rng(seed)
    body = random_body(rng)
    body["observer"] = {"kind": kind} | ({"window": 10} if kind == "set_membership" else {})
    problem = Problem.from_dict(body)
    outcome = workflow.investigate(problem)
    counts = dict.fromkeys(("rows", "outside", "contradictions", "wide", "widths", "designs"), 0)
    if outcome.verdict != "proved" or outcome.design is None:
        return counts
    n = problem.plant.n
    widths = [claim.evidence["always"] for claim in outcome.claims if claim.id == "event_width"]
    start = [Fraction(int(x), 8) for x in rng.integers(-8, 9, n)]
    samples, truth = exact_record(problem, start, _ROWS, rng)
    observer = from_design(outcome.design)
    counts["designs"] = 1
    ends = np.ones(n), np.array([float(x) for x in start])
    for lower, upper, limits in ((-ends[0], ends[0], []), (ends[1], ends[1], widths)):
        state = observer.init(0.0, lower=lower, upper=upper)
        for sample, x in zip(samples, truth, strict=True):
            state, row = observer.step(state, sample)
            counts["outside"] += not _contains(row, x)
            counts["contradictions"] += row.status != "ok"
            counts["rows"] += 1
            if limits:
                counts["widths"] += 1
                # bounds of a state that grows without end are as wide as its rounding
                rounding = 1e-9 * max(abs(float(value)) for value in x)
                excess = row.upper - row.lower > np.array(limits[0]) * (1 + 1e-3) + 1e-6 + rounding
                counts["wide"] += bool(excess.any())
    return counts


def _contains(row: Estimate, x: Sequence[Fraction]) -> bool:
    """Are all states within their bounds, in exact numbers?"""
    ends = zip(row.lower.tolist(), x, row.upper.tolist(), strict=True)
    return all(Fraction(low) <= value <= Fraction(high) for low, value, high in ends)


def main(plants: int, first: int) -> int:
    """Try the plants with both kinds; exit code."""
    total: dict[str, int] = {}
    for seed in range(first, first + plants):
        for kind in ("interval", "set_membership"):
            counts = tried(seed, kind)
            if counts["outside"] or counts["contradictions"] or counts["wide"]:
                print(f"seed {seed} {kind}: {counts}")
            total = {key: total.get(key, 0) + value for key, value in counts.items()}
    print(total)
    return int(bool(total["outside"] or total["contradictions"] or total["wide"]))


if __name__ == "__main__":
    arguments = [int(word) for word in sys.argv[1:]]
    sys.exit(main(*(arguments + [40, 0][len(arguments) :])))
