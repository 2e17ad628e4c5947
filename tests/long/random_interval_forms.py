"""Random plants for each form: does the state leave its bounds, or a width the proved one?

    python tests/long/random_interval_forms.py [PLANTS] [FIRST_SEED] [FORM ...]    default 200 a form

Two to six states, several outputs. Disturbances: every corner of the box of b, held (all 2^n sign
patterns, corners of c and v with them), all of them switching from corner to corner at every row,
and random ones. Prints verdicts, the largest
violation and how many proved widths were checked; exits with 1 if anything is violated.
"""

from __future__ import annotations

import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.systems.interval import FORMS, ROUNDING, trial

ALL = 2**6  # sign patterns of six states


def main() -> int:
    plants = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    good = True
    with ProcessPoolExecutor(2) as pool:
        for form in sys.argv[3:] or FORMS:
            seeds = range(first, first + plants)
            found = list(pool.map(trial, repeat(form, plants), seeds, repeat(ALL, plants)))
            widths = [one.wider for one in found if one.wider is not None]
            bad = [
                first + k
                for k, one in enumerate(found)
                if one.beyond > ROUNDING or (one.wider is not None and one.wider > ROUNDING)
            ]
            good &= not bad
            verdicts = dict(Counter(one.verdict for one in found))
            beyond = max(one.beyond for one in found)
            print(f"{form:16s} {verdicts}: beyond the bounds by {beyond:.1e}; "
                  f"{len(widths)} proved widths, exceeded by {max([0.0, *widths]):.1e}; "
                  f"violated: {bad or 'none'}", flush=True)  # fmt: skip
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
