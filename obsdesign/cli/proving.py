"""`check`, `design`, `verify`, `search`: the commands with a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from obsdesign.cli.arguments import (
    AS_JSON,
    KIND,
    NUMBER,
    numbers,
    one_of,
    output_option,
    problem_of,
    time_option,
)
from obsdesign.cli.talk import is_quiet, is_verbose, progress_bar, progress_message, say, warn
from obsdesign.errors import naming
from obsdesign.kinds import GIVING_BOUNDS, SEARCHES

if TYPE_CHECKING:
    from obsdesign.document import Claim, Design
    from obsdesign.problem.problem import Problem
    from obsdesign.workflow import Outcome


@click.command()
@click.argument("problem", type=click.Path())
@time_option()
@AS_JSON
def check(problem: str, seconds: float | None, as_json: bool) -> int:
    """For each observer kind: can it be built for the plant in PROBLEM, and if not, why."""
    from obsdesign.cli.answers import EXIT_CODES, check_answer, show_check
    from obsdesign.problem.problem import load_problem
    from obsdesign.studies.check.which_kinds import check_all

    loaded = load_problem(problem)
    with progress_bar("check") as progress:
        verdict, answers = check_all(loaded, seconds=seconds, progress=progress)
    named = {
        kind: replace(answer, next_step=answer.next_step.replace("PROBLEM", problem))
        for kind, answer in answers.items()
    }
    if as_json:
        click.echo(check_answer(verdict, named))
    elif not is_quiet():
        show_check(named, hints=is_verbose())
    return EXIT_CODES[verdict]


@click.command()
@click.argument("problem", type=click.Path())
@KIND
@output_option("design.json", "Design file.")
@click.option("--allow-undecided", is_flag=True, help="Write a design with undecided claims too.")
@click.option(
    "--bundle",
    type=click.Path(),
    metavar="FOLDER",
    help="Write the design, the programs that check it and a README there too.",
)
@time_option()
@AS_JSON
def design(
    *, problem: str, kind: str | None, output: str, allow_undecided: bool, bundle: str | None,
    seconds: float | None, as_json: bool,
) -> int:  # fmt: skip
    """Synthesise what PROBLEM leaves open, prove it, and write a design file."""
    from obsdesign import workflow
    from obsdesign.cli.answers import EXIT_CODES, answer
    from obsdesign.output_files import refuse_overwriting
    from obsdesign.studies.typical import with_typical

    loaded, dropped = problem_of(problem, kind)
    refuse_overwriting(output, problem)
    with progress_message("designing"), naming(problem):
        outcome = workflow.investigate(loaded, seconds=seconds)
    _warn_of(kind, dropped, outcome)
    keep = outcome.verdict == "proved" or (outcome.verdict == "undecided" and allow_undecided)
    written = output if keep and outcome.design else None
    if outcome.design and written:
        outcome.design.save(written)
        if bundle is not None:
            _write_bundle(outcome.design, bundle)
    with progress_message("simulating"):
        outcome = with_typical(outcome)
    if as_json:
        gains = outcome.design.gains if outcome.design else {}
        click.echo(answer("design", outcome, {**outcome.result, "file": written, "gains": gains}))
    elif not is_quiet():
        _show(outcome, loaded.name)
        say(_next_step(loaded, written) if written else "nothing written")
    return EXIT_CODES[outcome.verdict]


@click.command()
@click.argument("design_file", metavar="DESIGN", type=click.Path())
@click.option("--paranoid", is_flag=True, help="Prove a second time by an independent method.")
@AS_JSON
def verify(design_file: str, paranoid: bool, as_json: bool) -> int:
    """Prove everything in DESIGN again, from the file alone and without a solver.

    DESIGN may be a folder of `export --to c`: then also that its source is that of its design.
    """
    from obsdesign import workflow
    from obsdesign.cli.answers import EXIT_CODES, answer

    design, code = _exported(design_file)
    with progress_message("verifying"), naming(design_file):
        outcome = workflow.verify(design, paranoid=paranoid).with_claims(code)
    if as_json:
        from obsdesign.studies.typical import with_typical  # simulates: people get a line without

        click.echo(answer("verify", outcome, with_typical(outcome).result))
    elif not is_quiet():
        _show(outcome, design.name, in_a_line=True)
    return EXIT_CODES[outcome.verdict]


@click.command()
@click.argument("problem", type=click.Path())
@click.option("--for", "what", required=True, metavar="WHAT",
              shell_complete=one_of(*SEARCHES),
              help=", ".join(SEARCHES) + ".")  # fmt: skip
@KIND
@click.option("--of", "name", metavar="NAME",
              help="The mode whose stays are searched, or the event.  [default: all]")  # fmt: skip
@click.option("--width", metavar="W1,W2,…",
              help="largest_time_error: widths of the bounds of the states, at most.")  # fmt: skip
@click.option("--accuracy", type=NUMBER, default=1e-6, show_default=True,
              help="Relative width of the bracket.")  # fmt: skip
@time_option()
@AS_JSON
def search(
    *, problem: str, what: str, kind: str | None, name: str | None, width: str | None,
    accuracy: float, seconds: float | None, as_json: bool,
) -> int:  # fmt: skip
    """Find the limit of WHAT for PROBLEM: a bracket, proved on one side."""
    from obsdesign.cli.answers import EXIT_CODES, answer, show_bracket
    from obsdesign.studies.search import search as searching

    loaded, dropped = problem_of(problem, kind)
    with progress_message("searching"), naming(problem):
        widths = None if width is None else numbers(width, "--width")
        outcome = searching.search(loaded, what, accuracy, of=name, width=widths, seconds=seconds)
    _warn_of(kind, dropped, outcome)
    if as_json:
        click.echo(answer("search", outcome, outcome.result))
    elif not is_quiet():
        show_bracket(what, outcome)
    return EXIT_CODES[outcome.verdict]


def _exported(path: str) -> tuple[Design, tuple[Claim, ...]]:
    """The design of a file, or that of a folder with the claim about its source."""
    if not Path(path).is_dir():
        from obsdesign.design_file import load_design

        return load_design(path), ()
    from obsdesign.export.folder import code_claim

    design, claim = code_claim(path)
    return design, (claim,)


def _show(outcome: Outcome, name: str, *, in_a_line: bool = False) -> None:
    """The answer for people; in_a_line: nothing but the title where everything is proved."""
    from obsdesign.cli.summary import show_details, show_summary, show_title

    if in_a_line and outcome.verdict == "proved" and not is_verbose():
        show_title(outcome, name)
        return
    show_summary(outcome, name)
    if is_verbose():
        show_details(outcome)


def _next_step(problem: Problem, written: str) -> str:
    """Where the design is, and the command that runs it."""
    start = " --initial x1_lo,x1_hi,…" if problem.kind in GIVING_BOUNDS else ""
    claims = "" if is_verbose() else f" · claims: obsdesign --verbose verify {written}"
    return f"written {written}{claims}\nnext: obsdesign run {written} data.csv{start}"


def _write_bundle(design: Design, folder: str) -> None:
    """The design, its checkers and how to run them; what they do not prove is said."""
    from obsdesign.bundle import write_bundle

    for opinion in write_bundle(design, folder):
        if opinion.code:
            warn(f"{folder}: {opinion.program.name}: {' '.join(opinion.lines)}")


def _warn_of(kind: str | None, dropped: Sequence[str], outcome: Outcome) -> None:
    """What was left out for a kind, and the remarks of searches."""
    if dropped:
        warn(f"dropped for kind {kind}: {', '.join(dropped)}")
    for remark in outcome.result.get("remarks", ()):
        warn(remark)
