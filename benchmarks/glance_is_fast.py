"""All kinds at once (`check`) against their designs one by one, random plants of 2 to 6 states.

Half of the plants take at most half a second of processor time, imports not counted, and none takes
longer than the designs whose answers it gives (but for noise; the ratio is of medians).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator

import numpy as np

from benchmarks.cases import duration, report, row
from lmi.arithmetic.arrays import NewEntries
from obsdesign import workflow
from obsdesign.errors import InputError
from obsdesign.kinds import KINDS
from obsdesign.problem.problem import Problem
from obsdesign.studies.check.which_kinds import check_all

TYPICAL, FLOOR, PLANTS = 0.5, 0.8, 24
MEASURED = ("continuous", "at_jumps", "periodic")


def plants() -> Iterator[Problem]:
    for seed in range(PLANTS):
        rng = np.random.default_rng(seed)
        n, p, measured = 2 + seed % 5, 1 + seed % 2, MEASURED[seed % 3]
        body: NewEntries = {
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


def timed(call: Callable[[Problem], object], problem: Problem) -> float:
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
    typical = float(np.median(ours))
    is_quick = typical <= TYPICAL
    row("check, median", duration(typical), "", duration(typical), f"<= {TYPICAL:g} s", is_quick)
    row("check and designs, longest", duration(max(ours)), duration(max(theirs)), "", "", True)
    return report("check, all designs", ours, theirs, FLOOR) & is_quick


if __name__ == "__main__":
    sys.exit(not main())
