"""Every observer that a plant admits, on one record, side by side with a Kalman filter."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign import workflow
from obsdesign.document import Design
from obsdesign.equations import finite_time, impulsive, interval
from obsdesign.errors import InputError
from obsdesign.execution import estimates_of
from obsdesign.kalman import kalman_filter, tuned_walk
from obsdesign.kinds import KINDS
from obsdesign.plant import Plant
from obsdesign.problem import Problem
from obsdesign.records import Layout, read_columns, read_samples
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.base import rows_of
from obsdesign.simulation import simulate

Array = NDArray[np.float64]

# what each kind can be told to do in another way
_VARIANTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "interval": ("form", interval.FORMS),
    "impulsive": ("strategy", impulsive.STRATEGIES),
    "finite_time": ("method", finite_time.METHODS),
    "unknown_input": ("differentiator", ("cell", "damped", "batch")),
}
REFERENCE = "Kalman filter"
# a design beside the filter is run on so many rows at most
MOST_ROWS = 5000
# errors are taken over this last part of the record, when transients have gone
_LATE = 0.5


@dataclass(frozen=True)
class Record:
    """What every observer sees, and the truth where it is known: x (rows, n), d (rows, q)."""

    samples: tuple[Sample, ...]
    x: Array | None = None
    d: Array | None = None

    @staticmethod
    def simulated(plant: Plant, **options: Any) -> Record:
        """A simulation of the plant; options: those of `simulation.simulate`."""
        made = simulate(plant, **options)
        given = {letter: made.block(letter) for letter in "uw" if made.block(letter).size}
        samples = rows_of(made.t, made.block("y"), **given, jump=made.columns.get("jump"))
        d = made.block("d")
        return Record(tuple(samples), made.block("x"), d if d.size else None)

    @staticmethod
    def read(path: str, plant: Plant) -> Record:
        """A data file, with its truth where it has all of x1, ..., xn (and d1, ...)."""
        flow, jump = plant.flow, plant.jump
        u, w = (0 if X is None else X.shape[1] for X in (flow.B, None if jump is None else jump.E))
        layout = Layout(plant.p, u, w, jump is not None and jump.H is None)
        columns = read_columns(path)
        with open(path, encoding="utf-8", newline="") as stream:
            samples = tuple(read_samples(stream, layout, path))
        q = 0 if flow.D is None else flow.D.shape[1]
        return Record(samples, _truth(columns, "x", plant.n, path), _truth(columns, "d", q, path))


def _truth(columns: dict[str, list[str]], letter: str, count: int, path: str) -> Array | None:
    names = [f"{letter}{i + 1}" for i in range(count)]
    if not names or any(name not in columns for name in names):
        return None
    try:
        cells = [[float(cell) if cell else math.nan for cell in columns[name]] for name in names]
    except ValueError as error:
        raise InputError(f"{path}: columns {names[0]}, ... must hold numbers: {error}.") from None
    return np.array(cells).T


@dataclass(frozen=True)
class Row:
    """One observer. Errors and widths are root mean squares over the last half of the record.

    Rows whose guarantee does not hold are counted (`without`) and left out of them. reason: why
    there is no observer, or where one was not proved. error, worst: of the estimate, or of the
    middle of the bounds; input_error: of the unknown input; seconds: per row, in processor time.
    """

    kind: str
    variant: str
    verdict: str
    guarantee: str = ""
    error: float | None = None
    worst: float | None = None
    width: float | None = None
    input_error: float | None = None
    without: int | None = None
    seconds: float | None = None
    reason: str = ""


def compare(
    problem: Problem, record: Record, initial: Sequence[float] | None = None
) -> Iterator[Row]:
    """One row per observer that the plant admits, as they come, then the filter.

    initial: x1_lo, x1_hi, ... at the first row; point observers begin in the middle. By default
    bounds around zero that are as far from it as the true state is, and a unit beyond.
    """
    start = _initial(problem, record, initial)
    for kind in KINDS:
        yield from _of_kind(problem, kind, record, start)
    yield _filtered(problem, record, start)


def beside_filter(
    design: Design, record: Record, initial: Sequence[float] | None = None
) -> tuple[Row, Row]:
    """A design and the filter on the first rows of a record; initial: as for `compare`."""
    problem = Problem.from_dict(design.problem)
    x, d = (None if truth is None else truth[:MOST_ROWS] for truth in (record.x, record.d))
    short = Record(record.samples[:MOST_ROWS], x, d)
    start = _initial(problem, short, initial)
    return Row(design.kind, "", "", **_run(design, short, start)), _filtered(problem, short, start)


def table(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Titles and cells of the rows that ran, with the columns that one of them has."""
    columns: dict[str, Callable[[Row], float | None]] = {
        "error": lambda row: row.error,
        "worst": lambda row: row.worst,
        "width": lambda row: row.width,
        "error of d": lambda row: row.input_error,
        "not ok": lambda row: row.without,
        "µs/row": lambda row: None if row.seconds is None else 1e6 * row.seconds,
    }
    ran = [row for row in rows if row.seconds is not None]
    shown = {name: of for name, of in columns.items() if any(of(row) is not None for row in ran)}
    cells = [[name_of(row), *(_cell(of(row)) for of in shown.values())] for row in ran]
    return ["observer", *shown], cells


def name_of(row: Row) -> str:
    """Kind and variant, for people."""
    return ", ".join(word.replace("_", " ") for word in (row.kind, row.variant) if word)


def _cell(value: float | None) -> str:
    if value is None:
        return "–"
    return str(value) if isinstance(value, int) else f"{value:.3g}"


def _of_kind(problem: Problem, kind: str, record: Record, start: Array) -> Iterator[Row]:
    """The kind as the problem asks for it, then in its other ways."""
    try:
        asked, _ = problem.for_kind(kind)
        outcome = workflow.investigate(asked)
    except InputError as error:
        yield Row(kind, "", "refuted", reason=str(error))
        return
    option, values = _VARIANTS.get(kind, ("", ()))
    yield _row(outcome, option, record, start)
    if outcome.design is None or outcome.verdict == "refuted":
        return
    done = str(outcome.design.gains.get(option))
    for value in values:
        if value != done:
            yield _variant(asked, kind, option, value, record, start)


def _variant(
    asked: Problem, kind: str, option: str, value: str, record: Record, start: Array
) -> Row:
    """Gains that were given are for the way that was asked for; here they are synthesised."""
    body = asked.to_dict()
    body["observer"] = {**body["observer"], option: value, "gains": {}}
    try:
        return _row(workflow.investigate(Problem.from_dict(body)), option, record, start, value)
    except InputError as error:
        return Row(kind, value, "refuted", reason=str(error))


def _row(
    outcome: workflow.Outcome, option: str, record: Record, start: Array, value: str = ""
) -> Row:
    design = outcome.design
    if outcome.verdict != "proved" or design is None:
        failed = [claim for claim in outcome.claims if claim.verdict == outcome.verdict]
        told = f"{failed[0].id}: {workflow.reason(failed[0])}" if failed else ""
        return Row(outcome.kind, value, outcome.verdict, reason=told)
    variant = str(design.gains.get(option, ""))
    try:
        return Row(
            outcome.kind, variant, "proved", _guarantee(design), **_run(design, record, start)
        )
    except InputError as error:
        return Row(outcome.kind, variant, "proved", _guarantee(design), reason=str(error))


def _guarantee(design: Design) -> str:
    """In a few words; the design has the sentences."""
    evidence = {claim.id: claim.evidence for claim in design.claims}
    rate = {**evidence.get("rates", {}), **evidence.get("rate", {})}.get("in_time")
    decay = f", like exp(-{rate:.3g} t)" if isinstance(rate, float) and rate > 0 else ""
    return {
        "interval": "bounds contain the state",
        "luenberger": f"error tends to 0{decay}",
        "impulsive": f"error tends to 0{decay}",
        "finite_time": "exact from a full window on",
        "unknown_input": "error tends to 0, whatever d is",
        "impulsive_input": "times and weights of impulses",
    }[design.kind]


def _initial(problem: Problem, record: Record, initial: Sequence[float] | None) -> Array:
    """Bounds (n, 2) of the state at the first row."""
    n = problem.plant.n
    if initial is None:
        far = 1.0 + (0.0 if record.x is None else np.abs(record.x[0]))
        return np.column_stack([-far * np.ones(n), far * np.ones(n)])
    bounds = np.asarray(initial, dtype=np.float64)
    if bounds.shape != (2 * n,) or not (bounds[::2] <= bounds[1::2]).all():
        raise InputError(
            f"--initial must be {2 * n} numbers x1_lo,x1_hi,... with lo <= hi; got {len(bounds)}."
        )
    return bounds.reshape(n, 2)


def _run(design: Design, record: Record, start: Array) -> dict[str, Any]:
    observer: Any = from_design(design)
    begin = start if design.kind == "interval" else start.mean(axis=1)
    state = observer.start(record.samples[0].t, begin.reshape(-1).tolist())
    clock = time.process_time()
    estimates = list(estimates_of(observer, state, iter(record.samples)))
    seconds = (time.process_time() - clock) / len(estimates)
    found: dict[str, Any] = {
        "seconds": seconds,
        "without": sum(estimate.status != "ok" for estimate in estimates),
    }
    good = np.array([estimate.status == "ok" for estimate in estimates])
    good[: int(_LATE * len(good))] = False
    if estimates[0].lower is not None:
        low, high = (np.array([getattr(e, end) for e in estimates]) for end in ("lower", "upper"))
        x = (low + high) / 2
        found["width"] = _size((high - low)[good])
    else:
        x = np.array([estimate.x for estimate in estimates])
    d = None if estimates[-1].d is None else np.array([estimate.d for estimate in estimates])
    return found | _errors(record, x, d, good)


def _errors(
    record: Record, x: Array, d: Array | None, counted: NDArray[np.bool_]
) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if record.x is not None and len(record.x) == len(x):
        missed = np.abs(x - record.x)[counted]
        found["error"] = _size(missed)
        found["worst"] = float(np.nanmax(missed)) if np.isfinite(missed).any() else None
    if record.d is not None and d is not None and len(record.d) == len(d):
        # what is known at a row is the mean of d over the interval before it
        found["input_error"] = _size((d - record.d)[counted])
    return found


def _size(values: Array) -> float | None:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    size = float(np.sqrt(np.mean(finite**2)))
    return size if math.isfinite(size) else None


def _filtered(problem: Problem, record: Record, start: Array) -> Row:
    """The filter; the time of its tuning is not counted."""
    begin = {
        "initial": start.mean(axis=1),
        "initial_variance": float(np.mean((start[:, 1] - start[:, 0]) ** 2) / 12),
    }
    walk = tuned_walk(problem.plant, record.samples, **begin)
    clock = time.process_time()
    found = kalman_filter(problem.plant, record.samples, walk=walk, **begin)
    seconds = (time.process_time() - clock) / len(record.samples)
    late = np.arange(len(found.t)) >= int(_LATE * len(found.t))
    told = f"walk {walk:g}" if walk else ""
    errors = _errors(record, found.x, found.d if found.d.size else None, late)
    return Row(REFERENCE, told, "", "none", seconds=seconds, **errors)
