"""What the page shows of a problem: verdict, widths, a simulated run, brackets."""

from __future__ import annotations

import io
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from obsdesign import workflow
from obsdesign.errors import InputError
from obsdesign.html_table import html_table
from obsdesign.kinds import GIVING_BOUNDS, SEARCHES
from obsdesign.notebook import plot, run, simulate
from obsdesign.pages.estimates import first_bounds
from obsdesign.pages.key_numbers import state_table
from obsdesign.problem.problem import Problem
from obsdesign.studies.comparison.record import end_of_record
from obsdesign.studies.search.result import SearchResult
from obsdesign.studies.search.search import require_search, search
from obsdesign.studies.typical import with_typical
from obsdesign.verification.answers import reason

if TYPE_CHECKING:
    from obsdesign.document import Design

# processor seconds of a design and of each bracket, so that the page answers at once
_DESIGN_SECONDS, _SEARCH_SECONDS = 3.0, 2.0
# a bracket on the page is as wide, relative to its limit
_ACCURACY = 1e-3
_DPI = 110
_COLOURS = {"proved": "#1b7837", "refuted": "#b2182b", "undecided": "#8c6d00"}
_STYLE = """<style>
.beside {display: grid; gap: 2rem; grid-template-columns: minmax(0, 1fr) minmax(0, 2.4fr)}
.beside table {border-collapse: collapse; margin: .5rem 0; display: block; overflow-x: auto}
.beside th, .beside td {text-align: right; padding: .1rem .8rem; white-space: nowrap}
.beside th:first-child, .beside td:first-child {text-align: left; padding-left: 0}
@media (max-width: 45rem) {.beside {grid-template-columns: minmax(0, 1fr); gap: 1rem}}
</style>"""


@dataclass(frozen=True)
class Answer:
    """HTML of the verdict and the numbers, and a PNG of a simulated run.

    picture: None where there is none; why: why there is none, where that is not the verdict.
    """

    html: str
    picture: bytes | None = None
    why: str = ""


def answer(problem: Problem) -> Answer:
    """Design and prove an observer, and run it on the default simulation of its plant."""
    try:
        outcome = with_typical(workflow.investigate(problem, seconds=_DESIGN_SECONDS))
    except InputError as error:
        return Answer(_paragraph(f"refused: {error}", "refuted"))
    html = _summary(outcome)
    if outcome.design is None or outcome.verdict == "refuted":
        return Answer(html)
    try:
        return Answer(html, _picture(problem, outcome.design))
    except InputError as error:
        return Answer(html, why=str(error))


def beside(controls: str, result: str) -> str:
    """HTML of the sliders beside what they lead to; one above the other on a narrow screen."""
    return f'{_STYLE}<div class="beside"><div>{controls}</div><div>{result}</div></div>'


def brackets(problem: Problem) -> str:
    """HTML with the bracket of each limit that can be searched for the kind of a problem."""
    rows = []
    for what in SEARCHES:
        try:
            require_search(problem, what)
            outcome = search(problem, what, _ACCURACY, seconds=_SEARCH_SECONDS)
        except InputError:
            continue
        bracket = SearchResult.from_dict(outcome.result).inequality(outcome.verdict)
        rows.append((what.replace("_", " "), bracket))
    return html_table(("limit", "bracket"), rows) if rows else ""


def _summary(outcome: workflow.Outcome) -> str:
    """Verdict, table of the states, what is not proved, and what holds."""
    proved = sum(claim.verdict == "proved" for claim in outcome.claims)
    word = outcome.verdict.upper()
    parts = [_paragraph(f"{word}  {proved} of {len(outcome.claims)} claims", outcome.verdict)]
    if rows := outcome.result.get("states"):
        titles, *lines = state_table(rows)
        parts.append(html_table(titles, lines))
    parts += [
        _paragraph(f"{claim.id} is {claim.verdict}: {reason(claim)}", claim.verdict)
        for claim in outcome.claims
        if claim.verdict != "proved"
    ]
    if outcome.verdict != "refuted":
        parts += [_paragraph(f"! {text}", "undecided") for text in outcome.warnings]
        parts += [_paragraph(" · ".join(outcome.headline))] if outcome.headline else []
    return "".join(parts)


def _paragraph(text: str, verdict: str = "") -> str:
    style = f' style="color:{_COLOURS[verdict]}"' if verdict else ""
    return f"<p{style}>{escape(text)}</p>"


def _picture(problem: Problem, design: Design) -> bytes:
    """A PNG of the observer on a simulation; InputError where the plant cannot be simulated."""
    record = simulate(problem, until=end_of_record(problem.plant))
    initial = first_bounds(record.block("x")[0]) if design.kind in GIVING_BOUNDS else None
    drawn = io.BytesIO()
    plot(run(design, record, initial=initial)).savefig(drawn, format="png", dpi=_DPI)
    return drawn.getvalue()
