"""Where a common P proves, windows of dwell times cost nothing: at least 0.9 of the speed."""

from __future__ import annotations

import sys
from functools import partial

from benchmarks.cases import HIGH, LOW, families, report, seconds
from lmi.decide.stability import decide

FLOOR = 0.9


def main() -> bool:
    good = True
    for n in (2, 4, 8):
        ours, theirs = [], []
        for f in families(n):
            time, verdict = seconds(partial(decide, f.F, f.H, LOW, HIGH), 7)
            ours.append(time)
            time, plain = seconds(partial(decide, f.F, f.H, LOW, HIGH, memory=0), 7)
            theirs.append(time)
            assert verdict.outcome == plain.outcome == "proved"
            assert "P" in verdict.evidence
        good &= report(f"memory auto, n = {n}, common P only", ours, theirs, FLOOR)
    return good


if __name__ == "__main__":
    sys.exit(not main())
