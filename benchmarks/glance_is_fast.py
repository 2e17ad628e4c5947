"""All six kinds at a glance (`check`) against full designs, random plants of 2 to 6 states.

The longest glance takes at most a second of processor time, imports not counted; side by side, the
ratio to the designs is printed (floor 1.5).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from benchmarks.cases import report
from obsdesign import workflow
from obsdesign.check import check_all
from obsdesign.errors import InputError
from obsdesign.kinds import KINDS
from obsdesign.problem import Problem

LONGEST, FLOOR, PLANTS = 1.0, 1.5, 24
MEASURED = ("continuous", "at_jumps", "periodic")


def plants() -> Iterator[Problem]:
    for seed in range(PLANTS):
        rng = np.random.default_rng(seed)
        n, p, measured = 2 + seed % 5, 1 + seed % 2, MEASURED[seed % 3]
        body: dict[str, Any] = {
            "flow": {"A": (rng.normal(size=(n, n)) - np.eye(n)).tolist()},
            "output": {"C": rng.normal(size=(p, n)).tolist(), "measured": measured},
            "observer": {"kind": "luenberger"},
        }
        if measured == "periodic":
            body["output"]["period"] = 0.1
        if measured == "at_jumps" or seed % 4 < 2:
            G = np.eye(n) + 0.2 * rng.normal(size=(n, n))
            body["jump"] = {"G": G.tolist(), "dwell_time": [0.2, 0.6]}
        yield Problem.from_dict(body)


def timed(call: Callable[[Problem], Any], problem: Problem) -> float:
    began = time.process_time()
    call(problem)
    return time.process_time() - began


def designs(problem: Problem) -> None:
    for kind in KINDS:
        try:
            workflow.investigate(problem.for_kind(kind)[0])
        except InputError:
            continue


def main() -> bool:
    problems = list(plants())
    for problem in problems[:3]:  # imports
        check_all(problem)
    ours = [timed(check_all, problem) for problem in problems]
    theirs = [timed(designs, problem) for problem in problems]
    print(f"   longest glance {max(ours):.2f} s (at most {LONGEST:g}), design {max(theirs):.1f} s")
    return report("check, all designs", ours, theirs, FLOOR) & (max(ours) <= LONGEST)


if __name__ == "__main__":
    sys.exit(not main())
