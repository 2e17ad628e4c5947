"""The README's first command: from a plant file to a picture, in one folder."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import click
import numpy as np

from obsdesign import workflow
from obsdesign.cli.answers import EXIT_CODES
from obsdesign.cli.summary import show_summary
from obsdesign.data.csv_text import table_text
from obsdesign.data.execution import execute
from obsdesign.data.simulation import simulate
from obsdesign.design_file import load_design
from obsdesign.errors import InputError
from obsdesign.output_files import write_text
from obsdesign.pages.plotting.estimate import Comparison, plot_estimate
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import load_for_kind
from obsdesign.studies.typical import with_typical

_KINDS = ("set_membership", "interval")
_INITIAL_TRUTH = [1.0, 1.0]
_INITIAL_BOUNDS = [0.0, 2.0, 0.0, 2.0]


def run_demo(folder: Path) -> int:
    """Design, prove, simulate, run, plot; returns the exit code. Existing files are replaced."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder: {error.strerror}.") from None
    problem, data, picture = (str(folder / name) for name in ("problem.toml", "data.csv",
                                                              "bounds.png"))  # fmt: skip
    estimates = {kind: str(folder / f"{kind}.csv") for kind in _KINDS}
    designs = {kind: str(folder / f"{kind}.json") for kind in _KINDS}
    write_text(problem, files("obsdesign").joinpath("cli/demo.toml").read_text("utf-8"))
    for kind, design in designs.items():
        if code := _designed(problem, kind, design):
            return code
    loaded = load_for_kind(problem, _KINDS[0])[0]
    _simulate(loaded.plant, data)
    for kind, design in designs.items():
        tally = execute(design, data, estimates[kind], _INITIAL_BOUNDS, None)
        click.echo(f"{kind}: {tally.rows} rows of data, guarantee held on {tally.good}")
    own, other = estimates.values()
    plot_estimate(own, data, picture, None, Comparison(other, loaded))
    click.echo("written:")
    for name in (problem, *designs.values(), data, *estimates.values(), picture):
        click.echo(f"  {name}")
    return 0


def _designed(problem: str, kind: str, design: str) -> int:
    """Write and show a design that is proved, and proved again; the exit code."""
    loaded = load_for_kind(problem, kind)[0]
    outcome = workflow.investigate(loaded)
    if outcome.verdict != "proved" or outcome.design is None:
        show_summary(outcome, loaded.name)
        return EXIT_CODES[outcome.verdict]
    outcome.design.save(design)
    show_summary(with_typical(workflow.verify(load_design(design))), loaded.name)
    return 0


def _simulate(plant: Plant, data: str) -> None:
    record = simulate(
        plant, until=12.0, step=0.02, initial=_INITIAL_TRUTH, rng=np.random.default_rng(4)
    )
    write_text(data, table_text(record.columns))
