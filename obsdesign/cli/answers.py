"""Answers for people (rich tables) and for programs (one JSON object)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from lmi.time_budget import ended_part
from obsdesign.document import Claim, jsonable
from obsdesign.pages.key_numbers import numbers_of
from obsdesign.verification.answers import is_ended, more_time, reason
from obsdesign.workflow import Outcome

if TYPE_CHECKING:
    from obsdesign.studies.comparison.row import Row  # other commands do without it

EXIT_CODES = {"proved": 0, "refuted": 1, "undecided": 3}
# columns of a terminal that hold a comparison with its guarantees
_WIDE = 110
_COLOURS = {"proved": "green", "refuted": "red", "undecided": "yellow", "does_not_apply": "dim"}


def answer(command: str, outcome: Outcome, result: Mapping[str, Any]) -> str:
    """The JSON object of a command, in one line."""
    return json.dumps(
        {
            "command": command,
            "verdict": outcome.verdict,
            "kind": outcome.kind,
            "claims": [claim.to_dict() for claim in outcome.claims],
            "result": jsonable(result),
        },
        ensure_ascii=False,
        allow_nan=False,
    )


def check_answer(verdict: str, found: Mapping[str, Any]) -> str:
    """The JSON object of `check`: one entry per kind."""
    return json.dumps(
        {"command": "check", "verdict": verdict, "kind": None, "claims": [], "result": found},
        ensure_ascii=False,
        allow_nan=False,
    )


def show_check(found: Mapping[str, Any]) -> None:
    """One line per kind on stdout."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    words = {"proved": "possible", "refuted": "impossible"}
    table = Table(box=None, pad_edge=False, header_style="dim")
    for title in ("kind", "answer", "why, and what to try next"):
        table.add_column(title, overflow="fold")
    for kind, entry in found.items():
        word = entry["verdict"]
        answer = f"[{_COLOURS[word]}]{words.get(word, word.replace('_', ' '))}[/]"
        first, *more = entry["reasons"] or [""]
        others = f" (and {len(more)} more; --json has all)" if more else ""
        why = escape(first + others)
        step = f"[dim]{escape(entry['next'])}[/]" if entry["next"] else ""
        table.add_row(kind, answer, "\n".join(part for part in (why, step) if part))
    Console(highlight=False).print(table)


def compare_answer(rows: Sequence[Row]) -> str:
    """The JSON object of `compare`: one entry per observer, the filter last."""
    verdict = "proved" if any(row.verdict == "proved" for row in rows) else "refuted"
    if verdict == "refuted" and any(row.verdict == "undecided" for row in rows):
        verdict = "undecided"
    body: dict[str, Any] = {"command": "compare", "verdict": verdict, "kind": None, "claims": []}
    result = {"rows": [asdict(row) for row in rows]}
    return json.dumps(body | {"result": result}, ensure_ascii=False, allow_nan=False)


def show_comparison(rows: Sequence[Row]) -> None:
    """What runs as a table, with the columns that somebody has; then why the others do not."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from obsdesign.studies.comparison.row import name_of, table

    console = Console(highlight=False)
    (first, *titles), lines = table(rows)
    shown = Table(box=None, pad_edge=False, header_style="dim")
    shown.add_column(first, no_wrap=True)
    for title in titles:
        shown.add_column(title, justify="right", no_wrap=True)
    wide = console.width >= _WIDE
    if wide:
        shown.add_column("proved", no_wrap=True)
    ran = [row for row in rows if row.seconds is not None]
    for row, cells in zip(ran, lines, strict=True):
        shown.add_row(*map(escape, cells), *([escape(row.guarantee)] if wide else []))
    console.print(shown)
    if not wide:
        for name, told in {name_of(row): row.guarantee for row in ran if row.verdict}.items():
            console.print(f"proved of {name}: {escape(told)}")
    for row in rows:
        if row.seconds is None:
            console.print(f"[{_COLOURS[row.verdict]}]{name_of(row)}[/]: {escape(row.reason)}")


def show_bracket(what: str, outcome: Outcome) -> None:
    """The limit that was searched for, in sentences."""
    result, name = outcome.result, what.replace("_", " ")
    if result["proved"] is None:
        print(f"{name}: nothing is proved ({outcome.verdict}).")
        for claim in outcome.claims:
            if claim.verdict != "proved":
                print(f"  {claim.id}: {reason(claim)}")
    else:
        print(f"{name}: proved at {result['proved']!r}")
    if result["not_proved"] == float("inf") and result["proved"] is not None:
        print("  the search ended there: longer finite dwell times may hold as well")
    if result["not_proved"] is not None:
        print(f"  {result['not_proved_verdict']} at {result['not_proved']!r}")
    if result.get("common_P") is not None:
        print(f"  one common P proves {result['common_P']!r}, windows of dwell times the rest")
    if result.get("open") is not None and result["open"] > result["accuracy"]:
        print(f"  open between them: {result['open']:.2g} of the limit")
    if result.get("reason"):
        print(f"  {result['reason']}")
    printed = result["proved"] is None and any(map(is_ended, outcome.claims))
    if outcome.verdict == "undecided" and ended_part(result) and not printed:
        print(f"  {more_time(result, 'narrow the bracket')}")
    for low, high in result.get("islands", []):
        print(f"  not one interval: constant dwell times in [{low:g}, {high:g}] contract as well")


def show(outcome: Outcome, numbers: bool = False) -> None:
    """Verdict and claims as a table on stdout; on demand with the numbers behind them."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console(highlight=False, soft_wrap=False)
    colour = _COLOURS[outcome.verdict]
    form = f", form {outcome.result['form']}" if "form" in outcome.result else ""
    console.print(f"[bold {colour}]{outcome.verdict}[/]  {outcome.kind}{form}")
    table = Table(box=None, pad_edge=False, header_style="dim")
    for title in ("verdict", "claim", "what, and why"):
        table.add_column(title, overflow="fold")
    for claim in outcome.claims:
        mark = f"[{_COLOURS[claim.verdict]}]{claim.verdict}[/]"
        what = escape(_told(claim))
        if numbers:
            lines = (f"{name}: {value}" for name, value in numbers_of(claim.evidence))
            what = "\n".join([what, *(f"[dim]{escape(line)}[/]" for line in lines)])
        table.add_row(mark, claim.id, what)
    console.print(table)
    for label, entry in outcome.result.get("forms", {}).items():
        untried = all(text.startswith("not tried") for text in entry["reasons"])
        wanted = outcome.verdict != "proved" or not untried or numbers
        if wanted and label != outcome.result.get("form") and entry["verdict"] != "proved":
            why = escape("; ".join(entry["reasons"]))
            console.print(f"form {label} is {entry['verdict']}: {why}")
    if numbers and "seconds" in outcome.result:
        console.print(f"[dim]designed in {outcome.result['seconds']} s[/]")
    for guarantee in outcome.guarantees if outcome.verdict != "refuted" else ():
        word = "[green]guaranteed[/]" if guarantee["given"] else "[yellow]not guaranteed[/]"
        console.print(f"{word}: {escape(str(guarantee['statement']))}")


def _told(claim: Claim) -> str:
    if claim.verdict == "proved":
        return f"{claim.statement} [{claim.source}]"
    return f"{claim.statement} [{claim.source}]. {claim.verdict.capitalize()}: {reason(claim)}"
