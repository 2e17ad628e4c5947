"""10 000 random admissible runs of interval observers: does the state ever leave its bounds?

    python tests/long/random_enclosures.py [RUNS] [FIRST_SEED]

Plants up to five states, several outputs, known inputs, any jump measurement, meaningless gains,
missing samples, extreme, random and sinusoidal disturbances. Prints the worst relative margin;
exits with 1 if any run is violated.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.systems.interval_runs import SIMULATION_ROUNDING, random_run


def violation(seed: int) -> float:
    return random_run(seed).violation()


def main() -> int:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    seeds = range(first, first + runs)
    with ProcessPoolExecutor() as pool:
        found = list(pool.map(violation, seeds, chunksize=50))
    worst = max(range(runs), key=found.__getitem__)
    bad = sum(value > SIMULATION_ROUNDING for value in found)
    print(f"{runs} runs, {bad} violated; worst {found[worst]:.3e} (seed {seeds[worst]})")
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())
