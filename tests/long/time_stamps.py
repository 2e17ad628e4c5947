"""Bounds and estimates at stamps up to 1.7e18, steps from one ulp on, against exact states.

    python -m tests.long.time_stamps [ROWS]

Random plants, gains, disturbances, jumps and missing samples (`tests.systems.time_stamps`):
interval observers in every mode as stream, batch, bundle and fleet; bounds of finite-time
observers; the recursion of the point observer. Seeds are fixed. Prints rows, rows with status ok
and violations; exits with 1 if there are any.
"""

from __future__ import annotations

import sys

from tests.systems.time_stamps import (
    ORIGINS,
    Tally,
    bounds_run,
    fifty_digits,
    finite_time_run,
    luenberger_run,
)

ROWS = 1_000_000  # about two thirds of them have status ok
FINITE_TIME_RUNS, LUENBERGER_RUNS = 60, 600
TOLERANCE = 1e-12  # of the point observer's recursion, of the largest state


def main(rows: int) -> int:
    tally, worst = Tally(), 0.0
    with fifty_digits():
        for seed in range(FINITE_TIME_RUNS):
            finite_time_run(seed, ORIGINS[seed % 3], 200, tally)
        for seed in range(LUENBERGER_RUNS):
            worst = max(worst, luenberger_run(seed, ORIGINS[seed % 3], 40))
        seed = 0
        while tally.rows < rows:
            violations = tally.violations
            bounds_run(seed, ORIGINS[seed % 3], 40, tally)
            if tally.violations > violations:
                print(f"violation: seed {seed}, origin {ORIGINS[seed % 3]:g}")
            seed += 1
    print(f"{tally.rows} rows, {tally.ok} ok ({dict(tally.kinds)}), {seed} records")
    print(f"not ok: {dict(tally.words)}")
    print(f"{tally.violations} violations; point observer off by {worst:.1e} at most")
    return 1 if tally.violations or not worst < TOLERANCE else 0


if __name__ == "__main__":
    raise SystemExit(main(int(sys.argv[1]) if len(sys.argv) > 1 else ROWS))
