"""Sampled data, dwell times [0.4, 1.8885]: found, proved and searched for witnesses within 1 s.

A common P ends at 1.8276, the system is stable to 1.8889. Beside it the obvious alternative: a
uniform grid of windows, four cells at two dwell times back and two ahead, found but not proved.
"""

from __future__ import annotations

import itertools
import statistics
import sys

import numpy as np

from benchmarks.cases import SAMPLED, duration, report, row, seconds
from lmi.decide.stability import decide
from lmi.families import Edge
from lmi.find.cutting_plane import propose_edges
from lmi.find.windows import Windows

LOW, HIGH = 0.4, 1.8885
CEILING, FLOOR = 1.0, 10.0
RUNS = 9
CELLS, BACK, AHEAD = 4, 2, 2


def uniform_windows() -> Windows:
    """Every combination of equal cells of the dwell times BACK back and AHEAD ahead."""
    borders = np.linspace(LOW, HIGH, CELLS + 1)
    cells = np.array(list(itertools.product(range(CELLS), repeat=BACK + AHEAD)))
    return Windows(LOW, HIGH, -BACK, borders[cells], borders[cells + 1])


def grid() -> bool:
    windows = uniform_windows()
    links = windows.links()
    ends = zip(links.source, links.target, links.low, links.high, strict=True)
    edges = [Edge(*SAMPLED, float(a), float(b), None, int(s), int(t)) for s, t, a, b in ends]
    return propose_edges(edges, len(windows)).matrices is not None


def main() -> bool:
    ours, windows = [], 0
    for _ in range(RUNS):
        time, verdict = seconds(lambda: decide(*SAMPLED, LOW, HIGH))
        assert verdict.outcome == "proved"
        windows = verdict.evidence["window_count"]
        ours.append(time)
    time, proposed = seconds(grid)
    assert proposed
    typical, what = statistics.median(ours), f"sampled data to {HIGH}, {windows} windows"
    fast = typical <= CEILING
    row(what, duration(typical), "", duration(typical), f"<= {CEILING:g} s", fast)
    return (
        report(f"{CELLS ** (BACK + AHEAD)} uniform windows, not proved", ours, [time] * RUNS, FLOOR)
        and fast
    )


if __name__ == "__main__":
    sys.exit(not main())
