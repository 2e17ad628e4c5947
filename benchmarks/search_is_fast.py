"""Longest dwell time to 1e-6 with its proofs, against bisection with the CVXPY script.

At least 100 / 40 / 15 times faster than 20 bisection steps of 200 points, which reach the same
accuracy and prove nothing. By default two of the 20 steps are timed, one on each side of the limit,
and counted ten times; --full runs all of them.
"""

from __future__ import annotations

import sys
from functools import partial

from benchmarks.cases import HIGH, LOW, cvxpy_script, duration, families, report, seconds
from lmi.arithmetic.arrays import Matrix
from lmi.decide.dwell_search import dwell_bracket

FLOORS = {2: 100.0, 4: 40.0, 8: 15.0}
STEPS, POINTS = 20, 200


def bisection(F: Matrix, H: Matrix, limit: float, full: bool) -> float:
    """Seconds of the bisection for the shortest dwell time, which is near `limit`."""
    if not full:
        ends = (limit * 1.02, max(limit * 0.98, 1e-3))
        timed = [seconds(partial(cvxpy_script, F, H, e, HIGH, POINTS))[0] for e in ends]
        return STEPS * sum(timed) / len(timed)

    def run() -> None:
        low, high = 0.0, HIGH
        for _ in range(STEPS):
            middle = (low + high) / 2
            feasible = cvxpy_script(F, H, middle, HIGH, POINTS) is not None
            low, high = (low, middle) if feasible else (middle, high)

    return seconds(run)[0]


def main(full: bool = False) -> bool:
    good = True
    small = next(families(2))
    cvxpy_script(small.F, small.H, LOW, HIGH, 5)  # imports and warms up
    for n, floor in FLOORS.items():
        ours, theirs = [], []
        for family in families(n):
            F, H = family.F, 1.2 * family.H  # LOW is too short at this gain
            time, bracket = seconds(partial(dwell_bracket, F, H, "shortest", HIGH), 2)
            if bracket.proved is None or bracket.not_proved is None:
                F, H = family.F, family.H
                time, bracket = seconds(partial(dwell_bracket, F, H, "longest", LOW), 2)
            ours.append(time)
            width = 0.0
            if bracket.proved and bracket.not_proved:
                width = abs(bracket.proved / bracket.not_proved - 1)
            ends = f"{bracket.proved} | {bracket.not_proved} {bracket.verdict}"
            if full:
                print(f"   n = {n}: {ends}, relative width {width:.1e}, {duration(time)}")
            # the script looks for a common P, which may end before windows do
            limit = bracket.proved if bracket.common is None else bracket.common
            theirs.append(bisection(F, H, limit or LOW, full))
        good &= report(f"shortest dwell, n = {n}", ours, theirs, floor)
    return good


if __name__ == "__main__":
    sys.exit(not main("--full" in sys.argv))
