"""A design on a record, for its page: a picture, and numbers beside a Kalman filter."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from obsdesign import workflow
from obsdesign.data.csv_text import table_text
from obsdesign.data.execution import execute
from obsdesign.data.simulation import simulate
from obsdesign.data.tally import Tally
from obsdesign.design_file import load_design
from obsdesign.document import Design, jsonable
from obsdesign.errors import InputError
from obsdesign.kinds import GIVING_BOUNDS
from obsdesign.output_files import temporary_folder, write_text
from obsdesign.pages.error_bounds import error_curve, error_table
from obsdesign.pages.plotting.estimate_record import Table
from obsdesign.problem.problem import Problem
from obsdesign.studies.comparison.compare import MOST_ROWS, compare_with_kalman
from obsdesign.studies.comparison.record import ComparisonRecord, end_of_record
from obsdesign.studies.comparison.row import table
from obsdesign.studies.error_bounds import error_bounds

# processor time for an interval observer to compare set-membership bounds with
_INTERVAL_SECONDS = 4.0


@dataclass(frozen=True)
class DataSource:
    """What a design is run on: a data file, or none for a simulation; and where it starts.

    titles: column of the file by another title of it.
    """

    path: str | None = None
    initial: Sequence[float] | None = None
    titles: Mapping[str, str] = field(default_factory=dict)


def design_beside(design: Design, path: str | None) -> Design | None:
    """The design whose bounds are drawn beside those of another; None where there is none.

    path: its file, proved again; without one, kind set_membership is compared with the interval
    observer of the same plant, where one is proved. InputError for a design of another plant,
    without bounds, or not proved.
    """
    if path is not None:
        return _stated(design, path)
    if design.kind != "set_membership":
        return None
    try:
        problem = Problem.from_dict(design.problem).for_kind("interval")[0]
        outcome = workflow.investigate(problem, seconds=_INTERVAL_SECONDS)
    except InputError:
        return None
    return outcome.design if outcome.verdict == "proved" else None


def _stated(design: Design, path: str) -> Design:
    other = load_design(path)
    for each in (design, other):
        if each.kind not in GIVING_BOUNDS:
            kinds = " or ".join(GIVING_BOUNDS)
            raise InputError(f"{path}: --beside compares bounds, of kind {kinds}; got {each.kind}.")
    if _plant(design) != _plant(other):
        raise InputError(
            f"{path}: a design of the same plant is required; flow, jump or output differ."
        )
    verdict = workflow.verify(other).verdict
    if verdict != "proved":
        raise InputError(f"{path}: a proved design is required; its verdict is {verdict}.")
    return other


def _plant(design: Design) -> NewEntries:
    """The problem of a design without its observer and name."""
    problem: NewEntries = jsonable(Problem.from_dict(design.problem).to_dict())
    return {key: entry for key, entry in problem.items() if key not in ("observer", "name")}


def estimate_of(
    design: Design, path: str, data: DataSource, beside: Design | None = None
) -> NewEntries | None:
    """The observer on data, or on a simulation of its plant; None where it cannot be simulated.

    path: of the file of the design; beside: a second design whose bounds are drawn too. The entries
    are those of `report.html`.
    """
    with temporary_folder() as folder:
        source, initial = data.path, data.initial
        if source is None:
            simulated = _simulated(design, folder)
            if simulated is None:
                return None
            source, start = simulated
            initial = start if initial is None else initial
        estimates, picture = str(Path(folder, f"{design.kind}.csv")), str(Path(folder, "e.svg"))
        try:
            tally = execute(path, source, estimates, initial, None, titles=data.titles)
        except InputError:
            if data.path is None:  # impulses at unknown times, which this kind cannot detect
                return None
            raise
        read = replace(data, path=source, initial=initial)
        other = None if beside is None else _other_estimate(beside, folder, read)
        _draw(design, estimates, picture, read, other)
        svg = Path(picture).read_text("utf-8")
        measured = ComparisonRecord.from_file(
            source, Problem.from_dict(design.problem), data.titles
        )
        designs = (design,) if beside is None else (design, beside)
        rows = _rows_with_kalman(designs, measured, initial)
        bounds = _bounds(design, measured, Table.from_file(estimates))
    title = "On a simulation" if data.path is None else "On data"
    caption = _caption(tally, data.path)
    if beside is None and design.kind == "set_membership":
        caption += (
            " No interval observer of this plant, to be drawn beside, was proved within "
            f"{_INTERVAL_SECONDS:g} s."
        )
    entries = {"title": title, "image": inline(svg), "caption": caption}
    return {**entries, "beside": rows, "bounds": bounds}


def inline(svg: str) -> str:
    """A picture as the address of an image."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode("utf-8")).decode("ascii")


def _simulated(design: Design, folder: str) -> tuple[str, list[float] | None] | None:
    """A file of simulated data, and bounds to start from where the kind needs them."""
    try:
        plant = Problem.from_dict(design.problem).plant
        announced = design.kind != "impulsive_input"
        run = simulate(plant, until=end_of_record(plant), announced=announced)
    except InputError:  # an unstable plant, or no dwell time to simulate with
        return None
    source = str(Path(folder, "simulated.csv"))
    write_text(source, table_text(run.columns))
    if design.kind not in GIVING_BOUNDS:
        return source, None
    return source, first_bounds(run.block("x")[0])


def first_bounds(x: Matrix) -> list[float]:
    """Bounds x1_lo, x1_hi, ... that a simulated run starts from; x (n,): the true first state."""
    # not around the truth: nobody knows it so well
    return np.column_stack([x - 0.5, x + 1.5]).reshape(-1).tolist()


def _other_estimate(other: Design, folder: str, data: DataSource) -> str:
    """The estimate file of a second design on the same data, by a name of its own."""
    design, estimates = Path(folder, "beside.json"), Path(folder, f"{other.kind}.csv")
    if estimates.exists():
        estimates = Path(folder, f"{other.kind}_beside.csv")
    other.save(design)
    execute(str(design), data.path, str(estimates), data.initial, None, titles=data.titles)
    return str(estimates)


def _draw(
    design: Design, estimates: str, picture: str, data: DataSource, other: str | None
) -> None:
    from obsdesign.pages.plotting.estimate import Comparison, plot_estimate

    compared = Comparison(other, Problem.from_dict(design.problem), data.titles)
    plot_estimate(estimates, data.path, picture, None, compared)


def _caption(tally: Tally, data: str | None) -> str:
    origin = f"of {Path(data).name}" if data else "simulated with random admissible disturbances"
    return f"{tally.rows} rows {origin}: {tally}."


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
    return {"table": error_table(bounds), "image": inline(curve_svg(error_curve(bounds)))}


def _rows_with_kalman(
    designs: Sequence[Design], record: ComparisonRecord, initial: Sequence[float] | None
) -> tuple[list[str], list[list[str]]] | None:
    """The designs and a Kalman filter, where the record has the true state."""
    if record.x is None:
        return None
    if initial is not None and designs[0].kind not in GIVING_BOUNDS:
        x = np.asarray(initial, dtype=np.float64)
        initial = np.column_stack([x - 1, x + 1]).reshape(-1).tolist()
    return table(compare_with_kalman(designs, record, initial))
