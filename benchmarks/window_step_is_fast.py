"""One sample of a finite-time observer against `numpy.linalg.lstsq` on a sliding window, n = 4.

At least 10 times faster with 1200 samples in the window; 120 samples are printed.
"""

from __future__ import annotations

import sys
from typing import Any

import obsdesign
from benchmarks.cases import SEEDS, np, report, seconds
from obsdesign.runtime import Sample, from_design

FLOORS = {120: 1.0, 1200: 10.0}
ROWS, WINDOW = 200, 6.0


def case(seed: int, k: int) -> tuple[Any, Any]:
    """An oscillator with four states, and its samples as functions of the last state."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((4, 4))
    problem = obsdesign.Problem(
        flow={"A": (A - A.T) / 2}, observer={"kind": "finite_time", "window": WINDOW},
        output={"C": rng.standard_normal((1, 4)), "measured": "periodic", "period": WINDOW / k},
    )  # fmt: skip
    return from_design(obsdesign.design(problem)), rng.standard_normal((k + ROWS + 1, 1))


def main() -> bool:
    good = True
    for k, floor in FLOORS.items():
        ours, theirs = [], []
        for seed in SEEDS:
            observer, y = case(seed, k)
            t = [i * WINDOW / k for i in range(len(y))]
            state = observer.init()
            for i in range(k + 1):
                state, _ = observer.step(state, Sample(t[i], y[i]))

            def steps(state: Any = state, observer: Any = observer, y: Any = y, t: Any = t) -> Any:
                for i in range(len(y) - ROWS, len(y)):
                    state, estimate = observer.step(state, Sample(t[i], y[i]))
                return estimate

            rows = observer.constants.rows

            def windows(rows: Any = rows, y: Any = y, k: int = k) -> Any:
                window = y[-ROWS - k : -ROWS, 0]
                for i in range(len(y) - ROWS, len(y)):
                    x = np.linalg.lstsq(rows, window, rcond=None)[0]
                    window = np.append(window[1:], y[i])
                return x

            time, estimate = seconds(steps, 5)
            ours.append(time / ROWS)
            time, x = seconds(windows, 5)
            theirs.append(time / ROWS)
            assert np.abs(estimate.x - x).max() <= 1e-9 * np.abs(x).max()
        good &= report(f"a sample, {k} in the window, lstsq", ours, theirs, floor)
    return good


if __name__ == "__main__":
    sys.exit(not main())
