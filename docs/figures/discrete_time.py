"""Bounds of the plant in examples/two_rates.toml by two kinds, and their widths.

python -m docs.figures.discrete_time [FOLDER]       draws two_rates.png
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

EXAMPLE = Path(__file__).parents[2] / "examples" / "two_rates.toml"
START, INITIAL = (0.5, -1.0, 0.2), (-1, 1, -2, 2, -0.5, 0.5)


def draw(folder: Path) -> None:
    problem = obsdesign.load_problem(EXAMPLE)
    plant, rng = problem.plant, np.random.default_rng(6)
    record = simulate(plant, until=8.0, initial=START, disturbance="sine", rng=rng)
    with tempfile.TemporaryDirectory() as scratch:
        data, picture = str(Path(scratch, "y.csv")), str(folder / "two_rates.png")
        Path(data).write_text(table_text(record.columns))
        estimates = {}
        for kind in ("set_membership", "interval"):
            design, estimates[kind] = (str(Path(scratch, kind + end)) for end in (".json", ".csv"))
            obsdesign.design(problem.for_kind(kind)[0]).save(design)
            tally = execute(design, data, estimates[kind], INITIAL, None)
            print(f"{kind}: {tally.good} of {tally.rows} rows ok")
        compared = Comparison(estimates["interval"], problem)
        plot_estimate(estimates["set_membership"], data, picture, None, compared)
    print(f"written: {picture}")


if __name__ == "__main__":
    draw(chosen())
