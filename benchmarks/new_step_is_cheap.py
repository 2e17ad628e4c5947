"""What a step length that was not met before adds to a row of the multiplier observer.

Rows with irregular steps, each by an observer that has not met its length, and again by one that
has. Ceiling: 0.3 ms for 2, 4 and 8 states, the median over all rows.
"""

from __future__ import annotations

import statistics
import sys
import time

import numpy as np

from benchmarks.cases import duration, row
from obsdesign.runtime.base import Sample
from tests.systems.set_membership import Case, cases, observer_of

CEILING = 300e-6
PLANTS = ("rand2_21", "rand4_41", "rand4_42", "rand8_81")
WINDOW, ROWS, WARM, REPEATS = 16, 120, 30, 5


def record(case: Case, seed: int) -> list[Sample]:
    """A plant at rest, seen with noise inside its bounds, at times with lengths of their own."""
    rng = np.random.default_rng(seed)
    times = 100.0 + np.cumsum(rng.uniform(0.05, 0.15, ROWS))
    noise = rng.uniform(-0.5, 0.5, (ROWS, len(case.V))) * case.V
    return [Sample(float(t), v) for t, v in zip(times, noise, strict=True)]


def added(case: Case, seed: int) -> list[tuple[float, float]]:
    """(seconds of a row with a known length, what a new one adds), of all rows behind the first."""
    samples = record(case, seed)
    observer = observer_of(case, WINDOW)
    passes = []
    for _ in range(2):
        state, seconds = observer.init(99.9, lower=case.x0[0], upper=case.x0[1]), []
        for sample in samples:
            start = time.process_time()
            state, estimate = observer.step(state, sample)
            seconds.append(time.process_time() - start)
        assert estimate.status == "ok"
        passes.append(seconds[WARM:])
    return [(known, new - known) for new, known in zip(*passes, strict=True)]


def main() -> bool:
    good = True
    for name in PLANTS:
        case = cases()[name]
        rows = [pair for seed in range(REPEATS) for pair in added(case, seed)]
        known, more = (statistics.median(values) for values in zip(*rows, strict=True))
        good &= more <= CEILING
        what = f"a new length, set_membership, {case.n} states"
        limit = f"<= {duration(CEILING)}"
        row(what, duration(known), "", f"+{duration(more)}", limit, more <= CEILING)
    return good


if __name__ == "__main__":
    sys.exit(not main())
