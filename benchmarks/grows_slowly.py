"""Twenty times the points, at most four times the time: N = 50 against N = 1000."""

from __future__ import annotations

import statistics
import sys
from functools import partial

from benchmarks.cases import HIGH, LOW, families, row, seconds
from lmi.find.cutting_plane import propose

CEILING = 4.0


def main() -> bool:
    good = True
    for n in (2, 4, 8):
        growth = []
        for f in families(n):
            few, many = (
                seconds(partial(propose, f.F, f.H, LOW, HIGH, points=k), 5)[0] for k in (50, 1000)
            )
            growth.append(many / few)
        ratio = statistics.median(growth)
        good &= ratio <= CEILING
        what = f"find P, n = {n}, 1000 points against 50, times"
        row(what, "", "", f"{ratio:.2f}", f"<= {CEILING:g}", ratio <= CEILING)
    return good


if __name__ == "__main__":
    sys.exit(not main())
