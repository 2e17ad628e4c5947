"""Peak memory that finding P adds to the imports, n = 8, 1000 points: at most 1/40 of CVXPY's."""

from __future__ import annotations

import subprocess
import sys

from benchmarks.cases import SEEDS, report

FLOOR = 40.0
POINTS = 1000

# ru_maxrss never falls, so what the search adds is measured after everything was used once
SCRIPT = """
import resource, sys
import numpy as np
from benchmarks.cases import HIGH, LOW, Family, cvxpy_script
from lmi.find.cutting_plane import propose
F, H = np.array(eval(sys.argv[2])), np.array(eval(sys.argv[3]))
small = -np.eye(2), 0.5 * np.eye(2)
def run(F, H, points):
    if sys.argv[1] == "ours":
        return propose(F, H, LOW, HIGH, points=points)
    return cvxpy_script(F, H, LOW, HIGH, points)
run(*small, 5)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
run(F, H, {points})
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


def growth(which: str, F: list[list[float]], H: list[list[float]]) -> float:
    """Kilobytes added, at least one page so that a ratio exists."""
    script = SCRIPT.format(points=POINTS)
    done = subprocess.run(
        [sys.executable, "-c", script, which, repr(F), repr(H)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return max(float(done.stdout), 4.0)


def main() -> bool:
    from benchmarks.cases import families

    ours, theirs = [], []
    for _, family in zip(SEEDS, families(8), strict=True):
        F, H = family.F.tolist(), family.H.tolist()
        ours.append(growth("ours", F, H) / 1e3)
        theirs.append(growth("theirs", F, H) / 1e3)
    return report(f"peak memory, n = 8, {POINTS} points, CVXPY", ours, theirs, FLOOR, unit="MB")


if __name__ == "__main__":
    sys.exit(not main())
