"""Bounds of the gantry crane in examples/gantry_crane_bounds.toml, beside its sensor strips.

python -m docs.figures.set_membership [FOLDER]      draws crane_bounds.png
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import obsdesign
from docs.figures.folder import chosen
from obsdesign.data.csv_text import table_text
from obsdesign.data.execution import execute
from obsdesign.data.simulation import simulate
from obsdesign.pages.plotting.estimate import Comparison, plot_estimate

EXAMPLE = Path(__file__).parents[2] / "examples" / "gantry_crane_bounds.toml"
START = (0.0, 0.0, 0.05, 0.0)
INITIAL = (-0.1, 0.1, -0.3, 0.3, -0.1, 0.1, -0.5, 0.5)


def draw(folder: Path) -> None:
    problem = obsdesign.load_problem(EXAMPLE)
    plant, rng = problem.plant, np.random.default_rng(1)
    record = simulate(plant, until=6.0, initial=START, rng=rng)
    with tempfile.TemporaryDirectory() as scratch:
        design, data, estimate = (str(Path(scratch, name)) for name in ("d.json", "y.csv", "x.csv"))
        obsdesign.design(problem).save(design)
        Path(data).write_text(table_text(record.columns))
        tally = execute(design, data, estimate, INITIAL, None)
        picture = str(folder / "crane_bounds.png")
        plot_estimate(estimate, data, picture, None, Comparison(problem=problem))
    print(f"written: {picture}; {tally.good} of {tally.rows} rows ok")


if __name__ == "__main__":
    draw(chosen())
