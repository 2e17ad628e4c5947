"""`obsdesign sweep`: the command; the work is in `obsdesign.studies.sweep`."""

from __future__ import annotations

import logging
import os

import click

from obsdesign.cli.arguments import KIND, NUMBER, Count, output_option, problem_of, time_option
from obsdesign.cli.talk import on_stderr, progress_bar, say, warn
from obsdesign.errors import naming

# each process does one point at a time, and has one thread to do it
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@click.command()
@click.argument("problem", type=click.Path())
@click.option("--over", multiple=True, required=True, metavar="KEY=FIRST:LAST:COUNT",
              help="Entry and its values, once or twice: flow.A[0][1]=-1:1:21.")  # fmt: skip
@click.option("--for", "what", default="verdict", show_default=True, metavar="WHAT",
              help="What `search` knows, or verdict, width, decay_rate, error.")  # fmt: skip
@KIND
@click.option("--accuracy", type=NUMBER, default=1e-6, show_default=True,
              help="Relative width of the bracket of a search.")  # fmt: skip
@time_option("at each point")
@click.option("--jobs", type=Count(min=1),
              help="Processes.  [default: one; all cores for what takes longer]")  # fmt: skip
@click.option("--scheduler", metavar="ADDRESS", help="Dask scheduler that runs the points.")
@output_option("sweep.jsonl", "JSON lines, one per point; points it holds are not done again.")
def sweep(
    *, problem: str, over: tuple[str, ...], what: str, kind: str | None, accuracy: float,
    seconds: float | None, jobs: int | None, scheduler: str | None, output: str,
) -> int:  # fmt: skip
    """Map WHAT for PROBLEM over one or two of its entries; `plot` draws it."""
    for name in _THREADS:
        os.environ.setdefault(name, "1")
    from obsdesign.output_files import refuse_overwriting
    from obsdesign.studies.sweep.axes import parse_axis
    from obsdesign.studies.sweep.point import plan_sweep
    from obsdesign.studies.sweep.run import counted, run_sweep

    if scheduler is not None:  # a cluster that is gone is one line of ours, no trace of theirs
        logging.disable(logging.CRITICAL)
    loaded, dropped = problem_of(problem, kind)
    refuse_overwriting(output, problem)
    axes = [parse_axis(text) for text in over]
    with naming(problem):
        plan = plan_sweep(loaded, axes, what, accuracy, seconds)
    if dropped:
        warn(f"dropped for kind {kind}: {', '.join(dropped)}")
    with progress_bar("sweep") as progress:
        points = run_sweep(plan, output, jobs=jobs, scheduler=scheduler, progress=progress)
    counts = counted(points)
    verdicts = ", ".join(f"{number} {word}" for word, number in counts.most_common())
    say(f"written: {output}, {len(points)} points: {verdicts}")
    errors = [point for point in points if point.error]
    if errors:
        place = ", ".join(f"{a.key} = {x:g}" for a, x in zip(axes, errors[0].at, strict=True))
        text = f"{len(errors)} without an answer; at {place}: {errors[0].error}"
        on_stderr(f"obsdesign: {text}")
    return 3 if len(errors) == len(points) else 0
