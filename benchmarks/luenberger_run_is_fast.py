"""A whole record, kind `luenberger`, against a loop over filterpy, per sample.

Equal steps and irregular ones, with jumps every twenty rows and without. The loop predicts and
updates; at irregular times with a new expm(A h) for each row, at jumps with one more predict.
Floors: 14 times as fast at equal steps, 8 times at irregular ones.
Beside it, without a floor, what one writes by hand for equal steps: the steady-state gains, one
product for each row.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.linalg import expm

from benchmarks.cases import report
from benchmarks.filters import PERIOD, A, C, N, kalman_filter_of, record, side_by_side
from lmi.arithmetic.arrays import Matrix
from obsdesign.problem.problem import Problem
from obsdesign.runtime.luenberger.observer import LuenbergerObserver
from obsdesign.workflow import design

EQUAL_FLOOR, IRREGULAR_FLOOR = 14.0, 8.0
LONG, ROWS, APART = 20_000, 2000, 20
G = 0.9 * np.eye(N)


def observer(*, has_jumps: bool) -> LuenbergerObserver:
    problem = Problem(
        flow={"A": A}, jump={"G": G, "dwell_time": [0.3, 3.0]} if has_jumps else None,
        output={"C": C, "noise_bound": [0.05]}, observer={"kind": "luenberger"},
    )  # fmt: skip
    return LuenbergerObserver.from_gains(design(problem).gains)


def times(*, is_regular: bool) -> Matrix:
    if is_regular:
        return record(rows=LONG)[0]
    return np.cumsum(np.random.default_rng(1).uniform(0.6 * PERIOD, 1.4 * PERIOD, LONG))


def holds(*, has_jumps: bool, is_regular: bool) -> bool:
    t, y = times(is_regular=is_regular), record(rows=LONG)[1]
    jump = np.arange(LONG) % APART == APART - 1 if has_jumps else np.zeros(LONG, bool)
    steps = np.diff(t[:ROWS], prepend=t[0] - PERIOD).tolist()
    rows = list(zip(steps, [b.reshape(1, 1) for b in y[:ROWS]], jump.tolist()[:ROWS], strict=True))
    kalman, step = kalman_filter_of(A, C), expm(A * PERIOD)

    def whole() -> None:
        # anew: lengths that were met before are quicker
        batch = LuenbergerObserver(own.gains).run_batch(t, y, jump=jump)
        assert set(batch.status) == {"ok"}

    def filtering() -> None:
        for h, z, jumps in rows:
            kalman.F = step if is_regular else expm(A * h)
            kalman.predict()
            kalman.update(z)
            if jumps:
                kalman.F = G
                kalman.predict()

    own = observer(has_jumps=has_jumps)
    mine, other = side_by_side(whole, filtering, (LONG, ROWS))
    floor = EQUAL_FLOOR if is_regular else IRREGULAR_FLOOR
    what = f"{'equal' if is_regular else 'irregular'} steps{', jumps' if has_jumps else ''}"
    return report(f"luenberger, {what}, per sample", mine, other, floor)


def by_hand() -> None:
    """The ratio to a loop of one product and one correction for each row."""
    (t, y), step = record(rows=LONG), expm(A * PERIOD)
    own, K = observer(has_jumps=False), np.full((N, 1), 0.1)

    def whole() -> None:
        own.run_batch(t, y)

    def loop() -> None:
        x = np.zeros(N)
        for value in y[:ROWS]:
            x = step @ x
            x = x + K @ (value - C @ x)

    mine, other = side_by_side(whole, loop, (LONG, ROWS))
    report("luenberger, equal steps, numpy with fixed gains", mine, other, 0)


def main() -> bool:
    cases = [(has_jumps, is_regular) for has_jumps in (False, True) for is_regular in (True, False)]
    kept = [holds(has_jumps=own, is_regular=equal) for own, equal in cases]
    by_hand()
    return all(kept)


if __name__ == "__main__":
    sys.exit(not main())
