"""The narrowest gains of example 4.1, all forms tried and proved: within a second."""

from __future__ import annotations

import sys
from pathlib import Path

from benchmarks.cases import duration, row, seconds
from obsdesign.problem.problem import Problem, load_problem
from obsdesign.workflow import investigate

LIMIT = 1.0
EXAMPLE = Path(__file__).parent.parent / "examples" / "degue_4_1.toml"


def main() -> bool:
    body = load_problem(EXAMPLE).to_dict()
    body["jump"]["dwell_time"] = [5, 5]
    body["observer"] = {"kind": "interval", "objective": "narrowest", "gain_limit": 20}
    time, outcome = seconds(lambda: investigate(Problem.from_dict(body)), 3)
    good = time <= LIMIT and outcome.verdict == "proved"
    what = "narrowest gains of 4.1, found and proved"
    return row(what, duration(time), "", duration(time), f"<= {LIMIT:g} s", good)


if __name__ == "__main__":
    sys.exit(not main())
