"""Example 4.1 with the paper's gains and with the narrowest ones; oral doses between samples.

python examples/narrowest_bounds.py [FOLDER]       writes degue_4_1.png and oral_doses.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import obsdesign
from obsdesign.data.simulation import simulate
from obsdesign.pages.plotting.bounds import plot_bounds
from obsdesign.runtime import from_design

HERE = Path(__file__).parent


def compared(output: Path) -> dict[str, float]:
    """Mean width x1 + x2 of both designs on one record with dwell time 5, after 10 jumps."""
    problems = {
        "gains of the paper": obsdesign.load_problem(HERE / "degue_4_1.toml").with_dwell_time(5, 5),
        "narrowest": obsdesign.load_problem(HERE / "degue_4_1_narrowest.toml"),
    }
    plant = problems["narrowest"].plant
    record = simulate(plant, until=60.0, step=0.01, initial=[1.0, 1.0], disturbance="sine",
                      dwell=5.0, rng=np.random.default_rng(1))  # fmt: skip
    found, means = {}, {}
    last = record.t > 50.0
    for label, problem in problems.items():
        batch = from_design(obsdesign.design(problem)).run_batch(
            record.t, record.block("y"), jump=record.columns["jump"], lower=[0, 0], upper=[2, 2]
        )
        found[label] = batch.lower[last], batch.upper[last]
        means[label] = float((batch.upper - batch.lower)[last].sum(axis=1).mean())
    plot_bounds(record.t[last], record.block("x")[last], found, str(output))
    return means


def doses(output: Path) -> bool:
    """Three days of doses, 6 to 14 hours apart; is the state inside all the way?"""
    problem = obsdesign.load_problem(HERE / "oral_doses.toml")
    plant, rng = problem.plant, np.random.default_rng(3)
    record = simulate(plant, until=72.0, step=0.25, initial=[100.0] + [0.0] * 5,
                      disturbance="random", rng=rng)  # fmt: skip
    batch = from_design(obsdesign.design(problem)).run_batch(
        record.t, record.block("y"), jump=record.columns["jump"],
        lower=[90.0] + [0.0] * 5, upper=[110.0] + [10.0] * 5,
    )  # fmt: skip
    x = record.block("x")
    plot_bounds(record.t, x, {"bounds": (batch.lower, batch.upper)}, str(output))
    return bool(np.all((batch.lower <= x) & (x <= batch.upper)))


def main(folder: str = ".") -> None:
    """Both pictures, and what they show in a line each."""
    home = Path(folder)
    for label, mean in compared(home / "degue_4_1.png").items():
        print(f"example 4.1, {label}: mean width {mean:.4f}")
    print(f"oral doses: inside the bounds: {doses(home / 'oral_doses.png')}")


if __name__ == "__main__":
    main(*sys.argv[1:])
