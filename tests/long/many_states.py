"""Random plants of many states: interval gains that are certified at once, or how far they miss.

    python -m tests.long.many_states [PLANTS] [N P] ...    default 10 plants of 8, 12 and 20 states

A mode that grows at 0.05 and jumps that mix all states; four outputs. Prints how many plants have
placed gains and how many of these are proved, the least growth of the width from jump to jump where
there are none, and processor seconds. Exits with 1 if placed gains are not proved.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

import obsdesign
from lmi.time_budget import UNLIMITED
from lmi.verdict import overall
from obsdesign.synthesis.interval.candidates import synthesize
from obsdesign.synthesis.interval.placed import placed_gains
from obsdesign.synthesis.interval.task import GainSearch
from obsdesign.verification.interval.claims import claims

RATE, MIXING = 0.05, 0.1


def plant(n: int, p: int, seed: int) -> obsdesign.Problem:
    """A random plant of kind `interval`, its gains open."""
    rng = np.random.default_rng([n, p, seed])
    A = rng.standard_normal((n, n)) / np.sqrt(n)
    A += (RATE - np.linalg.eigvals(A).real.max()) * np.eye(n)
    G = 0.9 * (np.eye(n) + MIXING * rng.standard_normal((n, n)) / np.sqrt(n))
    C = rng.standard_normal((p, n))
    return obsdesign.Problem.from_dict({
        "flow": {"A": A.tolist(), "disturbance": {"lower": [-0.1] * n, "upper": [0.1] * n}},
        "jump": {"G": G.tolist(), "dwell_time": [0.5, 1.0]},
        "output": {"C": C.tolist(), "noise_bound": [0.05] * p},
        "observer": {"kind": "interval"},
    })  # fmt: skip


def main() -> int:
    count, *sizes = [int(text) for text in sys.argv[1:]] or [10]
    pairs = list(zip(sizes[::2], sizes[1::2], strict=True)) or [(8, 4), (12, 4), (20, 4)]
    good = True
    for n, p in pairs:
        proved, missed, started = 0, list[float](), time.process_time()
        for seed in range(count):
            problem = plant(n, p, seed)
            placed = placed_gains(GainSearch(problem, {}, UNLIMITED))
            if placed.choice is None:
                missed.append(placed.growth)
                continue
            first = next(synthesize(problem))
            answers = claims(problem, first.document(), first.certificates)
            proved += overall(claim.verdict for claim in answers) == "proved"
        good &= proved == count - len(missed)
        seconds = (time.process_time() - started) / count
        least = f"; others grow {min(missed):.3f} to {max(missed):.3f} times" if missed else ""
        print(f"n = {n}, p = {p}: {count - len(missed)} of {count} placed, {proved} proved{least}; "
              f"{seconds:.1f} s each", flush=True)  # fmt: skip
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
