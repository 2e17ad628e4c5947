"""The command line: parse, one call, print. Heavy imports stay inside the commands.

Exit codes: 0 proved or done, 1 refuted, 2 bad input or usage, 3 undecided.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import click

from obsdesign.commands.export import export
from obsdesign.commands.sweep import sweep
from obsdesign.errors import InputError


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="obsdesign")
def cli() -> None:
    """Observers for impulsive, sampled and unknown-input linear systems."""


cli.add_command(sweep)
cli.add_command(export)


def main() -> None:
    """Entry point: turns every expected failure into one line on stderr and an exit code."""
    try:
        # not cli.main(): it answers a closed pipe with exit code 1, which means refuted here
        with cli.make_context("obsdesign", sys.argv[1:]) as context:
            code = cli.invoke(context)
        sys.stdout.flush()
    except click.exceptions.Exit as leaving:
        code = leaving.exit_code
    except (InputError, click.ClickException) as error:
        text = error.format_message() if isinstance(error, click.ClickException) else str(error)
        click.echo(f"obsdesign: {' '.join(text.split())}", err=True)
        code = 2
    except (click.Abort, KeyboardInterrupt):
        code = 130
    except BrokenPipeError:  # the reader of our output left: nothing to complain about
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 141
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        click.echo(f"obsdesign: the output cannot be written: {error.strerror}.", err=True)
        code = 2
    sys.exit(code if isinstance(code, int) else 0)


@cli.command()
@click.argument("folder", default="obsdesign-demo")
def demo(folder: str) -> int:
    """Design, prove, simulate, run and plot a shipped example into FOLDER."""
    from obsdesign.demo import run_demo

    return run_demo(Path(folder))


@cli.command()
@click.argument("problem")
@click.option("--kind", help="Observer kind; options of another kind in the file are dropped.")
@click.option("-o", "--output", default="design.json", show_default=True, help="Design file.")
@click.option("--allow-undecided", is_flag=True, help="Write a design with undecided claims too.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout.")
def design(
    problem: str, kind: str | None, output: str, allow_undecided: bool, as_json: bool
) -> int:
    """Synthesise what PROBLEM leaves open, prove it, and write a design file."""
    from obsdesign import workflow
    from obsdesign.document import refuse_overwriting
    from obsdesign.presentation import EXIT_CODES, answer, show
    from obsdesign.problem import load_for_kind, load_problem

    loaded, dropped = load_for_kind(problem, kind) if kind else (load_problem(problem), [])
    refuse_overwriting(output, problem)
    try:
        outcome = workflow.investigate(loaded)
    except InputError as error:
        raise InputError(f"{problem}: {error}") from None
    if dropped:
        click.echo(f"obsdesign: dropped for kind {kind}: {', '.join(dropped)}", err=True)
    keep = outcome.verdict == "proved" or (outcome.verdict == "undecided" and allow_undecided)
    written = output if keep and outcome.design else None
    if outcome.design and written:
        outcome.design.save(written)
    if as_json:
        gains = outcome.design.gains if outcome.design else {}
        click.echo(answer("design", outcome, {**outcome.result, "file": written, "gains": gains}))
    else:
        show(outcome)
        click.echo(f"written: {written}" if written else "nothing written")
    return EXIT_CODES[outcome.verdict]


@cli.command()
@click.argument("problem")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout.")
def check(problem: str, as_json: bool) -> int:
    """For each observer kind: can it be built for the plant in PROBLEM, and if not, why."""
    from obsdesign.check import check_all
    from obsdesign.presentation import EXIT_CODES, check_answer, show_check
    from obsdesign.problem import load_problem

    verdict, found = check_all(load_problem(problem))
    if as_json:
        click.echo(check_answer(verdict, found))
    else:
        show_check(found)
    return EXIT_CODES[verdict]


@cli.command()
@click.argument("design_file", metavar="DESIGN")
@click.option("--paranoid", is_flag=True, help="Prove a second time by an independent method.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout.")
def verify(design_file: str, paranoid: bool, as_json: bool) -> int:
    """Prove everything in DESIGN again, from the file alone and without a solver."""
    from obsdesign import workflow
    from obsdesign.document import load_design
    from obsdesign.presentation import EXIT_CODES, answer, show

    design = load_design(design_file)
    try:
        outcome = workflow.verify(design, paranoid=paranoid)
    except InputError as error:
        raise InputError(f"{design_file}: {error}") from None
    if as_json:
        click.echo(answer("verify", outcome, outcome.result))
    else:
        show(outcome)
    return EXIT_CODES[outcome.verdict]


@cli.command()
@click.argument("problem")
@click.option("--for", "what", required=True, metavar="WHAT",
              help="shortest_dwell, longest_dwell, longest_period, shortest_window.")  # fmt: skip
@click.option("--kind", help="Observer kind; options of another kind in the file are dropped.")
@click.option("--accuracy", type=float, default=1e-6, show_default=True, help="Relative width.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout.")
def search(problem: str, what: str, kind: str | None, accuracy: float, as_json: bool) -> int:
    """Find the limit of WHAT for PROBLEM: a bracket, proved on one side."""
    from obsdesign import search as searching
    from obsdesign.presentation import EXIT_CODES, answer, show_bracket
    from obsdesign.problem import load_for_kind, load_problem

    loaded, dropped = load_for_kind(problem, kind) if kind else (load_problem(problem), [])
    try:
        outcome = searching.search(loaded, what, accuracy)
    except InputError as error:
        raise InputError(f"{problem}: {error}") from None
    if dropped:
        click.echo(f"obsdesign: dropped for kind {kind}: {', '.join(dropped)}", err=True)
    if as_json:
        click.echo(answer("search", outcome, outcome.result))
    else:
        show_bracket(what, outcome)
    return EXIT_CODES[outcome.verdict]


@cli.command()
@click.argument("source", metavar="PROBLEM_OR_DESIGN")
@click.option("--until", type=float, help="End time.  [default: about ten dwell times]")
@click.option(
    "--step", type=float, help="Time between rows.  [default: the period, or about until/500]"
)
@click.option("--initial", help="True initial state x1,...,xn.  [default: ones]")
@click.option("--dwell", default="random", show_default=True,
              help="shortest, random, a number, or a file of dwell times.")  # fmt: skip
@click.option("--disturbance", default="random", show_default=True,
              help="zero, extreme, random or sine.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--events", help="Write the true unknown impulses to this file.")
@click.option("-o", "--output", default="data.csv", show_default=True, help="Data file.")
def simulate(source: str, output: str, events: str | None, seed: int, **options: Any) -> int:
    """Simulate the plant of a problem or design exactly, with its true state."""
    import numpy as np

    from obsdesign.document import refuse_overwriting, write_text
    from obsdesign.records import table_text
    from obsdesign.simulation import simulate as run_simulation

    refuse_overwriting(output, source)
    refuse_overwriting(events, source)
    if events is not None and events == output:
        raise InputError(f"--events: {events} is the data file; give another name.")
    plant = _plant(source)
    if options["initial"] is not None:
        options["initial"] = _numbers(options["initial"], "--initial")
    if options["dwell"] not in ("shortest", "random"):
        options["dwell"] = _dwell(options["dwell"])
    record = run_simulation(plant, rng=np.random.default_rng(seed), **options)
    write_text(output, table_text(record.columns))
    if events:
        width = max(record.events.shape[1] - 1, 1)
        names = ["t", *(["weight"] if width == 1 else [f"weight{i + 1}" for i in range(width)])]
        columns = record.events.reshape(-1, width + 1).T
        write_text(events, table_text(dict(zip(names, columns, strict=True))))
    click.echo(f"written: {output}, {len(record.t)} rows until t = {record.t[-1]:g}"
               if len(record.t) else f"written: {output}, no rows")  # fmt: skip
    return 0


@cli.command()
@click.argument("design_file", metavar="DESIGN")
@click.argument("data", required=False)
@click.option("-o", "--output", help="Estimate file.  [default: standard output]")
@click.option("--initial", help="x1,...,xn; for bounds x1_lo,x1_hi,... (required).")
@click.option("--events", help="Write found impulses, or a log of events, to this file.")
def run(
    design_file: str, data: str | None, output: str | None, initial: str | None, events: str | None
) -> int:
    """Execute DESIGN on DATA.csv, or row by row on standard input."""
    from obsdesign.execution import execute

    start = None if initial is None else _numbers(initial, "--initial")
    counts = execute(design_file, data, output, start, events)
    total = counts.pop("rows")
    told = ", ".join(f"{number} {status}" for status, number in counts.most_common())
    click.echo(f"{total} rows: {told}", err=True)
    return 0


@cli.command()
@click.argument("estimate")
@click.argument("data", required=False)
@click.option("-o", "--output", default="estimate.png", show_default=True, help="PNG or SVG file.")
@click.option("--events", help="Draw the impulses of this file too, with the measurements.")
def plot(estimate: str, data: str | None, output: str, events: str | None) -> int:
    """Picture an estimate file, against the true state where DATA.csv has it.

    ESTIMATE may also be the answer of `search --json` or a design: the dwell times that are proved;
    or the JSON lines of `sweep`: a curve or a map.
    """
    from obsdesign.document import refuse_overwriting

    refuse_overwriting(output, estimate, data, events)
    if estimate.lower().endswith(".json"):
        for other in (data, events):
            if other is not None:
                raise InputError(f"{other}: belongs to an estimate file; {estimate} is an answer.")
        from obsdesign.plotting.dwell import plot_dwell

        plot_dwell(_answer(estimate), output, estimate)
    elif estimate.lower().endswith(".jsonl"):
        from obsdesign.plotting.sweep import plot_sweep

        for other in (data, events):
            if other is not None:
                raise InputError(f"{other}: belongs to an estimate file; {estimate} is a sweep.")
        plot_sweep(estimate, output)
    else:
        from obsdesign.plotting.estimate import plot_estimate

        plot_estimate(estimate, data, output, events)
    click.echo(f"written: {output}")
    return 0


@cli.command()
@click.argument("which", type=click.Choice(["problem", "design"]), default="problem")
def schema(which: str) -> int:
    """Print the JSON Schema of problem files or of design files."""
    from importlib.resources import files

    click.echo(
        files("obsdesign").joinpath(f"schema/{which}.schema.json").read_text("utf-8").rstrip()
    )
    return 0


def _answer(path: str) -> dict[str, Any]:
    """What a command printed with --json, or a design file."""
    import json

    try:
        body = json.loads(Path(path).read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as JSON: {error}.") from None
    if not isinstance(body, dict):
        raise InputError(f"{path}: one JSON object is required; got {type(body).__name__}.")
    return body


def _plant(source: str) -> Any:
    """The plant of a problem file, or of the problem inside a design file."""
    from obsdesign.document import FORMAT, load_design
    from obsdesign.problem import Problem, load_problem

    try:
        is_design = source.endswith(".json") and f'"{FORMAT}"' in Path(source).read_text("utf-8")
    except (OSError, UnicodeDecodeError):
        is_design = False  # load_problem says what is wrong with the file
    if is_design:
        return Problem.from_dict(load_design(source).problem).plant
    return load_problem(source).plant


def _dwell(text: str) -> float | list[float]:
    try:
        return float(text)
    except ValueError:
        from obsdesign.dwell_file import read_dwell_times

        if Path(text).is_file():
            return read_dwell_times(text)
        raise InputError(
            f"--dwell must be shortest, random, a number or a file; got {text!r}."
        ) from None


def _numbers(text: str, option: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option} must be numbers separated by commas; got {text!r}.") from None
