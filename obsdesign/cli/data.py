"""`simulate`, `run`, `plot`, `convert`, `noise`: records and estimates."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from obsdesign.cli.arguments import (
    AS_JSON,
    NUMBER,
    RENAME,
    Count,
    answer_of,
    dwell_times,
    numbers,
    one_of,
    output_option,
    source_of,
    values_by_name,
)
from obsdesign.cli.talk import is_quiet, on_stderr, say, warn
from obsdesign.errors import InputError

if TYPE_CHECKING:
    from obsdesign.data.simulation import Simulation
    from obsdesign.problem.plant import Plant
    from obsdesign.problem.problem import Problem


@click.command()
@click.argument("source", metavar="PROBLEM_OR_DESIGN", type=click.Path())
@click.option(
    "--until", type=NUMBER,
    help="End time.  [default: ten dwell times, 200 samples, or what the slowest mode takes]",
)  # fmt: skip
@click.option(
    "--step", type=NUMBER, help="Time between rows.  [default: the period, or about until/500]"
)
@click.option("--data", "stated", type=click.Path(),
              help="Take times, events, inputs and missing samples from this file.")  # fmt: skip
@RENAME
@click.option("--initial", help="True initial state x1,...,xn.  [default: ones; middle of [state]]")
@click.option("--dwell", default="random", show_default=True,
              shell_complete=one_of("shortest", "random"),
              help="shortest, random, a number, or a file of dwell times.")  # fmt: skip
@click.option("--disturbance", default="random", show_default=True,
              shell_complete=one_of("zero", "extreme", "random", "sine"),
              help="zero, extreme, random or sine.")  # fmt: skip
@click.option("--parameters", default="random", show_default=True,
              shell_complete=one_of("nominal", "random", "extreme", "bang-bang"),
              help="nominal, random, extreme, bang-bang, or NAME=VALUE,...")  # fmt: skip
@click.option("--seed", type=Count(min=0), default=0, show_default=True)
@click.option("--events", type=click.Path(), help="Write the true unknown impulses to this file.")
@output_option("data.csv", "Data file.")
def simulate(
    *, source: str, output: str, events: str | None, seed: int, until: float | None,
    step: float | None, stated: str | None, titles: Mapping[str, str], initial: str | None,
    dwell: str, disturbance: str, parameters: str,
) -> int:  # fmt: skip
    """Simulate the plant of a problem or design exactly, with its true state."""
    import numpy as np

    from obsdesign.data.csv_text import table_text
    from obsdesign.data.simulation import simulate as run_simulation
    from obsdesign.data.simulation.stated_rows import StatedRows
    from obsdesign.output_files import refuse_overwriting, write_text

    refuse_overwriting(output, source, stated)
    refuse_overwriting(events, source, stated)
    if events is not None and events == output:
        raise InputError(f"--events: {events} is the data file; give another name.")
    if stated is not None and (until, step, dwell) != (None, None, "random"):
        raise InputError("--data takes no --until, --step or --dwell: the file has all rows.")
    problem = source_of(source)
    rows = None if stated is None else StatedRows.from_file(stated, problem, titles)
    start = None if initial is None else numbers(initial, "--initial")
    times = dwell if dwell in ("shortest", "random") else dwell_times(dwell)
    # impulses of unknown weight are announced to the kinds that cannot find them
    announced = problem.kind not in (None, "impulsive_input")
    rng = np.random.default_rng(seed)
    record = run_simulation(
        problem.plant, until=until, step=step, initial=start, dwell=times,
        disturbance=disturbance, rng=rng, announced=announced,
        parameters=values_by_name(parameters) if "=" in parameters else parameters, rows=rows,
    )  # fmt: skip
    _warn_outside_box(problem.plant, record)
    write_text(output, table_text(record.columns))
    if events:
        width = max(record.events.shape[1] - 1, 1)
        names = ["t", *(["weight"] if width == 1 else [f"weight{i + 1}" for i in range(width)])]
        columns = record.events.reshape(-1, width + 1).T
        write_text(events, table_text(dict(zip(names, columns, strict=True))))
    say(f"written: {output}, {len(record.t)} rows until t = {record.t[-1]:g}"
               if len(record.t) else f"written: {output}, no rows")  # fmt: skip
    return 0


def _warn_outside_box(plant: Plant, record: Simulation) -> None:
    """Print a line where the state of a simulation leaves the box that the problem states."""
    if plant.state is None:
        return
    x = record.block("x")
    is_outside = ((x < plant.state.lower) | (x > plant.state.upper)).any(axis=1)
    if is_outside.any():
        t = record.t[is_outside.argmax()]
        warn(f"x leaves [state] at t = {t:g}: what rests on [state] does not hold from then on.")


@click.command()
@click.argument("design_file", metavar="DESIGN", type=click.Path())
@click.argument("data", required=False, type=click.Path())
@click.option(
    "-o", "--output", type=click.Path(), help="Estimate file.  [default: standard output]"
)
@click.option("--initial", help="x1,...,xn; for bounds x1_lo,x1_hi,... (required).")
@click.option(
    "--events", type=click.Path(), help="Write found impulses, or a log of events, to this file."
)
@click.option(
    "--state", type=click.Path(),
    help="Go on from this file if it exists, and save the observer in it for the next data.",
)  # fmt: skip
@click.option(
    "--provisional", type=click.Path(),
    help="Write estimates that a late row may still change to this file, as rows arrive.",
)  # fmt: skip
@click.option("--skip-bad", is_flag=True, help="Report malformed lines and leave them out.")
@click.option("--strict", is_flag=True, help="Exit code 4 if the status of a row is not ok.")
@RENAME
def run(
    *, design_file: str, data: str | None, output: str | None, initial: str | None,
    events: str | None, state: str | None, provisional: str | None, skip_bad: bool, strict: bool,
    titles: Mapping[str, str],
) -> int:  # fmt: skip
    """Execute DESIGN on DATA.csv, or row by row on standard input.

    Rows that are younger than report_delay are provisional: with --provisional they are in that
    file alone, without it at the end of the estimates.

    Exit code 0 whatever the statuses of the rows, unless --strict is given; with --state, rows that
    an observer with a delay has not decided wait for the next data.
    """
    from obsdesign.data.execution import execute

    start = None if initial is None else numbers(initial, "--initial")
    tally = execute(
        design_file,
        data,
        output,
        start,
        events,
        state=state,
        skip_bad=skip_bad,
        provisional=provisional,
        titles=titles,
        remark=warn,
    )
    if not is_quiet():
        on_stderr(f"{tally.rows} rows: {tally}" if tally.rows else "0 rows")
    return 4 if strict and tally.good < tally.rows else 0


@click.command()
@click.argument("estimate", type=click.Path())
@click.argument("data", required=False, type=click.Path())
@output_option("estimate.png", "PNG, SVG or PDF file.")
@click.option(
    "--events", type=click.Path(), help="Draw the impulses of this file too, with the measurements."
)
@click.option(
    "--beside", type=click.Path(), help="Draw the bounds of this estimate file too, and all widths."
)
@click.option(
    "--design",
    "design_file",
    type=click.Path(),
    help="Draw the names and sensor strips of the plant of this design, and the widths.",
)
@RENAME
def plot(
    *, estimate: str, data: str | None, output: str, events: str | None, beside: str | None,
    design_file: str | None, titles: Mapping[str, str],
) -> int:  # fmt: skip
    """Picture an estimate file, against the true state where DATA.csv has it.

    ESTIMATE may also be the answer of `search --json` or a design: the dwell times that are proved;
    or the JSON lines of `sweep`: a curve or a map.
    """
    from obsdesign.output_files import refuse_overwriting

    refuse_overwriting(output, estimate, data, events, beside, design_file)
    suffix = Path(estimate).suffix.lower()
    if suffix in (".json", ".jsonl"):
        what = "an answer" if suffix == ".json" else "a sweep"
        for other in (data, events, beside, design_file):
            if other is not None:
                raise InputError(f"{other}: belongs to an estimate file; {estimate} is {what}.")
    if suffix == ".jsonl":
        from obsdesign.pages.plotting.sweep import plot_sweep

        plot_sweep(estimate, output)
    elif suffix == ".json":
        from obsdesign.pages.plotting.dwell import plot_dwell

        plot_dwell(answer_of(estimate), output, estimate)
    else:
        from obsdesign.pages.plotting.estimate import Comparison, plot_estimate

        problem = None if design_file is None else _problem_of(design_file)
        plot_estimate(estimate, data, output, events, Comparison(beside, problem, titles))
    say(f"written: {output}")
    return 0


def _problem_of(design_file: str) -> Problem:
    """The problem of a design."""
    from obsdesign.design_file import load_design
    from obsdesign.problem.problem import Problem

    return Problem.from_dict(load_design(design_file).problem)


@click.command()
@click.argument("source", metavar="NONMEM.csv", type=click.Path())
@click.option(
    "--problem", type=click.Path(),
    help="Problem or design whose columns are written: DVID counts outputs, CMT states.",
)  # fmt: skip
@output_option("data.csv", "Data file; of several records the subject stands in the name.")
def convert(source: str, *, problem: str | None, output: str) -> int:
    """Convert a NONMEM data set to data files, one for each subject.

    Doses become events by CMT, observations samples by DVID, infusions steps of u. Additional doses
    are written out; a reset begins another file. Without --problem columns are dv, dose, u1,
    numbered by DVID and CMT where there are several.
    """
    from obsdesign.data.csv_text import table_text
    from obsdesign.data.nonmem_records import file_names, records_of
    from obsdesign.output_files import refuse_overwriting, write_text

    refuse_overwriting(output, source, problem)
    records = records_of(source, None if problem is None else source_of(problem).plant)
    names = file_names(output, [subject for subject, _ in records])
    for name in names:
        refuse_overwriting(name, source, problem)
    for name, (_, columns) in zip(names, records, strict=True):
        write_text(name, table_text(columns))
        say(f"written: {name}, {len(columns['t'])} rows")
    return 0


@click.command()
@click.argument("data", metavar="DATA.csv", type=click.Path())
@RENAME
@click.option("--columns", metavar="A,B", help="Measured columns.  [default: y1, y2, ...]")
@AS_JSON
def noise(data: str, *, titles: Mapping[str, str], columns: str | None, as_json: bool) -> int:
    """Estimate noise bounds and deviations of the measurements in DATA.csv."""
    from obsdesign.cli.answers import noise_answer, show_noise
    from obsdesign.data.noise_estimate import estimate_noise

    named = () if columns is None else tuple(name.strip() for name in columns.split(","))
    estimates = estimate_noise(data, titles, named)
    if as_json:
        click.echo(noise_answer(estimates))
    elif not is_quiet():
        show_noise(estimates)
    return 0
