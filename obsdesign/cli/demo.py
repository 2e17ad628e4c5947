"""The README's first command: from a plant file to a picture, in one folder."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import click
import numpy as np

from obsdesign import workflow
from obsdesign.cli.answers import EXIT_CODES, show
from obsdesign.data.csv_text import table_text
from obsdesign.data.execution import execute
from obsdesign.data.simulation import simulate
from obsdesign.design_file import load_design
from obsdesign.errors import InputError
from obsdesign.output_files import write_text
from obsdesign.pages.plotting.estimate import plot_estimate
from obsdesign.problem.problem import load_problem

_INITIAL_TRUTH = [1.0, 1.0]
_INITIAL_BOUNDS = [0.0, 2.0, 0.0, 2.0]


def run_demo(folder: Path) -> int:
    """Design, prove, simulate, run, plot; returns the exit code. Existing files are replaced."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder: {error.strerror}.") from None
    names = ("problem.toml", "design.json", "data.csv", "estimate.csv", "estimate.png")
    problem, design, data, estimate, picture = (str(folder / name) for name in names)
    write_text(problem, files("obsdesign").joinpath("cli/demo.toml").read_text("utf-8"))
    outcome = workflow.investigate(load_problem(problem))
    if outcome.verdict != "proved" or outcome.design is None:
        show(outcome)
        return EXIT_CODES[outcome.verdict]
    outcome.design.save(design)
    show(workflow.verify(load_design(design)))
    rng = np.random.default_rng(4)
    record = simulate(
        load_problem(problem).plant, until=12.0, step=0.02, initial=_INITIAL_TRUTH,
        disturbance="sine", rng=rng,
    )  # fmt: skip
    write_text(data, table_text(record.columns))
    tally = execute(design, data, estimate, _INITIAL_BOUNDS, None)
    plot_estimate(estimate, data, picture)
    click.echo(f"{tally.rows} rows of data, guarantee held on {tally.good}; written:")
    for name in names:
        click.echo(f"  {folder / name}")
    return 0
