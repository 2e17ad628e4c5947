"""`obsdesign design`, n = 4, from process start to written file, against the CVXPY script.

Ours also proves the inequality for all dwell times; the script only solves it on 200 points.
Both find the byte code of what they import, as an installation leaves it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from benchmarks.cases import HIGH, LOW, families, report, seconds

FLOOR = 2.5

THEIRS = """
import json, sys
import numpy as np
import cvxpy as cp
from scipy.linalg import expm
body = json.load(open(sys.argv[1]))
F, H = np.array(body["flow"]["A"]), np.array(body["jump"]["G"])
P = cp.Variable((4, 4), symmetric=True)
constraints = [P >> np.eye(4)]
for theta in np.linspace(*body["jump"]["dwell_time"], 200):
    M = expm(F * theta) @ H
    constraints.append(P - M.T @ P @ M >> 1e-6 * np.eye(4))
cp.Problem(cp.Minimize(0), constraints).solve(solver=cp.CLARABEL)
json.dump({"P": P.value.tolist()}, open(sys.argv[2], "w"))
"""
OURS = "from obsdesign.cli.main import main; main()"


def main() -> bool:
    ours: list[float] = []
    theirs: list[float] = []
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    run = partial(subprocess.run, capture_output=True, env=environment)
    with tempfile.TemporaryDirectory() as folder:
        problem, out = Path(folder, "problem.json"), Path(folder, "design.json")
        for family in families(4):
            zeros = [[0.0]] * 4
            problem.write_text(json.dumps({
                "flow": {"A": family.F.tolist()},
                "jump": {"G": family.H.tolist(), "dwell_time": [LOW, HIGH]},
                "output": {"C": [[1.0, 0, 0, 0]]},
                "observer": {"kind": "luenberger", "gains": {"L": zeros, "M": zeros}},
            }))  # fmt: skip
            for script, times, words in (
                (OURS, ours, ["design", str(problem), "-o", str(out)]),
                (THEIRS, theirs, [str(problem), str(out)]),
            ):
                call = [sys.executable, "-c", script, *words]
                time, done = seconds(partial(run, call))
                assert done.returncode == 0, done.stderr
                times.append(time)
    return report("cold design, n = 4, CVXPY script", ours, theirs, FLOOR)


if __name__ == "__main__":
    sys.exit(not main())
