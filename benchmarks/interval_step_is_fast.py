"""One public step of an interval observer against filterpy's predict and update, four states.

Guards, status and both bounds included. Floors: 3 x, samples as events and slope scheme.
"""

from __future__ import annotations

import sys

import numpy as np

from benchmarks.cases import report
from benchmarks.filters import ROWS, N, kalman_filter, observer, record, side_by_side
from obsdesign.runtime import Sample
from obsdesign.runtime.interval.observer import IntervalObserver

FLOORS = {"periodic": 3.0, "continuous": 3.0}


def main() -> bool:
    t, y = record()
    samples = [Sample(float(a), b) for a, b in zip(t, y, strict=True)]
    columns = [b.reshape(1, 1) for b in y]
    kalman, good = kalman_filter(), True
    for measured, floor in FLOORS.items():
        ours = observer(measured)

        def steps(ours: IntervalObserver = ours) -> None:
            state = ours.init(0.0, lower=-np.ones(N), upper=np.ones(N))
            for sample in samples:
                state, estimate = ours.step(state, sample)
            assert estimate.status == "ok"

        def filtering() -> None:
            for z in columns:
                kalman.predict()
                kalman.update(z)

        def steady() -> None:
            for z in columns:
                kalman.predict_steadystate()
                kalman.update_steadystate(z)

        what, per = f"step, {measured} y, filterpy", (ROWS, ROWS)
        mine, other = side_by_side(steps, filtering, per)
        good &= report(what, mine, other, floor)
        mine, other = side_by_side(steps, steady, per)
        report(f"{what} steady state", mine, other, 0.0)
    return good


if __name__ == "__main__":
    sys.exit(not main())
