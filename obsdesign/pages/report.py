"""One self-contained page for a design: guarantees, claims, gains and an estimate.

Everything is proved again before a word of it is written.
"""

from __future__ import annotations

import base64
import json
import time
from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import jinja2
import numpy as np

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from obsdesign import workflow
from obsdesign.data.csv_text import table_text
from obsdesign.data.execution import execute
from obsdesign.data.simulation import simulate
from obsdesign.design_file import load_design
from obsdesign.document import Claim, Design, jsonable
from obsdesign.errors import InputError
from obsdesign.kinds import GIVING_BOUNDS
from obsdesign.output_files import temporary_folder, write_text
from obsdesign.pages.curves import curve_of
from obsdesign.pages.error_bounds import error_curve, error_table
from obsdesign.pages.key_numbers import numbers_of
from obsdesign.pages.plotting.estimate_record import Table
from obsdesign.problem.problem import Problem
from obsdesign.studies.comparison.compare import MOST_ROWS, compare_with_kalman
from obsdesign.studies.comparison.record import ComparisonRecord
from obsdesign.studies.comparison.row import table
from obsdesign.studies.error_bounds import error_bounds
from obsdesign.verification.answers import reason

_KINDS = {
    "interval": "Interval observer",
    "set_membership": "Set-membership bounds by multipliers",
    "luenberger": "Luenberger observer for a system with jumps",
    "impulsive": "Observer from impulsive measurements",
    "finite_time": "Finite-time observer from sampled measurements",
    "impulsive_input": "Observer of unknown impulses",
    "unknown_input": "Unknown-input observer",
}
_VERDICTS = {
    "proved": "Every claim was proved again from the numbers in the design file, in {:.2g} s.",
    "undecided": "Not every claim could be proved: the marked ones are open, and nothing may be "
    "built on them.",
}
# gains with more entries than this are named, not shown
_MOST_ENTRIES = 64


def write_report(
    path: str, output: str, data: str | None = None, initial: Sequence[float] | None = None
) -> workflow.Outcome:
    """Prove the design in a file again and write its page; nothing is written if it is refuted.

    data: a CSV file to run the observer on, from `initial` as `run` takes it; without it the plant
    is simulated. InputError when a file cannot be read, or a design cannot run on it.
    """
    design = load_design(path)
    started = time.perf_counter()
    outcome = workflow.verify(design)
    seconds = time.perf_counter() - started
    if outcome.verdict != "refuted":
        proved_again = replace(design, claims=outcome.claims)
        estimate = _estimate(proved_again, path, data, initial)
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
    shown = {name: value for name, value in design.gains.items() if _is_matrix(value)}
    return template.render(
        design=design,
        kind_words=_KINDS[design.kind],
        form=str(design.gains.get("form", "")).replace("_", " "),
        plant=_plant_words(Problem.from_dict(design.problem)),
        verdict=outcome.verdict,
        verdict_words=_VERDICTS[outcome.verdict].format(seconds),
        given=[one.statement for one in outcome.guarantees if one.given],
        withheld=[one.statement for one in outcome.guarantees if not one.given],
        warnings=outcome.warnings,
        estimate=estimate,
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


def _is_matrix(value: object) -> bool:
    return isinstance(value, np.ndarray) and value.ndim in (1, 2) and value.size > 0


def _rows(value: Value) -> list[list[str]]:
    """A vector is a column."""
    return [[f"{x:.6g}" for x in row] for row in np.reshape(value, (len(value), -1)).tolist()]


def _plant_words(problem: Problem) -> str:
    plant = problem.plant
    words = [f"{plant.n} states", f"{plant.p} output{'s' * (plant.p > 1)}"]
    if plant.jump is not None and plant.jump.dwell_time is not None:
        low, high = plant.jump.dwell_time
        words.append(f"dwell times [{low:g}, {high:g}]".replace("inf]", "inf)"))
    if plant.output.period is not None:
        words.append(f"a sample every {plant.output.period:g}")
    return ", ".join(words).replace("1 states", "1 state")


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
    return {"title": curve.title, "caption": curve.caption, "image": _inline(curve_svg(curve))}


def _inline(svg: str) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode("utf-8")).decode("ascii")


def _estimate(
    design: Design, path: str, data: str | None, initial: Sequence[float] | None
) -> NewEntries | None:
    """The observer on data, or on a simulation of its plant, as a picture."""
    from obsdesign.pages.plotting.estimate import plot_estimate

    with temporary_folder() as folder:
        title = "On data"
        source = data or str(Path(folder, "simulated.csv"))
        if data is None:
            title = "On a simulation"
            try:
                plant = Problem.from_dict(design.problem).plant
                record = simulate(plant, announced=design.kind != "impulsive_input")
            except InputError:  # an unstable plant, or no dwell time to simulate with
                return None
            write_text(source, table_text(record.columns))
            if initial is None and design.kind in GIVING_BOUNDS:
                x = record.block("x")[0]
                # not around the truth: nobody knows it so well
                initial = np.column_stack([x - 0.5, x + 1.5]).reshape(-1).tolist()
        estimates, picture = str(Path(folder, "estimate.csv")), str(Path(folder, "estimate.svg"))
        try:
            tally = execute(path, source, estimates, initial, None)
        except InputError:
            if data is None:  # impulses at unknown times, which this kind cannot detect
                return None
            raise
        plot_estimate(estimates, source, picture)
        svg = Path(picture).read_text("utf-8")
        measured = ComparisonRecord.from_file(source, Problem.from_dict(design.problem).plant)
        rows = _rows_with_kalman(design, measured, initial)
        bounds = _bounds(design, measured, Table.from_file(estimates))
    counts = tally.statuses.most_common()
    statuses = ", ".join(f"{number} {status}" for status, number in counts)
    origin = f"of {Path(data).name}" if data else "simulated with random admissible disturbances"
    caption = f"{tally.rows} rows {origin}: {statuses}."
    entries = {"title": title, "image": _inline(svg), "caption": caption}
    return {**entries, "beside": rows, "bounds": bounds}


def _bounds(design: Design, record: ComparisonRecord, estimate: Table) -> NewEntries | None:
    """Bounds of the error of observer (14) along the record: a table and a picture."""
    from obsdesign.pages.plotting.curve import curve_svg

    if design.kind != "finite_time":
        return None
    names = [name for name in estimate.states if name[0] == "x"]
    x = np.column_stack([estimate.numbers(name)[:MOST_ROWS] for name in names])
    bounds = error_bounds(design, record, x, estimate.statuses[:MOST_ROWS])
    if bounds is None:
        return None
    return {"table": error_table(bounds), "image": _inline(curve_svg(error_curve(bounds)))}


def _rows_with_kalman(
    design: Design, record: ComparisonRecord, initial: Sequence[float] | None
) -> tuple[list[str], list[list[str]]] | None:
    """The design and a Kalman filter, where the record has the true state."""
    if record.x is None:
        return None
    if initial is not None and design.kind not in GIVING_BOUNDS:
        x = np.asarray(initial, dtype=np.float64)
        initial = np.column_stack([x - 1, x + 1]).reshape(-1).tolist()
    return table(compare_with_kalman(design, record, initial))
