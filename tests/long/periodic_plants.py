"""How many random periodic plants are left undecided? Designs of kind interval, gains missing.

    python -m tests.long.periodic_plants [PLANTS] [SEED]

A plant: n = 2 or 3 states, one output, entries of A and C standard normal, A shifted so that its
largest real part is between 0.05 and 1 (an unstable flow), G the identity plus a tenth of standard
normals, period 0.10 to 0.30, dwell times in [1, 2], disturbances of at most 0.1 in b and c, noise
of at most 0.05. Prints the verdicts, and exits with 1 if more than one in ten is undecided.
"""

from __future__ import annotations

import sys
import time
from collections import Counter

import numpy as np

import obsdesign

PLANTS, SEED = 60, 7
DWELL = (1.0, 2.0)


def random_problem(rng: np.random.Generator, objective: str = "feasible") -> obsdesign.Problem:
    """A plant as above, everything of the observer left open but its kind."""
    n = int(rng.integers(2, 4))
    A = rng.standard_normal((n, n))
    A += np.eye(n) * (rng.uniform(0.05, 1.0) - np.linalg.eigvals(A).real.max())
    b, c = np.full(n, 0.1) * rng.random(n), np.full(n, 0.1) * rng.random(n)
    period = round(float(rng.uniform(0.1, 0.3)), 2)
    return obsdesign.Problem(
        flow={"A": A, "disturbance": {"lower": -b, "upper": b}},
        jump={"G": np.eye(n) + 0.1 * rng.standard_normal((n, n)), "dwell_time": list(DWELL),
              "disturbance": {"lower": -c, "upper": c}},
        output={"C": rng.standard_normal((1, n)), "noise_bound": [0.05 * rng.random()],
                "measured": "periodic", "period": period},
        observer={"kind": "interval", "objective": objective},
    )  # fmt: skip


def main() -> int:
    """Counts of verdicts and forms; 1 if more than one in ten is undecided."""
    plants = int(sys.argv[1]) if len(sys.argv) > 1 else PLANTS
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else SEED
    verdicts: Counter[str] = Counter()
    forms: Counter[str] = Counter()
    started = time.process_time()
    for k in range(plants):
        outcome = obsdesign.investigate(random_problem(np.random.default_rng([seed, k])))
        verdicts[outcome.verdict] += 1
        forms[f"{outcome.verdict} {outcome.result['form']}"] += 1
        if outcome.verdict != "proved":
            print(f"plant {k}: {outcome.verdict}", flush=True)
    seconds = (time.process_time() - started) / plants
    print(f"{plants} plants: {dict(verdicts)}, {dict(forms)}; {seconds:.2f} s each")
    return int(verdicts["undecided"] > plants / 10)


if __name__ == "__main__":
    sys.exit(main())
