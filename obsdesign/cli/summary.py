"""The answer of `design` and `verify` for people: numbers first, in a few lines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from operator import attrgetter
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from lmi.arithmetic.arrays import Entries
from obsdesign.candidate_choice import FormAnswer
from obsdesign.cli.talk import COLOURS, output_console
from obsdesign.document import Claim
from obsdesign.pages.key_numbers import numbers_of, state_table
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.kind import untried_forms
from obsdesign.verification.answers import reason
from obsdesign.workflow import Outcome

if TYPE_CHECKING:
    from rich.console import Console


def show_summary(outcome: Outcome, name: str) -> None:
    """Print verdict, numbers of each state, warnings, and what is guaranteed.

    name: of the plant.
    """
    console = output_console()
    show_title(outcome, name)
    if rows := outcome.result.get("states"):
        console.print(_state_table(rows))
    if outcome.verdict != "refuted":
        for warning in outcome.warnings:
            console.print(f"[yellow]![/] {escape(warning)}")
        if outcome.headline:
            console.print(escape(" · ".join(outcome.headline)))
    for claim in outcome.claims:
        if claim.verdict != "proved":
            word = f"[{COLOURS[claim.verdict]}]{claim.verdict}[/]"
            console.print(f"{word} {claim.id}: {escape(reason(claim))}")
    _forms(console, outcome)
    for guarantee in outcome.guarantees if outcome.verdict != "refuted" else ():
        if not guarantee.given and not guarantee.claims:
            console.print(f"[yellow]not guaranteed[/]: {escape(guarantee.conclusion)}")


def show_title(outcome: Outcome, name: str) -> None:
    """Plant, observer and verdict, with how many claims have it."""
    chosen = outcome.result.get("form")
    form = "" if chosen is None else f", {str(chosen).replace('_', ' ')}"
    count = Counter(claim.verdict for claim in outcome.claims)[outcome.verdict]
    word = f"[bold {COLOURS[outcome.verdict]}]{outcome.verdict.upper()}[/]"
    grid = Table.grid(padding=(0, 3))
    grid.add_column(overflow="fold")
    grid.add_column(no_wrap=True)
    title = f"{escape(name)} · {outcome.kind}{escape(form)}"
    grid.add_row(title, f"{word}  {count} of {len(outcome.claims)} claims")
    output_console().print(grid)


def _state_table(rows: Sequence[Entries]) -> Table:
    """Numbers of each state, with a remark where its bounds are wider than the sensor alone."""
    titles, *lines = state_table(rows)
    table = Table(box=None, pad_edge=False, header_style="dim")
    for i, title in enumerate(titles):
        is_text = i in (0, len(titles) - 1)
        style = "yellow" if i == len(titles) - 1 else ""
        table.add_column(title, justify="left" if is_text else "right", no_wrap=True, style=style)
    for line in lines:
        table.add_row(*map(escape, line))
    return table


def show_details(outcome: Outcome) -> None:
    """All claims with their sources and numbers, the forms, and the guarantees in full."""
    console = output_console()
    table = Table(box=None, pad_edge=False, header_style="dim")
    for title in ("verdict", "claim", "what, and why"):
        table.add_column(title, overflow="fold")
    for claim in outcome.claims:
        lines = (f"{name}: {value}" for name, value in numbers_of(claim.evidence))
        parts = [escape(_claim_text(claim)), *(f"[dim]{escape(line)}[/]" for line in lines)]
        table.add_row(f"[{COLOURS[claim.verdict]}]{claim.verdict}[/]", claim.id, "\n".join(parts))
    console.print(table)
    entries = outcome.guarantees if outcome.verdict != "refuted" else ()
    for assumption, group in groupby(entries, key=attrgetter("assumption")):
        if assumption:
            console.print(escape(assumption))
        for guarantee in group:
            word = "[green]guaranteed[/]" if guarantee.given else "[yellow]not guaranteed[/]"
            console.print(f"{word}: {escape(guarantee.conclusion)}")
    if (seconds := outcome.result.get("seconds")) is not None:
        console.print(f"[dim]designed in {seconds} s[/]")


def _forms(console: Console, outcome: Outcome) -> None:
    """Why forms other than the chosen one were not."""
    forms = outcome.result.get("forms", {})
    untried = _untried_forms(outcome) if forms else set()
    for label, stated in forms.items():
        entry = FormAnswer(**stated)
        wanted = outcome.verdict != "proved" or label not in untried
        if wanted and label != outcome.result.get("form") and entry.verdict != "proved":
            why = escape("; ".join(entry.reasons))
            console.print(f"form {label} is {entry.verdict}: {why}")


def _untried_forms(outcome: Outcome) -> set[str]:
    """Forms that synthesis passed over."""
    if outcome.design is None:
        return set()
    problem = Problem.from_dict(outcome.design.problem)
    return set(untried_forms(problem))


def _claim_text(claim: Claim) -> str:
    if claim.verdict == "proved":
        return f"{claim.statement} [{claim.source}]"
    return f"{claim.statement} [{claim.source}]. {claim.verdict.capitalize()}: {reason(claim)}"
