"""Bounds of plants with modes and with sensors on clocks of their own.

python -m docs.figures.clocks [FOLDER]      draws valve.png, motor.png, gps.png, thermometer.png
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import obsdesign
from docs.figures.folder import chosen
from obsdesign.data.csv_text import table_text
from obsdesign.data.execution import execute
from obsdesign.data.simulation import Simulation, simulate
from obsdesign.pages.plotting.estimate import Comparison, plot_estimate
from obsdesign.problem.problem import Problem

EXAMPLES = Path(__file__).parents[2] / "examples"


def bounds(
    problem: Problem, record: Simulation, initial: Sequence[float], picture: Path,
    title: str = "bounds", others: Mapping[str, Problem] | None = None,
) -> None:  # fmt: skip
    """The bounds of a problem's design along a record, beside those of another by its title."""
    with tempfile.TemporaryDirectory() as scratch:
        data, estimates = Path(scratch, "data.csv"), []
        data.write_text(table_text(record.columns))
        for name, one in {title: problem, **(others or {})}.items():
            design, estimate = (str(Path(scratch, f"{name}.{end}")) for end in ("json", "csv"))
            obsdesign.design(one).save(design)
            tally = execute(design, str(data), estimate, initial, None)
            estimates.append(estimate)
            print(f"{tally.good} of {tally.rows} rows ok")
        compared = Comparison(estimates[1] if others else None, problem)
        plot_estimate(estimates[0], str(data), str(picture), None, compared)
    print(f"written: {picture}")


def valve(folder: Path) -> None:
    problem = obsdesign.load_problem(EXAMPLES / "valve.toml")
    record = simulate(problem.plant, until=200.0, step=0.05)
    bounds(problem, record, (-2, 2, -2, 2), folder / "valve.png")


def motor(folder: Path) -> None:
    problem, narrow = of_both_kinds("motor_encoders.toml")
    record = simulate(problem.plant, until=1.0, initial=(0.0, 0.0, 0.1))
    start = (-0.01, 0.01, -0.5, 0.5, -1, 1)
    bounds(narrow, record, start, folder / "motor.png", "set_membership", {"interval": problem})


def gps(folder: Path) -> None:
    problem, narrow = of_both_kinds("odometer_gps.toml")
    record = simulate(problem.plant, until=60.0, initial=(0.0, 1.0, 0.05))
    start = (-2, 2, -1, 2, -0.2, 0.2)
    bounds(narrow, record, start, folder / "gps.png", "set_membership", {"interval": problem})


def of_both_kinds(example: str) -> tuple[Problem, Problem]:
    """The problem of an example, and the same for kind `set_membership`."""
    problem = obsdesign.load_problem(EXAMPLES / example)
    return problem, problem.for_kind("set_membership")[0]


def thermometer(folder: Path) -> None:
    problem = obsdesign.load_problem(EXAMPLES / "thermometer.toml")
    plant, rng = problem.plant, np.random.default_rng(1)
    record = simulate(plant, until=300.0, step=5.0, rng=rng)
    sensors = [replace(sensor, sends_on_change=None) for sensor in plant.sensors]
    plain = Problem(plant.flow, sensor=sensors, observer={"kind": "interval"})
    bounds(problem, record, (0, 2, 0, 2), folder / "thermometer.png", "with silence",
           {"samples alone": plain})  # fmt: skip


def draw(folder: Path) -> None:
    for one in (valve, motor, gps, thermometer):
        one(folder)


if __name__ == "__main__":
    draw(chosen())
