"""`compare`, `report`, `demo`, `schema`, `completion`: tables and pages."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

from obsdesign.cli.arguments import (
    AS_JSON,
    KINDS_OPTION,
    NUMBER,
    RENAME,
    Count,
    numbers,
    output_option,
    time_option,
)  # fmt: skip
from obsdesign.cli.talk import is_quiet, progress_message, say
from obsdesign.errors import InputError

# the environment variable in which a shell asks for completions
COMPLETE = "_OBSDESIGN_COMPLETE"


@click.command()
@click.argument("problem", type=click.Path())
@click.option("--data", type=click.Path(), help="Measurements to run on.  [default: a simulation]")
@click.option("--simulate", "simulated", is_flag=True, help="Simulate the plant, the default.")
@click.option("--until", type=NUMBER, help="End of the simulation.")
@click.option("--step", type=NUMBER, help="Time between its rows.")
@click.option("--seed", type=Count(min=0), help="Seed of the simulation.  [default: 0]")
@click.option("--initial", help="x1_lo,x1_hi,...; point observers begin in the middle.")
@KINDS_OPTION
@RENAME
@time_option()
@AS_JSON
def compare(
    *, problem: str, data: str | None, simulated: bool, seed: int | None, initial: str | None,
    kinds: list[str], titles: Mapping[str, str], seconds: float | None, as_json: bool,
    until: float | None, step: float | None,
) -> int:  # fmt: skip
    """Run the observers that PROBLEM admits on the same record, beside a Kalman filter."""
    import numpy as np

    from obsdesign.cli.answers import compare_answer, show_comparison
    from obsdesign.problem.problem import load_problem
    from obsdesign.studies.comparison.compare import compare as compare_all
    from obsdesign.studies.comparison.record import ComparisonRecord

    made = (seed, until, step)
    if data is not None and (simulated or any(value is not None for value in made)):
        raise InputError(
            "--data takes no --simulate, --until, --step or --seed: the record is the file's."
        )
    loaded = load_problem(problem)
    start = None if initial is None else numbers(initial, "--initial")
    if data is not None:
        record = ComparisonRecord.from_file(data, loaded, titles)
    else:
        rng = np.random.default_rng(seed or 0)
        record = ComparisonRecord.from_simulation(loaded.plant, until=until, step=step, rng=rng)
    with progress_message("comparing observers"):
        rows = list(compare_all(loaded, record, start, kinds=kinds, seconds=seconds))
    if as_json:
        click.echo(compare_answer(rows))
    elif not is_quiet():
        show_comparison(rows)
    return 0


@click.command()
@click.argument("design_file", metavar="DESIGN", type=click.Path())
@click.option(
    "--data",
    type=click.Path(),
    help="Run the observer on DATA.csv.  [default: a simulation of its plant]",
)
@click.option("--initial", help="Where it starts, as `run` takes it.")
@click.option(
    "--beside",
    type=click.Path(),
    help="Draw the bounds of this design of the same plant too.  [default: of kind interval, if "
    "DESIGN is of kind set_membership]",
)
@RENAME
@output_option("report.html", "HTML file.")
def report(
    *,
    design_file: str,
    data: str | None,
    initial: str | None,
    beside: str | None,
    output: str,
    titles: Mapping[str, str],
) -> int:
    """Prove DESIGN again and show it on one page: guarantees, claims, gains, an estimate."""
    from obsdesign.cli.answers import EXIT_CODES
    from obsdesign.output_files import refuse_overwriting
    from obsdesign.pages.estimates import DataSource
    from obsdesign.pages.report import write_report
    from obsdesign.verification.answers import reason

    refuse_overwriting(output, design_file, data, beside)
    start = None if initial is None else numbers(initial, "--initial")
    with progress_message("proving again"):
        outcome = write_report(design_file, output, DataSource(data, start, titles), beside)
    if outcome.verdict == "refuted":
        failed = [claim for claim in outcome.claims if claim.verdict == "refuted"]
        say("refuted: " + "; ".join(f"{c.id}: {reason(c)}" for c in failed))
        say("nothing written")
    else:
        say(f"written: {output}")
    return EXIT_CODES[outcome.verdict]


@click.command()
@click.argument("folder", default="obsdesign-demo", type=click.Path())
def demo(folder: str) -> int:
    """Design, prove, simulate, run and plot a shipped example into FOLDER."""
    from obsdesign.cli.demo import run_demo

    return run_demo(Path(folder))


@click.command()
@click.argument("which", type=click.Choice(["problem", "design"]), default="problem")
def schema(which: str) -> int:
    """Print the JSON Schema of problem files or of design files."""
    from importlib.resources import files

    click.echo(
        files("obsdesign").joinpath(f"problem/{which}.schema.json").read_text("utf-8").rstrip()
    )
    return 0


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> int:
    """Print the completion script of SHELL: eval "$(obsdesign completion bash)"."""
    from click.shell_completion import shell_complete

    root = click.get_current_context().find_root().command
    return shell_complete(root, {}, "obsdesign", COMPLETE, f"{shell}_source")
