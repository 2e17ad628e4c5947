"""`obsdesign --help` against importing everything eagerly, and the runtime against numpy alone.

The help takes at most 1/8 of the time of eager imports, the runtime 1.3 times that of numpy.
Each is a process of its own; both find byte code, as an installation leaves it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial

from benchmarks.cases import report, seconds

HELP_FLOOR, RUNTIME_CEILING = 8.0, 1.3
ROUNDS = 5

EAGER = """
import casadi, clarabel, click, cvxpy, flint, highspy, jinja2, jsonschema, matplotlib.figure, numpy
import rich.console, rich.table, scipy.linalg, scipy.optimize, scipy.signal
import obsdesign.workflow, obsdesign.studies.search.search, obsdesign.data.simulation
import obsdesign.pages.report, obsdesign.studies.comparison.compare
"""
RUNTIME, NUMPY = "import obsdesign.runtime", "import numpy"
HELP = "import sys; sys.argv = ['obsdesign', '--help']; from obsdesign.cli.main import main; main()"


def main() -> bool:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    run = partial(subprocess.run, capture_output=True, check=True, env=environment)
    times: dict[str, list[float]] = {}
    for _ in range(ROUNDS):
        for code in (HELP, EAGER, RUNTIME, NUMPY):
            call = [sys.executable, "-c", code]
            times.setdefault(code, []).append(seconds(partial(run, call))[0])
    good = report("obsdesign --help, eager imports", times[HELP], times[EAGER], HELP_FLOOR)
    least = 1 / RUNTIME_CEILING
    return good & report(f"{RUNTIME}, {NUMPY}", times[RUNTIME], times[NUMPY], least)


if __name__ == "__main__":
    sys.exit(not main())
