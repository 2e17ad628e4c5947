"""One self-contained page for a design: guarantees, claims, gains and an estimate.

Everything is proved again before a word of it is written.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib.resources import files
from itertools import groupby
from operator import attrgetter

import jinja2
import numpy as np

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from obsdesign import workflow
from obsdesign.design_file import load_design
from obsdesign.document import Claim, Design, Guarantee, jsonable
from obsdesign.output_files import write_text
from obsdesign.pages.curves import curve_of
from obsdesign.pages.estimates import DataSource, design_beside, estimate_of, inline
from obsdesign.pages.key_numbers import numbers_of, state_table
from obsdesign.problem.problem import Problem
from obsdesign.studies.comparison.compare import MOST_ROWS
from obsdesign.verification.answers import reason

_KINDS = {
    "interval": "Interval observer",
    "set_membership": "Set-membership bounds by multipliers",
    "luenberger": "Luenberger observer",
    "impulsive": "Observer from impulsive measurements",
    "finite_time": "Finite-time observer from sampled measurements",
    "impulsive_input": "Observer of unknown impulses",
    "unknown_input": "Unknown-input observer",
}
_VERDICTS = {
    "proved": "Every claim was proved again from the numbers in the design file, in {:.2g} s.",
    "undecided": "Some claims are undecided (marked below): nothing that rests on them is "
    "guaranteed.",
}
SIMULATION = DataSource()
# gains with more entries than this are named, not shown
_MOST_ENTRIES = 64


def write_report(
    path: str, output: str, data: DataSource = SIMULATION, beside: str | None = None
) -> workflow.Outcome:
    """Prove the design in a file again and write its page; nothing is written if it is refuted.

    data: what to run the observer on, and where it starts, as `run` takes it; without data
    the plant is simulated. beside: the file of a second design of the plant whose bounds are drawn
    too, as `design_beside` has it. InputError when a file cannot be read, or a design cannot run
    on it.
    """
    design = load_design(path)
    other = None if beside is None else design_beside(design, beside)
    started = time.perf_counter()
    outcome = workflow.verify(design)
    seconds = time.perf_counter() - started
    if outcome.verdict != "refuted":
        proved_again = replace(design, claims=outcome.claims)
        other = design_beside(design, None) if other is None else other
        estimate = estimate_of(proved_again, path, data, other)
        write_text(output, page(design, outcome, seconds, estimate))
    return outcome


def page(
    design: Design,
    outcome: workflow.Outcome,
    seconds: float,
    estimate: Entries | None = None,
) -> str:
    """The page as HTML text.

    estimate: {"title", "image", "caption", "beside": a table, "bounds": as `_bounds` has them}.
    """
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    template = environment.from_string(
        files("obsdesign").joinpath("pages/report.html").read_text("utf-8")
    )
    shown = _matrices(design.gains)
    return template.render(
        design=design,
        kind_words=_KINDS[design.kind],
        form=str(design.gains.get("form", "")).replace("_", " "),
        plant=_plant_words(Problem.from_dict(design.problem)),
        verdict=outcome.verdict,
        verdict_words=_VERDICTS[outcome.verdict].format(seconds),
        given=_sentences(entry for entry in outcome.guarantees if entry.given),
        withheld=_sentences(entry for entry in outcome.guarantees if not entry.given),
        warnings=outcome.warnings,
        estimate=estimate,
        states=state_table(outcome.result.get("states", ())),
        most_rows=MOST_ROWS,
        curve=_curve(replace(design, claims=outcome.claims)),
        claims=[_claim(claim) for claim in outcome.claims],
        gains=[{"name": name, "rows": _rows(value)} for name, value in shown.items()
               if np.size(value) <= _MOST_ENTRIES],
        unshown=", ".join(f"{name} ({' × '.join(map(str, np.shape(value)))})"
                          for name, value in shown.items() if np.size(value) > _MOST_ENTRIES),
        origin=_origin(design),
        problem=json.dumps(jsonable(design.problem), ensure_ascii=False),
    )  # fmt: skip


def _matrices(gains: Entries) -> Entries:
    """The matrices among gains; those of modes and of their events with its name."""
    listed = dict(gains)
    for block in (*listed.pop("modes", ()), *listed.pop("events", ())):
        listed |= {f"{name} ({block['name']})": value for name, value in block.items()}
    return {name: value for name, value in listed.items() if _is_matrix(value)}


def _is_matrix(value: object) -> bool:
    return isinstance(value, np.ndarray) and value.ndim in (1, 2) and value.size > 0


def _rows(value: Value) -> list[list[str]]:
    """A vector is a column."""
    return [[f"{x:.6g}" for x in row] for row in np.reshape(value, (len(value), -1)).tolist()]


def _plant_words(problem: Problem) -> str:
    plant = problem.plant
    words = [f"{plant.n} states", f"{plant.p} output{'s' * (plant.p > 1)}"]
    if plant.has_tables:
        words += _named("event", [event.name for event in plant.events])
        words += _named("sensor", [sensor.name for sensor in plant.sensors])
    words += _named("mode", [mode.name for mode in plant.modes])
    words += _named("parameter", [parameter.name for parameter in plant.parameters])
    if plant.has_tables:
        return ", ".join(words)
    if plant.jump is not None and plant.jump.dwell_time is not None:
        low, high = plant.jump.dwell_time
        words.append(f"dwell times [{low:g}, {high:g}]".replace("inf]", "inf)"))
    if plant.output.period is not None:
        words.append(f"a sample every {plant.output.period:g}")
    return ", ".join(words).replace("1 states", "1 state")


def _sentences(entries: Iterable[Guarantee]) -> list[tuple[str, list[str]]]:
    """Assumptions, each with the sentences that follow under it."""
    groups = groupby(entries, key=attrgetter("assumption"))
    return [(assumption, [entry.conclusion for entry in group]) for assumption, group in groups]


def _named(what: str, names: Sequence[str]) -> list[str]:
    """Words like 2 modes (open, closed); nothing without any."""
    listed = ", ".join(names)
    return [f"{len(names)} {what}{'s' * (len(names) > 1)} ({listed})"] if names else []


def _claim(claim: Claim) -> NewEntries:
    return {
        "name": claim.id.replace("_", " "),
        "verdict": claim.verdict,
        "statement": claim.statement,
        "source": claim.source,
        "why": "" if claim.verdict == "proved" else reason(claim),
        "numbers": list(numbers_of(claim.evidence)),
    }


def _origin(design: Design) -> list[tuple[str, str]]:
    provenance = dict(design.provenance)
    versions = provenance.get("versions", {})
    solver = provenance.get("solver", {})
    rows = [(str(name), str(version)) for name, version in versions.items()]
    if solver:
        solver_words = f"{solver.get('name')} {solver.get('version', '')}".strip()
        rows.append(("solver", solver_words))
    return [("kind", design.kind), *rows, ("digest", design.digest)]


def _curve(design: Design) -> dict[str, str] | None:
    from obsdesign.pages.plotting.curve import curve_svg

    curve = curve_of(design)
    if curve is None:
        return None
    return {"title": curve.title, "caption": curve.caption, "image": inline(curve_svg(curve))}
