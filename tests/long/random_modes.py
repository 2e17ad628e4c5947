"""Does the state ever leave its bounds where modes take turns?

    python -m tests.long.random_modes [PLANTS] [FIRST_SEED]

Random plants (n = 1..3, two or three modes, some with maps on entry, outputs, inputs and disturbances
of their own; every second one has one or two events, of which some happen in some modes alone),
disturbances at corners, random and sines, one sample in ten missing. Prints rows and rows outside;
exits with 1 on one of them, or on a proved design that does not verify.
"""

from __future__ import annotations

import sys

import numpy as np

from obsdesign.data.simulation import simulate
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.workflow import investigate, verify
from tests.systems.switched import random_strokes, random_switched

# the simulated truth is rounded, relative to the size of the state
_ROUNDING = 1e-12


def rows_outside(problem: Problem, rng: np.random.Generator) -> tuple[int, int, str]:
    """(rows, rows outside, verdict) of the observer of a problem on three simulations."""
    outcome = investigate(problem)
    if outcome.design is None:
        return 0, 0, outcome.verdict
    if outcome.verdict == "proved" and verify(outcome.design).verdict != "proved":
        return 0, 1, "not verified"
    observer, rows, outside = from_design(outcome.design), 0, 0
    for disturbance in ("extreme", "random", "sine"):
        step = float(rng.choice([0.01, 0.05, 0.3]))
        run = simulate(problem.plant, disturbance=disturbance, rng=rng, until=40, step=step)
        y, x = run.block("y").copy(), run.block("x")
        y[rng.random(len(y)) < 0.1] = np.nan
        batch = observer.run_batch(
            run.t, y, run.block("u"), run.block("w"), run.happened, mode=run.mode,
            lower=x[0] - 1, upper=x[0] + 0.5,
        )  # fmt: skip
        room = _ROUNDING * (1 + np.abs(x))
        inside = ((batch.lower <= x + room) & (x - room <= batch.upper)).all(axis=1)
        rows, outside = rows + len(x), outside + int((~inside).sum())
    return rows, outside, outcome.verdict


def main(plants: int = 100, first: int = 0) -> int:
    """Return 1 where a row is outside."""
    rows = outside = proved = 0
    for seed in range(first, first + plants):
        rng = np.random.default_rng(seed)
        drawn = random_strokes if seed % 2 else random_switched
        own, bad, verdict = rows_outside(drawn(rng, "interval"), rng)
        rows, outside, proved = rows + own, outside + bad, proved + (verdict == "proved")
        if bad:
            print(f"seed {seed}: {bad} rows outside ({verdict})")
    print(f"{plants} plants ({proved} proved), {rows} rows, {outside} outside")
    return int(outside > 0)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
