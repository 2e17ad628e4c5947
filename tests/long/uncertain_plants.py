"""Random plants with parameters that vary: does the state leave its bounds?

    python tests/long/uncertain_plants.py [PLANTS] [FIRST_SEED] [SCALE]    default 5000, 0, 1

Two or three states, A, B, G, E and C uncertain, any gains, coordinates, periodic samples or
continuous ones, missing samples, the box of the state known or not; parameters adversarial, bang-bang or constant, 40 rows each.
SCALE above 1: parameters beyond their ranges. Prints the rows, the worst margin relative to the
width and the seeds of plants that leave their bounds; exits with 1 if any does (SCALE 1), or if
none does (SCALE above 1).
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.systems.uncertain_plants import PATTERNS, Play, boxed, course, margins, random_uncertain

ROWS = 40
# of the simulated truth, relative to the largest state
ROUNDING = 1e-11


def trial(seed: int, scale: float) -> tuple[float, int]:
    """(worst margin, rows with finite bounds) of a random plant."""
    rng = np.random.default_rng(seed)
    plant = random_uncertain(rng)
    x = rng.standard_normal(plant.n) * rng.choice([1.0, 10.0])
    play = Play(plant, PATTERNS[seed % len(PATTERNS)], rng, x, scale)
    step, radius = float(rng.choice([0.01, 0.1, 0.3])), rng.choice([0.0, 0.3])
    offset = rng.uniform(-1, 1, plant.n) * radius
    run = course(play, ROWS, step)
    known = boxed(plant, run.lower, run.upper) if rng.random() < 0.5 else {}
    worst, widths = margins(plant.observer(**known), run, x - offset - radius, x - offset + radius)
    return float(worst.min()), int(np.isfinite(widths).all(axis=1).sum())


def main() -> int:
    plants = int(sys.argv[1]) if len(sys.argv) > 1 else 5000
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    scale = float(sys.argv[3]) if len(sys.argv) > 3 else 1.0
    seeds = range(first, first + plants)
    with ProcessPoolExecutor(2) as pool:
        trials = list(pool.map(trial, seeds, repeat(scale), chunksize=8))
    bad = [seed for seed, (worst, _) in zip(seeds, trials, strict=True) if not worst > -ROUNDING]
    finite = sum(rows for _, rows in trials)
    print(f"{plants} plants, {plants * ROWS} rows, {finite} with finite bounds; worst margin "
          f"{min(worst for worst, _ in trials):.1e}; beyond its bounds: {len(bad)} {bad[:10]}")  # fmt: skip
    return int(bool(bad) == (scale <= 1.0))


if __name__ == "__main__":
    raise SystemExit(main())
