"""P on 200 points against the obvious CVXPY script: at least 300 / 60 / 30 times faster.

Also against Clarabel with the cones of all 200 points assembled by hand.
"""

from __future__ import annotations

import sys
from functools import partial

from benchmarks.cases import HIGH, LOW, cvxpy_script, families, report, seconds
from lmi.families import Edge, slack
from lmi.find.cutting_plane import propose
from lmi.find.semidefinite import common_matrices

FLOORS = {2: 300.0, 4: 60.0, 8: 30.0}
POINTS = 200


def main() -> bool:
    good = True
    small = next(families(2))
    cvxpy_script(small.F, small.H, LOW, HIGH, 5)  # imports and warms up
    for n, floor in FLOORS.items():
        ours, theirs, by_hand = [], [], []
        for family in families(n):
            F, H = family.F, family.H
            _, maps = Edge(F, H, LOW, HIGH).grid(POINTS)
            time, proposal = seconds(partial(propose, F, H, LOW, HIGH, points=POINTS), 3)
            assert proposal.P is not None
            assert slack(proposal.P, maps).min() > 0
            ours.append(time)
            time, P = seconds(partial(cvxpy_script, F, H, LOW, HIGH, POINTS))
            assert P is not None
            assert slack(P, maps).min() > -1e-3
            theirs.append(time)
            some = maps[:: max(len(maps) // POINTS, 1)]
            by_hand.append(seconds(partial(common_matrices, some))[0])
        good &= report(f"find P, n = {n}, {POINTS} points, CVXPY", ours, theirs, floor)
        report(f"find P, n = {n}, full grid by hand", ours, by_hand, 1.0)
    return good


if __name__ == "__main__":
    sys.exit(not main())
