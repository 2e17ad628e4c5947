"""`obsdesign run DATA.csv -o OUT.csv`, whole processes, against a script that one writes by hand.

The script reads rows with `csv`, filters them with filterpy (predict and update) and writes
estimates with `csv`; beside it the steady state of the same filter, gains factored once. Ours
checks the record whole before it writes, and answers with bounds and a status. Four states; samples
of a period, with jumps and without, kinds `interval` and `luenberger`. Floor: 1.5 times as fast
as predict and update, and no slower than the steady state.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.cases import report, seconds
from benchmarks.filters import PERIOD, A, C, N
from lmi.arithmetic.exponential import expm
from obsdesign.problem.problem import Problem
from obsdesign.workflow import design

FLOOR, STEADY_FLOOR = 1.5, 1.0
ROWS, REPEATS = 20_000, 3
OURS = "from obsdesign.cli.main import main; main()"
THEIRS = """
import csv, sys
import numpy as np
from filterpy.kalman import KalmanFilter
data, out, which, model = sys.argv[1:]
model = np.load(model)
kalman = KalmanFilter(dim_x=len(model["F"]), dim_z=1)
kalman.F, kalman.H = model["F"], model["C"]
kalman.Q, kalman.R = 1e-3 * np.eye(len(kalman.F)), 1e-3 * np.eye(1)
predict, update = kalman.predict, kalman.update
if which == "steady":
    for _ in range(500):
        kalman.predict()
        kalman.update(np.zeros((1, 1)))
    predict, update = kalman.predict_steadystate, kalman.update_steadystate
with open(data, newline="") as source, open(out, "w", newline="") as target:
    rows, lines = csv.reader(source), csv.writer(target)
    place = next(rows).index("y1")
    lines.writerow(["t", *(f"x{k + 1}" for k in range(len(kalman.F)))])
    for row in rows:
        predict()
        update(np.array([[float(row[place])]]))
        lines.writerow([row[0], *kalman.x.ravel().tolist()])
"""


def problem(kind: str, *, has_jumps: bool) -> Problem:
    options = {"form": "split", "objective": "narrowest", "gain_limit": 2.0}
    jump = {"G": 0.9 * np.eye(N), "dwell_time": [0.5, 2.0]} if has_jumps else None
    return Problem(
        flow={"A": A, "disturbance": {"lower": [-0.1] * N, "upper": [0.1] * N}}, jump=jump,
        output={"C": C, "noise_bound": [0.05]},
        observer={"kind": kind} | (options if kind == "interval" else {}),
    )  # fmt: skip


def write_record(path: Path, *, has_jumps: bool) -> None:
    rng = np.random.default_rng(0)
    t, y = np.round(np.arange(ROWS) * PERIOD, 2), rng.uniform(-0.04, 0.04, ROWS)
    jumps = [f",{int(k % 20 == 19)}" if has_jumps else "" for k in range(ROWS)]
    rows = zip(t.tolist(), y.tolist(), jumps, strict=True)
    lines = [f"{time!r},{value!r}{jump}\n" for time, value, jump in rows]
    path.write_text(("t,y1,jump\n" if has_jumps else "t,y1\n") + "".join(lines))


def holds(kind: str, folder: Path, run: Callable[[list[str]], object], *, has_jumps: bool) -> bool:
    data, out, file = (str(folder / name) for name in ("data.csv", "out.csv", "design.json"))
    write_record(Path(data), has_jumps=has_jumps)
    design(problem(kind, has_jumps=has_jumps)).save(file)
    initial = ["--initial", ",".join(["-1", "1"] * N)] if kind == "interval" else []
    ours = [sys.executable, "-c", OURS, "run", file, data, *initial, "-o", out]
    model = str(folder / "model.npz")
    peer = [sys.executable, "-c", THEIRS, data, out]
    times: dict[str, list[float]] = {"ours": [], "each": [], "steady": []}
    for _ in range(REPEATS):
        times["ours"].append(seconds(partial(run, ours))[0])
        for which in ("each", "steady"):
            times[which].append(seconds(partial(run, [*peer, which, model]))[0])
    what = f"run, {kind}, {'jumps' if has_jumps else 'no jumps'}"
    good = report(f"{what}, filterpy", times["ours"], times["each"], FLOOR)
    return good & report(f"{what}, steady state", times["ours"], times["steady"], STEADY_FLOOR)


def main() -> bool:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    run = partial(subprocess.run, check=True, capture_output=True, env=environment)
    cases = [(kind, has_jumps) for kind in ("interval", "luenberger") for has_jumps in (0, 1)]
    with tempfile.TemporaryDirectory() as folder:
        np.savez(Path(folder, "model.npz"), F=expm(A * PERIOD), C=C)
        # every case is measured, also behind one that fails
        results = [holds(kind, Path(folder), run, has_jumps=bool(x)) for kind, x in cases]
        return all(results)


if __name__ == "__main__":
    sys.exit(not main())
