"""Bounds of finite-time observers with fast modes, whose known inputs switch between samples.

    python -m tests.long.switched_inputs [PLANTS]

Random plants with modes up to 100 per period, noise from 1e-9 on, t_0 up to 1.7e9, all methods,
against exact states (`tests.systems.switched_inputs`). Seeds are fixed. Prints rows, rows with
status ok and violations; exits with 1 if there are any.
"""

from __future__ import annotations

import sys

from tests.systems.switched_inputs import random_run
from tests.systems.time_stamps import Tally, fifty_digits

PLANTS = 400


def main(plants: int) -> int:
    tally, seed, done = Tally(), 0, 0
    with fifty_digits():
        while done < plants:
            violations = tally.violations
            done += random_run(seed, tally)
            if tally.violations > violations:
                print(f"violation: seed {seed}, {tally.violations - violations} rows")
            seed += 1
    print(f"{done} plants of {seed}, {tally.rows} rows, {tally.ok} ok ({dict(tally.words)})")
    print(f"{tally.violations} violations")
    return 1 if tally.violations else 0


if __name__ == "__main__":
    raise SystemExit(main(int(sys.argv[1]) if len(sys.argv) > 1 else PLANTS))
