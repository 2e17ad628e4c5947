"""Proving P for all theta takes at most twice as long as finding it, n = 4..16, no open box."""

from __future__ import annotations

import statistics
import sys
from functools import partial

from benchmarks.cases import HIGH, LOW, duration, families, seconds
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
            find, proposal = seconds(partial(propose, F, H, LOW, HIGH), 3)
            assert proposal.P is not None
            prove, verdict = seconds(partial(prove_common, F, H, proposal.P, LOW, HIGH), 3)
            finds.append(find)
            proofs.append(prove)
            open_boxes += verdict.outcome != "proved"
            boxes.append(verdict.evidence.get("boxes", 0))
        ratio = statistics.median(p / f for p, f in zip(proofs, finds, strict=True))
        passed = ratio <= MOST and not open_boxes
        print(f"proof, n = {n:2d}: find {duration(statistics.median(finds)):>10s}, proof "
              f"{duration(statistics.median(proofs)):>10s}, ratio {ratio:5.2f} (at most {MOST:g}), "
              f"boxes {min(boxes)}-{max(boxes)}, families not proved {open_boxes}   "
              f"{'ok' if passed else 'ABOVE THE CEILING'}", flush=True)  # fmt: skip
        good &= passed
    return good


if __name__ == "__main__":
    sys.exit(not main())
