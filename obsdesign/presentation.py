"""Answers for people (rich tables) and for programs (one JSON object)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from obsdesign.document import Claim, jsonable
from obsdesign.workflow import Outcome, reason

EXIT_CODES = {"proved": 0, "refuted": 1, "undecided": 3}
_COLOURS = {"proved": "green", "refuted": "red", "undecided": "yellow"}


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

    words = {"proved": "possible", "refuted": "impossible", "undecided": "undecided"}
    table = Table(box=None, pad_edge=False, header_style="dim")
    for title in ("kind", "answer", "why"):
        table.add_column(title, overflow="fold")
    for kind, entry in found.items():
        colour = _COLOURS[entry["verdict"]]
        answer = f"[{colour}]{words[entry['verdict']]}[/]"
        table.add_row(kind, answer, escape("; ".join(entry["reasons"])))
    Console(highlight=False).print(table)


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
    for low, high in result.get("islands", []):
        print(f"  not one interval: constant dwell times in [{low:g}, {high:g}] contract as well")


def show(outcome: Outcome) -> None:
    """Verdict and claims as a table on stdout."""
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
        table.add_row(mark, claim.id, escape(_told(claim)))
    console.print(table)
    for label, entry in outcome.result.get("forms", {}).items():
        if label != outcome.result.get("form") and entry["verdict"] != "proved":
            why = escape("; ".join(entry["reasons"]))
            console.print(f"form {label} is {entry['verdict']}: {why}")
    told = outcome.design is not None and outcome.verdict != "refuted"
    for guarantee in outcome.design.guarantees if told and outcome.design else ():
        word = "[green]guaranteed[/]" if guarantee["given"] else "[yellow]not guaranteed[/]"
        console.print(f"{word}: {escape(str(guarantee['statement']))}")


def _told(claim: Claim) -> str:
    if claim.verdict == "proved":
        return f"{claim.statement} [{claim.source}]"
    return f"{claim.statement} [{claim.source}]. {claim.verdict.capitalize()}: {reason(claim)}"
