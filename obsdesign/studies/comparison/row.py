"""One observer on one record, in numbers; and rows as a table."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries
from obsdesign.data.stream import estimates_of
from obsdesign.document import Design
from obsdesign.kinds import GIVING_BOUNDS
from obsdesign.problem.plant import Plant
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Estimate
from obsdesign.studies.comparison.kalman import kalman_filter, tuned_walk
from obsdesign.studies.comparison.record import ComparisonRecord

REFERENCE = "Kalman filter"
# errors are taken over this last part of the record, when transients have gone
_LATE = 0.5


@dataclass(frozen=True)
class ComparisonRow:
    """One observer. Errors and widths are root mean squares over the last half of the record.

    guarantee: the first that its design gives. Rows whose guarantee does not hold are counted
    (`without`) and left out. reason: why
    there is no observer, or where one was not proved. error, worst: of the estimate, or of the
    middle of the bounds; input_error: of the unknown input; seconds: per row, in processor time;
    ended: the budget that ended the search for a design, as `TimeBudget.ended` has it.
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
    ended: Entries = field(default_factory=dict)


def run(design: Design, record: ComparisonRecord, start: Matrix) -> NewEntries:
    """Errors, widths and times of a design, started in the bounds (n, 2) or their middle."""
    clock = time.process_time()
    estimates = estimates_on(design, record, start)
    seconds = (time.process_time() - clock) / len(estimates)
    numbers: NewEntries = {
        "seconds": seconds,
        "without": sum(estimate.status != "ok" for estimate in estimates),
    }
    good = rows_of_second_half(estimates)
    if estimates[0].lower is not None:
        low, high = (np.array([getattr(e, end) for e in estimates]) for end in ("lower", "upper"))
        numbers |= {"width": _size((high - low)[good])}
    if estimates[0].x is not None:
        x = np.array([estimate.x for estimate in estimates])
    else:
        with np.errstate(invalid="ignore"):  # where both ends are infinite there is no middle
            x = (low + high) / 2
    d = None if estimates[-1].d is None else np.array([estimate.d for estimate in estimates])
    return numbers | _errors(record, x, d, good)


def estimates_on(design: Design, record: ComparisonRecord, start: Matrix) -> list[Estimate]:
    """Estimates of a design on a record, started in the bounds (n, 2) or their middle."""
    observer = from_design(design)
    begin = start if design.kind in GIVING_BOUNDS else start.mean(axis=1)
    samples = record.samples_for(design, observer)
    state = observer.start(samples[0].t, begin.reshape(-1).tolist())
    return list(estimates_of(observer, state, iter(samples)))


def rows_of_second_half(estimates: Sequence[Estimate]) -> NDArray[np.bool_]:
    """The rows of the last half whose guarantee holds."""
    good = np.array([estimate.status == "ok" for estimate in estimates])
    good[: int(_LATE * len(good))] = False
    return good


def _errors(
    record: ComparisonRecord, x: Matrix, d: Matrix | None, counted: NDArray[np.bool_]
) -> NewEntries:
    errors: NewEntries = {}
    if record.x is not None and len(record.x) == len(x):
        error = np.abs(x - record.x)[counted]
        finite = error[np.isfinite(error)]
        worst = float(finite.max()) if finite.size else None
        errors |= {"error": _size(error), "worst": worst}
    if record.d is not None and d is not None and len(record.d) == len(d):
        # what is known at a row is the mean of d over the interval before it
        errors |= {"input_error": _size((d - record.d)[counted])}
    return errors


def _size(values: Matrix) -> float | None:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    size = float(np.sqrt(np.mean(finite**2)))
    return size if math.isfinite(size) else None


def filtered(plant: Plant, record: ComparisonRecord, start: Matrix) -> ComparisonRow:
    """The filter; the time of its tuning is not counted."""
    begin = {
        "initial": start.mean(axis=1),
        "initial_variance": (start[:, 1] - start[:, 0]) ** 2 / 12,
    }
    walk = tuned_walk(plant, record.samples, **begin)
    clock = time.process_time()
    estimates = kalman_filter(plant, record.samples, walk=walk, **begin)
    seconds = (time.process_time() - clock) / len(record.samples)
    late = np.arange(len(estimates.t)) >= int(_LATE * len(estimates.t))
    variant = f"walk {walk:g}" if walk else ""
    d = estimates.d if estimates.d.size else None
    errors = _errors(record, estimates.x, d, late)
    return ComparisonRow(REFERENCE, variant, "", seconds=seconds, **errors)


def table(rows: Sequence[ComparisonRow]) -> tuple[list[str], list[list[str]]]:
    """Titles and cells of the rows that ran, with the columns that one of them has."""
    columns: dict[str, Callable[[ComparisonRow], float | None]] = {
        "error": lambda row: row.error,
        "worst": lambda row: row.worst,
        "width": lambda row: row.width,
        "error of d": lambda row: row.input_error,
        "not ok": lambda row: row.without,
        "µs/row": lambda row: None if row.seconds is None else 1e6 * row.seconds,
    }
    ran = [row for row in rows if row.seconds is not None]
    shown = {
        name: value_of
        for name, value_of in columns.items()
        if any(value_of(row) is not None for row in ran)
    }
    cells = [[name_of(row), *(_cell(value_of(row)) for value_of in shown.values())] for row in ran]
    return ["observer", *shown], cells


def name_of(row: ComparisonRow) -> str:
    """Kind and variant, for people."""
    return ", ".join(word.replace("_", " ") for word in (row.kind, row.variant) if word)


def _cell(value: float | None) -> str:
    if value is None:
        return "–"
    return str(value) if isinstance(value, int) else f"{value:.3g}"
