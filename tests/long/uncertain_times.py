"""Does a state, in fifty digits, ever leave its bounds where times of events are uncertain?

    python -m tests.long.uncertain_times [PLANTS] [FIRST_SEED]

Random plants (n = 1..4, one to three events, the first at uncertain times, with G = I or another,
windows apart or overlapping or long for a fast state, known inputs and doses, one or two sensors), disturbances and noise at
their ends, true times anywhere within the errors, from 0 or from 1.7e9 on. Prints rows, rows outside
and rows that contradict; exits with 1 on one of either.
"""

from __future__ import annotations

import sys

from tests.systems.time_stamps import fifty_digits
from tests.systems.uncertain_times import record

_LATE = 1.7e9
_REFUTING = ("outside", "void", "crossed")


def main(plants: int, first: int) -> int:
    rows = outside = contradicted = 0
    with fifty_digits():
        for seed in range(first, first + plants):
            since, fast = _LATE if seed % 3 == 0 else 0.0, 40.0 if seed % 5 == 0 else 1.0
            case = record(seed, 8.0, since=since, plain=seed % 4 == 0, fast=fast)
            times = case.outside()
            words = [x for x in case.statuses() if any(word in x for word in _REFUTING)]
            rows, outside = rows + len(case.rows), outside + len(times)
            contradicted += bool(words)
            if times or words:
                print(f"seed {seed}: outside at {times[:3]}, {words[:1]}")
    print(f"{rows} rows of {plants} plants, {outside} outside, {contradicted} contradictions")
    return 1 if outside or contradicted else 0


if __name__ == "__main__":
    given = [int(text) for text in sys.argv[1:]]
    raise SystemExit(main(*(given + [300, 0][len(given) :])))
