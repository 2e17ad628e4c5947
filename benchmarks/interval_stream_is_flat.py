"""A stream of a million samples: memory does not grow with its length."""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Iterator

import numpy as np

from benchmarks.cases import row
from benchmarks.filters import PERIOD, N, observer
from obsdesign.runtime import Sample

ROWS, EARLY = 1_000_000, 20_000
ROOM = 2**20  # bytes that allocators and caches may move


def samples(rows: int) -> Iterator[Sample]:
    rng = np.random.default_rng(0)
    for k in range(rows):
        yield Sample(round(k * PERIOD, 2), rng.uniform(-0.04, 0.04, 1))


def main() -> bool:
    ours = observer("periodic")
    state = ours.init(0.0, lower=-np.ones(N), upper=np.ones(N))
    tracemalloc.start()
    early, status = 0, ""
    for k, estimate in enumerate(ours.run(state, samples(ROWS))):
        if k == EARLY:
            early = tracemalloc.get_traced_memory()[0]
            tracemalloc.reset_peak()
        status = estimate.status
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    grown = peak - early
    good = grown < ROOM and status == "ok"
    what = f"memory a stream of {ROWS} samples adds, KiB"
    return row(what, "", "", f"{grown / 1024:.0f}", f"<= {ROOM // 1024}", good)


if __name__ == "__main__":
    sys.exit(not main())
