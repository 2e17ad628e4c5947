"""Does a periodic interval observer ever lose the state, or get wider than was proved?

    python -m tests.long.periodic_enclosures [ROWS] [SEED]

Random plants (those of `periodic_plants`, with known inputs at flow and jumps, measurements before,
after or without jumps, one or two outputs) and their designs. Records with jumps at any time that
the range of dwell times allows, samples off the period, rows without a sample and missing ones;
the disturbance switches between corners many times a step, or at the worst moment for one
direction, and noise and jumps are at corners. Counts rows at which the state is outside by more
than what the simulation rounds, and, in records with every sample of the period, rows that are
wider than the proved width. Exits with 1 if there are any.
"""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import numpy as np

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.runtime import Sample, from_design
from tests.long.periodic_plants import random_problem

ROWS, SEED = 110_000, 11
ROWS_PER_RECORD, RECORDS_PER_PLANT, SWITCHES = 120, 6, 6
# of the simulated truth, relative to its size
ROUNDING = 1e-11


class Row(NamedTuple):
    """t, is a sample there, is a jump there."""

    t: float
    sampled: bool
    jump: bool


def varied(problem: obsdesign.Problem, rng: np.random.Generator) -> obsdesign.Problem:
    """The same with inputs, another number of outputs, another time of measurements at jumps."""
    body = problem.to_dict()
    n = problem.plant.n
    body["flow"]["B"] = rng.standard_normal((n, 1)).tolist()
    body["jump"]["E"] = rng.standard_normal((n, 1)).tolist()
    if rng.random() < 0.3:
        body["output"]["C"] = rng.standard_normal((2, n)).tolist()
        body["output"]["noise_bound"] = (0.05 * rng.random(2)).tolist()
        for name in ("noise_std", "noise_cv"):
            body["output"].pop(name, None)
    body["output"]["jump_measurement"] = str(rng.choice(["before", "after", "none"]))
    if rng.random() < 0.3:
        body["observer"]["objective"] = "narrowest"
    return obsdesign.Problem.from_dict(body)


def rows_of(plant: Any, rng: np.random.Generator, regular: bool) -> list[Row]:
    """regular: every sample of the period is there, save where a jump takes it."""
    h, (low, high) = plant.output.period, plant.jump.dwell_time
    fine = h / 8 if rng.random() < 0.8 else None
    jumps, t = set[float](), 0.0
    while t < ROWS_PER_RECORD * h:
        t += float(rng.choice([low, high, rng.uniform(low, high)]))
        if fine is not None and rng.random() < 0.9:  # never below the shortest
            t = np.ceil(t / fine - 1e-6) * fine
        jumps.add(round(t, 9))
    extra = set[float]()
    for _ in range(ROWS_PER_RECORD // 2):
        other = rng.uniform(0, ROWS_PER_RECORD) * h
        extra.add(round(other if fine is None else round(other / fine) * fine, 9))
    grid = {round(k * h, 9) for k in range(1, ROWS_PER_RECORD)}
    rows = []
    for now in sorted(grid | jumps | extra)[:ROWS_PER_RECORD]:
        due = now in grid and (regular or rng.random() < 0.9)
        rows.append(Row(now, due or (now not in grid and rng.random() < 0.5), now in jumps))
    return rows


def disturbed(plant: Any, x: Any, u: Any, h: float, rng: np.random.Generator) -> Any:
    """x after a time h: b at corners that change at random, or at the worst times for a direction."""
    n, flow = plant.n, plant.flow
    cuts = np.sort(rng.uniform(0, h, int(rng.integers(0, SWITCHES))))
    ends = np.diff([0.0, *cuts, h])
    direction, worst = rng.standard_normal(n), rng.random() < 0.5
    left = h
    for step in ends:
        if worst:
            toward = direction @ expm(flow.A * (left - step / 2))
            b = np.where(toward > 0, flow.upper, flow.lower)
        else:
            b = rng.choice([0.0, 1.0], n) * (flow.upper - flow.lower) + flow.lower
        Z = np.zeros((n + 1, n + 1))
        Z[:n, :n], Z[:n, n] = flow.A, b + flow.B @ u
        x = (expm(Z * step) @ np.append(x, 1.0))[:n]
        left -= step
    return x


def record(
    design: Any, plant: Any, rng: np.random.Generator, regular: bool
) -> tuple[int, int, int]:
    """(rows, rows outside, rows too wide) of one record."""
    claim = next(c for c in design.claims if c.id == "sampled_stability")
    always = np.array(claim.evidence["always"]) if claim.verdict == "proved" and regular else None
    observer, when = from_design(design), plant.output.jump_measurement
    x, u, t = rng.standard_normal(plant.n) * rng.choice([0.1, 10.0]), np.zeros(1), 0.0
    wide = 0.0 if regular else float(rng.choice([0.0, 1.0]))
    state = observer.init(0.0, lower=x - wide, upper=x + wide)
    outside = wider = count = 0
    size = 1.0

    def noisy(state: Any) -> Any:
        return plant.output.C @ state + rng.choice([-1.0, 1.0]) * plant.output.noise_bound

    for row in rows_of(plant, rng, regular):
        x, t = disturbed(plant, x, u, row.t - t, rng), row.t
        y = noisy(x) if row.sampled else None
        w = rng.standard_normal(1)
        if row.jump:
            c = np.where(rng.random(plant.n) < 0.5, plant.jump.upper, plant.jump.lower)
            x = plant.jump.G @ x + plant.jump.E @ w + c
            if y is not None and when == "after":
                y = noisy(x)
            if when == "none":
                y = None
        u = rng.standard_normal(1)
        state, seen = observer.step(state, Sample(t, y, u, w if row.jump else None, row.jump))
        size = max(size, float(np.abs(x).max()))
        count += 1
        outside += bool(np.any(np.maximum(seen.lower - x, x - seen.upper) > ROUNDING * size))
        outside += "outside" in seen.status or "crossed" in seen.status
        if always is not None:
            wider += bool(np.any(seen.upper - seen.lower > always * (1 + 1e-9) + ROUNDING * size))
        if not float(np.abs(x).max()) < 1e6:
            break
    return count, outside, wider


def main() -> int:
    """Counts; 1 if any row is outside or too wide."""
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else ROWS
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else SEED
    rows = outside = wider = plants = proved = 0
    while rows < wanted:
        rng = np.random.default_rng([seed, plants])
        outcome = obsdesign.investigate(varied(random_problem(rng), rng))
        plant = obsdesign.Problem.from_dict(outcome.design.problem).plant
        plants, proved = plants + 1, proved + (outcome.verdict == "proved")
        for k in range(RECORDS_PER_PLANT):
            found = record(outcome.design, plant, rng, regular=k % 2 == 0)
            rows, outside, wider = rows + found[0], outside + found[1], wider + found[2]
            if found[1] or found[2]:
                print(f"plant {plants - 1}, record {k}: {found}", flush=True)
    print(f"{plants} plants ({proved} proved), {rows} rows: {outside} outside, {wider} too wide")
    return int(outside + wider > 0)


if __name__ == "__main__":
    sys.exit(main())
