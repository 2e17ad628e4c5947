"""P on 200 points against the obvious CVXPY script: at least 300 / 60 / 30 times faster.

Also against Clarabel with the cones of all 200 points assembled by hand.
"""

from __future__ import annotations

import sys

from benchmarks.cases import HIGH, LOW, cvxpy_script, families, report, seconds
from lmi.families import Edge, slack
from lmi.find.cutting_plane import propose
from lmi.find.semidefinite import common_matrices

FLOORS = {2: 300.0, 4: 60.0, 8: 30.0}
POINTS = 200


def main() -> bool:
    good = True
    cvxpy_script(*vars(next(families(2))).values(), LOW, HIGH, 5)  # imports and warms up
    for n, floor in FLOORS.items():
        ours, theirs, by_hand = [], [], []
        for family in families(n):
            edge = Edge(family.F, family.H, LOW, HIGH)
            _, maps = edge.grid(POINTS)
            time, proposal = seconds(
                lambda f=family: propose(f.F, f.H, LOW, HIGH, points=POINTS), 3
            )
            assert proposal.P is not None
            assert slack(proposal.P, maps).min() > 0
            ours.append(time)
            time, P = seconds(lambda f=family: cvxpy_script(f.F, f.H, LOW, HIGH, POINTS))
            assert slack(P, maps).min() > -1e-3
            theirs.append(time)
            some = maps[:: max(len(maps) // POINTS, 1)]
            by_hand.append(seconds(lambda m=some: common_matrices(m))[0])
        good &= report(f"find P, n = {n}, {POINTS} points, CVXPY", ours, theirs, floor)
        report(f"find P, n = {n}, full grid by hand", ours, by_hand, 1.0)
    return good


if __name__ == "__main__":
    sys.exit(not main())
