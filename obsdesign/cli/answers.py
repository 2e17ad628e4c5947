"""Answers for people (rich tables) and for programs (one JSON object)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from obsdesign.cli.talk import COLOURS, output_console
from obsdesign.document import jsonable
from obsdesign.verification.answers import is_ended, more_time, reason
from obsdesign.workflow import Outcome

if TYPE_CHECKING:
    from obsdesign.data.noise_estimate import NoiseEstimate
    from obsdesign.studies.check.which_kinds import KindAnswer  # other commands do without them
    from obsdesign.studies.comparison.row import ComparisonRow

EXIT_CODES = {"proved": 0, "refuted": 1, "undecided": 3}
_MARKS = {
    "proved": ("✓", "possible"), "refuted": ("✗", "impossible"), "undecided": ("?", "undecided"),
    "does_not_apply": ("–", "does not apply"),
}  # fmt: skip


def answer(command: str, outcome: Outcome, result: Entries) -> str:
    """The JSON object of a command, in one line."""
    claims = [claim.to_dict() for claim in outcome.claims]
    return _json(command, outcome.verdict, outcome.kind, claims, jsonable(result))


def check_answer(verdict: str, answers: Mapping[str, KindAnswer]) -> str:
    """The JSON object of `check`: one entry per kind."""
    result = {kind: answer.to_dict() for kind, answer in answers.items()}
    return _json("check", verdict, None, [], result)


def _json(
    command: str, verdict: str, kind: str | None, claims: list[NewEntries], result: Value
) -> str:
    """The object that every command with --json prints."""
    body = {"command": command, "verdict": verdict, "kind": kind, "claims": claims}
    return json.dumps(body | {"result": result}, ensure_ascii=False, allow_nan=False)


def show_check(answers: Mapping[str, KindAnswer], *, hints: bool) -> None:
    """A line for each kind: the command that builds it, or why there is none.

    hints: what to try where a kind does not apply, too.
    """
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, pad_edge=False, show_header=False)
    for _ in range(2):
        table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for kind, answer in answers.items():
        mark, word = _MARKS[answer.verdict]
        colour = COLOURS[answer.verdict]
        first, *more = answer.reasons or ("",)
        others = f" (and {len(more)} more; --json has all)" if more else ""
        why = escape(f"{word}: {first}{others}") if first else ""
        with_step = answer.verdict != "does_not_apply" or hints
        step = escape(answer.next_step.replace("`", "")) if with_step else ""
        lines = [part for part in (why, f"[dim]{step}[/]" if why and step else step) if part]
        table.add_row(f"[{colour}]{mark}[/]", kind, "\n".join(lines))
    output_console().print(table)


def compare_answer(rows: Sequence[ComparisonRow]) -> str:
    """The JSON object of `compare`: one entry per observer, the filter last."""
    verdict = "proved" if any(row.verdict == "proved" for row in rows) else "refuted"
    if verdict == "refuted" and any(row.verdict == "undecided" for row in rows):
        verdict = "undecided"
    return _json("compare", verdict, None, [], {"rows": [asdict(row) for row in rows]})


def show_comparison(rows: Sequence[ComparisonRow]) -> None:
    """A table of the observers that ran; what they guarantee; why the others did not run."""
    from rich.markup import escape
    from rich.table import Table

    from obsdesign.studies.comparison.row import name_of, table

    console = output_console()
    (first, *titles), lines = table(rows)
    shown = Table(box=None, pad_edge=False, header_style="dim")
    shown.add_column(first, no_wrap=True)
    for title in titles:
        shown.add_column(title, justify="right", no_wrap=True)
    ran = [row for row in rows if row.seconds is not None]
    for cells in lines:
        shown.add_row(*map(escape, cells))
    console.print(shown)
    for sentence in dict.fromkeys(row.guarantee for row in ran if row.guarantee):
        names = "; ".join(name_of(row) for row in ran if row.guarantee == sentence)
        console.print(f"guaranteed by {escape(names)}: {escape(sentence)}")
    for row in rows:
        if row.seconds is None:
            console.print(f"[{COLOURS[row.verdict]}]{name_of(row)}[/]: {escape(row.reason)}")


def show_bracket(what: str, outcome: Outcome) -> None:
    """The bracket of a search in a line, and why its far end is not proved."""
    from obsdesign.studies.search.result import SearchResult

    result, name = SearchResult.from_dict(outcome.result), what.replace("_", " ")
    print(f"{name}: {result.inequality(outcome.verdict)}")
    if result.proved is None:
        for claim in outcome.claims:
            if claim.verdict != "proved":
                print(f"  {claim.id}: {reason(claim)}")
    if result.not_proved == math.inf and result.proved is not None:
        print("  the search ended there: longer finite dwell times may hold as well")
    if result.common_P is not None:
        print(f"  one common P proves {result.common_P!r}, windows of dwell times the rest")
    if result.open is not None and result.accuracy is not None and result.open > result.accuracy:
        print(f"  open between them: {result.open:.2g} of the limit")
    if result.reason:
        print(f"  {result.reason}")
    printed = result.proved is None and any(map(is_ended, outcome.claims))
    if outcome.verdict == "undecided" and result.ended and not printed:
        print(f"  {more_time(result.ended, 'narrow the bracket')}")
    for low, high in result.islands:
        print(f"  not one interval: constant dwell times in [{low:g}, {high:g}] contract as well")


_CAUTION = (
    "Estimated from this record by parabolas over seven samples; rare errors are not in it. A "
    "bound from a data sheet is better. If noise_bound is too small no guarantee holds, and the "
    "data may not show it."
)


def noise_answer(estimates: Sequence[NoiseEstimate]) -> str:
    """The JSON object of `noise`: an entry for each column."""
    return json.dumps(
        {"command": "noise", "result": [asdict(each) for each in estimates]}, allow_nan=False
    )


def show_noise(estimates: Sequence[NoiseEstimate]) -> None:
    """A table of the noise of each column, and what to write into a problem file."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="dim")
    for title in ("noise of", "samples", "deviation", "bound", "resolution"):
        table.add_column(title, justify="left" if title == "noise of" else "right")
    for each in estimates:
        resolution = f"{each.resolution:.3g}" if each.resolution else "–"
        table.add_row(
            each.column, str(each.samples), f"{each.std:.3g}", f"{each.bound:.3g}", resolution
        )
    console = output_console()
    console.print(table)
    print("[output]")
    for name, values in (
        ("noise_bound", [each.bound for each in estimates]),
        ("noise_std", [0.0 if each.cv else each.std for each in estimates]),
        ("noise_cv", [each.cv for each in estimates]),
    ):
        if any(values):
            print(f"{name} = [{', '.join(f'{value:.3g}' for value in values)}]")
    for each in estimates:
        if not each.is_smooth:
            console.print(
                f"[yellow]![/] {each.column}: what is left of the parabolas is no noise: sample "
                "faster, or mark the jumps of the record."
            )
    console.print(_CAUTION)
