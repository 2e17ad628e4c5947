"""Proving P for all theta takes at most twice as long as finding it, n = 4..16, no open box."""

from __future__ import annotations

import statistics
import sys
from functools import partial

from benchmarks.cases import HIGH, LOW, duration, families, row, seconds
from lmi.find.cutting_plane import propose
from lmi.prove.common_matrix import prove_common

SIZES = (4, 6, 8, 12, 16)
MOST = 2.0


def main() -> bool:
    good = True
    for n in SIZES:
        finds, proofs, boxes, open_boxes = [], [], [], 0
        for family in families(n):
            F, H = family.F, family.H
            own, proposal = seconds(partial(propose, F, H, LOW, HIGH), 3)
            assert proposal.P is not None
            time, verdict = seconds(partial(prove_common, F, H, proposal.P, LOW, HIGH), 3)
            finds.append(own)
            proofs.append(time)
            open_boxes += verdict.outcome != "proved"
            boxes.append(verdict.evidence.get("boxes", 0))
        ratio = statistics.median(p / f for p, f in zip(proofs, finds, strict=True))
        passed = ratio <= MOST and not open_boxes
        find, prove = (duration(statistics.median(times)) for times in (finds, proofs))
        what = f"proof in times of finding, n = {n}, {open_boxes} not proved"
        row(what, prove, find, f"{ratio:.2f}", f"<= {MOST:g}", passed)
        good &= passed
    return good


if __name__ == "__main__":
    sys.exit(not main())
