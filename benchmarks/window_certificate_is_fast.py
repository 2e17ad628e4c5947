"""Strong observability of three integrators over spacings in [0.1, 0.8]: at most 0.5 s of work.

Search included. Beside it what people do instead, a rank test at 100 000 random spacings, which
proves nothing.
"""

from __future__ import annotations

import statistics
import sys
from functools import partial

import numpy as np

from benchmarks.cases import duration, row, seconds
from lmi.arithmetic.balls import exact
from lmi.rank.decide import decide_full_rank
from lmi.rank.stack import Stack

MOST = 0.5
LOW, HIGH = 0.1, 0.8
SAMPLES = 100_000


def main() -> bool:
    times = []
    for seed in range(5):
        T = np.eye(3) if seed == 0 else np.random.default_rng(seed).standard_normal((3, 3))
        back = np.linalg.inv(T)
        A = T @ np.diag(np.ones(2), 1) @ back
        stack = Stack(exact(A), exact(np.eye(3)), exact(np.eye(3)[:1] @ back), exact(np.eye(3)), 3)
        took, verdict = seconds(partial(decide_full_rank, stack, LOW, HIGH), 3)
        assert verdict.outcome == "proved", verdict
        times.append(took)
    points = np.random.default_rng(0).uniform(LOW, HIGH, (SAMPLES, 2))
    sampled, _ = seconds(lambda: np.linalg.svd(stack.approx(points), compute_uv=False), 1)
    mine = statistics.median(times)
    boxes = verdict.evidence["boxes"]
    what = f"rank of a window, {boxes} boxes, {SAMPLES} rank tests"
    limit = f"<= {duration(MOST)}"
    return row(what, duration(mine), duration(sampled), duration(mine), limit, mine <= MOST)


if __name__ == "__main__":
    sys.exit(not main())
