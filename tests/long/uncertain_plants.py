"""Random plants with parameters that vary: does the state leave its bounds?

    python tests/long/uncertain_plants.py [PLANTS] [FIRST_SEED] [SCALE] [KIND] [PROCESSES]

Default 5000, 0, 1, interval, 2. Two or three states, A, B, G, E and C uncertain, any gains,
coordinates, periodic samples, continuous ones or those at jumps alone, missing samples, the box of
the state known or not, known inputs beyond their bounds; parameters adversarial, bang-bang or
constant, 40 rows each. Of set_membership windows of 1 to 6 stages. SCALE above 1: parameters beyond
their ranges. Prints, for each form, the rows, those with finite bounds, the worst margin relative
to the width and the seeds of plants that leave their bounds; exits with 1 if any does (SCALE 1), or
if none does (SCALE above 1).
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from obsdesign.runtime.bounds_observer import BoundsObserver
from tests.systems.uncertain_plants import (
    PATTERNS,
    Play,
    Uncertain,
    boxed,
    boxed_columns,
    course,
    margins,
    random_uncertain,
)

ROWS = 40
# of the simulated truth, relative to the largest state
ROUNDING = 1e-11


def input_bounds(plant: Uncertain) -> dict[str, Any]:
    """Entries of a design of either kind that counts on known inputs up to 1."""
    named = (("input_bound", plant.B), ("jump_input_bound", plant.E))
    return {name: np.ones(X.shape[1]) for name, X in named if X is not None}


class Trial(NamedTuple):
    """A random plant: its form, the worst margin, and the rows with finite bounds."""

    form: str
    worst: float
    finite: int


def trial(seed: int, scale: float, kind: str) -> Trial:
    """The bounds of a random plant along one course."""
    rng = np.random.default_rng(seed)
    plant = random_uncertain(rng)
    x = rng.standard_normal(plant.n) * rng.choice([1.0, 10.0])
    play = Play(plant, PATTERNS[seed % len(PATTERNS)], rng, x, scale)
    step, radius = float(rng.choice([0.01, 0.1, 0.3])), rng.choice([0.0, 0.3])
    offset = rng.uniform(-1, 1, plant.n) * radius
    is_boxed = rng.random() < 0.5
    is_sparse = plant.G is not None and rng.random() < 0.3
    # a design that knows a box counts on known inputs up to 1, and says where they are larger
    run = course(play, ROWS, step, at_jumps=is_sparse, largest=float(rng.choice([1.0, 5.0])))
    if kind == "interval":
        observer: BoundsObserver[Any] = plant.observer(
            **(boxed(plant, run.lower, run.upper) | input_bounds(plant) if is_boxed else {})
        )
    else:
        entries = boxed_columns(plant, run.lower, run.upper) if is_boxed else {}
        if is_boxed:
            entries |= {"state_lower": run.lower, "state_upper": run.upper} | input_bounds(plant)
        observer = plant.set_membership(int(rng.integers(1, 7)), **entries)
    worst, widths = margins(observer, run, x - offset - radius, x - offset + radius)
    samples = "periodic" if "period" in plant.gains else "continuous"
    form = f"{'at_jumps' if is_sparse else samples}{', box' if is_boxed else ''}"
    return Trial(form, float(worst.min()), int(np.isfinite(widths).all(axis=1).sum()))


def main() -> int:
    words = [*sys.argv[1:], *("5000", "0", "1", "interval", "2")[len(sys.argv) - 1 :]]
    plants, first, processes = int(words[0]), int(words[1]), int(words[4])
    seeds = range(first, first + plants)
    each = partial(trial, scale=float(words[2]), kind=words[3])
    with ProcessPoolExecutor(processes) as pool:
        trials = list(zip(seeds, pool.map(each, seeds, chunksize=8), strict=True))
    bad = [seed for seed, each in trials if not each.worst > -ROUNDING]
    for form in sorted({each.form for _, each in trials}):
        own = [each for _, each in trials if each.form == form]
        print(f"{words[3]}, {form}: {len(own)} plants, {len(own) * ROWS} rows, "
              f"{sum(each.finite for each in own)} with finite bounds; worst margin "
              f"{min(each.worst for each in own):.1e}")  # fmt: skip
    print(f"{plants} plants, {plants * ROWS} rows; beyond its bounds: {len(bad)} {bad[:10]}")
    return int(bool(bad) == (float(words[2]) <= 1.0))


if __name__ == "__main__":
    raise SystemExit(main())
