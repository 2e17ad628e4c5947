"""Answers for people (rich tables) and for programs (one JSON object)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from obsdesign.candidate_choice import FormAnswer
from obsdesign.cli.talk import output_console
from obsdesign.document import Claim, jsonable
from obsdesign.pages.key_numbers import numbers_of, state_table
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.kind import untried_forms
from obsdesign.verification.answers import is_ended, more_time, reason
from obsdesign.workflow import Outcome

if TYPE_CHECKING:
    from rich.table import Table

    from obsdesign.studies.check.which_kinds import KindAnswer  # other commands do without them
    from obsdesign.studies.comparison.row import ComparisonRow

EXIT_CODES = {"proved": 0, "refuted": 1, "undecided": 3}
_COLOURS = {"proved": "green", "refuted": "red", "undecided": "yellow", "does_not_apply": "dim"}


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


def show_check(answers: Mapping[str, KindAnswer]) -> None:
    """One line per kind on stdout."""
    from rich.markup import escape
    from rich.table import Table

    words = {"proved": "possible", "refuted": "impossible"}
    table = Table(box=None, pad_edge=False, header_style="dim")
    for title in ("kind", "answer", "why, and what to try next"):
        table.add_column(title, overflow="fold")
    for kind, answer in answers.items():
        word = answer.verdict
        verdict = f"[{_COLOURS[word]}]{words.get(word, word.replace('_', ' '))}[/]"
        first, *more = answer.reasons or ("",)
        others = f" (and {len(more)} more; --json has all)" if more else ""
        why = escape(first + others)
        step = f"[dim]{escape(answer.next_step)}[/]" if answer.next_step else ""
        table.add_row(kind, verdict, "\n".join(part for part in (why, step) if part))
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
            console.print(f"[{_COLOURS[row.verdict]}]{name_of(row)}[/]: {escape(row.reason)}")


def show_bracket(what: str, outcome: Outcome) -> None:
    """The bracket of a search, in sentences."""
    from obsdesign.studies.search.result import SearchResult

    result, name = SearchResult.from_dict(outcome.result), what.replace("_", " ")
    if result.proved is None:
        print(f"{name}: nothing is proved ({outcome.verdict}).")
        for claim in outcome.claims:
            if claim.verdict != "proved":
                print(f"  {claim.id}: {reason(claim)}")
    else:
        print(f"{name}: proved at {result.proved!r}")
    if result.not_proved == math.inf and result.proved is not None:
        print("  the search ended there: longer finite dwell times may hold as well")
    if result.not_proved is not None:
        print(f"  {result.not_proved_verdict} at {result.not_proved!r}")
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


def show(outcome: Outcome, numbers: bool = False) -> None:
    """Verdict and claims as a table on stdout; on demand with the numbers behind them."""
    from rich.markup import escape
    from rich.table import Table

    console = output_console()
    colour = _COLOURS[outcome.verdict]
    chosen, seconds = outcome.result.get("form"), outcome.result.get("seconds")
    word = "form " if outcome.kind == "interval" else ""
    form = "" if chosen is None else f", {word}{chosen}"
    console.print(f"[bold {colour}]{outcome.verdict}[/]  {outcome.kind}{form}")
    if rows := outcome.result.get("states"):
        console.print(_state_table(rows))
    for warning in outcome.warnings if outcome.verdict != "refuted" else ():
        console.print(f"[yellow]warning[/]: {escape(warning)}")
    table = Table(box=None, pad_edge=False, header_style="dim")
    for title in ("verdict", "claim", "what, and why"):
        table.add_column(title, overflow="fold")
    for claim in outcome.claims:
        mark = f"[{_COLOURS[claim.verdict]}]{claim.verdict}[/]"
        what = escape(_claim_text(claim))
        if numbers:
            lines = (f"{name}: {value}" for name, value in numbers_of(claim.evidence))
            what = "\n".join([what, *(f"[dim]{escape(line)}[/]" for line in lines)])
        table.add_row(mark, claim.id, what)
    console.print(table)
    forms = outcome.result.get("forms", {})
    untried = _untried_forms(outcome) if forms else set()
    for label, stated in forms.items():
        entry = FormAnswer(**stated)
        wanted = outcome.verdict != "proved" or label not in untried or numbers
        if wanted and label != chosen and entry.verdict != "proved":
            why = escape("; ".join(entry.reasons))
            console.print(f"form {label} is {entry.verdict}: {why}")
    if numbers and seconds is not None:
        console.print(f"[dim]designed in {seconds} s[/]")
    for guarantee in outcome.guarantees if outcome.verdict != "refuted" else ():
        word = "[green]guaranteed[/]" if guarantee.given else "[yellow]not guaranteed[/]"
        console.print(f"{word}: {escape(guarantee.statement)}")


def _state_table(rows: Sequence[Entries]) -> Table:
    """Widths of each state, the numbers that a design is about."""
    from rich.table import Table

    titles, *lines = state_table(rows)
    table = Table(box=None, pad_edge=False, header_style="dim")
    for i, title in enumerate(titles):
        table.add_column(title, justify="right" if i else "left", no_wrap=i > 0)
    for line in lines:
        table.add_row(*line)
    return table


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
