"""Numbers of each state beside what is guaranteed: typical ones, and the least possible."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries
from lmi.memory import OversizeError
from obsdesign.data.simulation.parameter_courses import nominal_plant
from obsdesign.data.simulation.rows import default_until, settled
from obsdesign.document import Design
from obsdesign.errors import InputError
from obsdesign.kinds import GIVING_BOUNDS
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.studies.comparison.record import ComparisonRecord, end_of_record
from obsdesign.studies.comparison.row import estimates_on, rows_of_second_half
from obsdesign.studies.least_width import least_widths
from obsdesign.verification.state_widths import StateWidths, state_labels
from obsdesign.workflow import Outcome

# rows of the simulation that are used: of bounds, which may take milliseconds each, and of others
_MOST_BOUNDS, _MOST_ROWS = 400, 5000


def typical_values(design: Design, widths: Sequence[float | None]) -> list[float | None]:
    """Mean width of the bounds of each state, or mean |error| of its estimate.

    Over the last half of the default simulation (seed 0, 400 rows of bounds or 5000 of estimates at
    most), bounds from one unit about the true initial state, or half of the guaranteed widths (n,)
    where that is less, parameters at an end of their range (drawn at every row their effects would
    average out); rows without guarantee are left out. None where nothing can be simulated, or no
    such row has finite bounds.
    """
    problem = Problem.from_dict(design.problem)
    unknown: list[float | None] = [None] * problem.plant.n
    try:
        most = _MOST_BOUNDS if design.kind in GIVING_BOUNDS else _MOST_ROWS
        record = ComparisonRecord.from_simulation(
            problem.plant,
            until=_end(problem.plant, most),
            rng=np.random.default_rng(0),
            parameters="extreme",
        ).head(most)
        if record.x is None:
            return unknown
        around = np.array([1.0 if width is None else min(1.0, width / 2) for width in widths])
        start = np.column_stack([record.x[0] - around, record.x[0] + around])
        estimates = estimates_on(design, record, start)
    except (InputError, OversizeError):
        return unknown
    if design.kind in GIVING_BOUNDS:
        low, high = (np.array([getattr(e, end) for e in estimates]) for end in ("lower", "upper"))
        values = high - low
    elif len(record.x) == len(estimates):
        values = np.abs(np.array([each.x for each in estimates]) - record.x)
    else:
        return unknown
    return _means(values[rows_of_second_half(estimates)])


def _end(plant: Plant, most: int) -> float | None:
    """End of a simulation with at most so many periods; None where none are stated."""
    until = end_of_record(plant)
    if not plant.has_one_clock:
        return _end_of_clocks(nominal_plant(plant), most)
    period = plant.output.period
    if period is None:
        return until
    until = default_until(nominal_plant(plant), "random") if until is None else until
    return min(until, most * period)


def _end_of_clocks(plant: Plant, most: int) -> float:
    """The default end, or when the slowest mode has decayed, with at most so many samples."""
    gaps = [sensor.gap for sensor in plant.sensors if 0 < sensor.gap < math.inf]
    lasting = most / sum(1 / gap for gap in gaps) if gaps and not plant.modes else 0.0
    return max(default_until(plant, "random"), min(settled(plant), lasting))


def with_typical(outcome: Outcome) -> Outcome:
    """The outcome with typical and least possible numbers of each state, unless it is refuted."""
    if outcome.design is None or outcome.verdict == "refuted":
        return outcome
    problem = Problem.from_dict(outcome.design.problem)
    labels = state_labels(problem)
    rows = outcome.result.get("states") or [asdict(StateWidths(*label)) for label in labels]
    widths = [row["width"] for row in rows]
    pairs = zip(rows, typical_values(outcome.design, widths), strict=True)
    stated = [{**row, "typical": value} for row, value in pairs]
    return replace(outcome, result={**outcome.result, "states": _with_least(stated, problem.plant)})


def _with_least(rows: Sequence[Entries], plant: Plant) -> list[NewEntries]:
    """Rows of states with the least possible width where none is stated; half of it as error.

    ratio: of what is guaranteed and that.
    """
    stated: list[NewEntries] = []
    for row, width in zip(rows, least_widths(plant), strict=True):
        guaranteed, best = row["width"], width
        if row["error"] is not None and width is not None:
            guaranteed, best = row["error"], width / 2
        new = dict(row)
        if row["best"] is None and guaranteed is not None and best is not None:
            new |= {"best": best, "ratio": guaranteed / best}
        stated.append(new)
    return stated


def _means(values: Matrix) -> list[float | None]:
    """Mean of each column over its finite entries; None where there are none."""
    means: list[float | None] = []
    for column in values.T:
        finite = column[np.isfinite(column)]
        means.append(float(finite.mean()) if finite.size else None)
    return means
