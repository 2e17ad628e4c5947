"""Which observers there are, and how each does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from obsdesign import workflow
from obsdesign.comparison.record import Record
from obsdesign.comparison.row import Row, filtered, run
from obsdesign.document import Design
from obsdesign.equations import finite_time, impulsive, interval
from obsdesign.errors import InputError
from obsdesign.kinds import KINDS
from obsdesign.problem import Problem

Array = NDArray[np.float64]

# what each kind can be told to do in another way
_VARIANTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "interval": ("form", interval.FORMS),
    "impulsive": ("strategy", impulsive.STRATEGIES),
    "finite_time": ("method", finite_time.METHODS),
    "unknown_input": ("differentiator", ("cell", "damped", "batch", "fixed_lag")),
}
# a design beside the filter is run on so many rows at most
MOST_ROWS = 5000


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
    yield filtered(problem.plant, record, start)


def beside_filter(
    design: Design, record: Record, initial: Sequence[float] | None = None
) -> tuple[Row, Row]:
    """A design and the filter on the first rows of a record; initial: as for `compare`."""
    problem = Problem.from_dict(design.problem)
    x, d = (None if truth is None else truth[:MOST_ROWS] for truth in (record.x, record.d))
    short = Record(record.samples[:MOST_ROWS], x, d)
    start = _initial(problem, short, initial)
    return Row(design.kind, "", "", **run(design, short, start)), filtered(
        problem.plant, short, start
    )


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
    """Gains and a lag that were given are for the way that was asked for; here they are chosen."""
    body = asked.to_dict()
    body["observer"].pop("lag", None)
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
            outcome.kind, variant, "proved", _guarantee(design), **run(design, record, start)
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
        "luenberger": f"undisturbed, error tends to 0{decay}",
        "impulsive": f"undisturbed, error tends to 0{decay}",
        "finite_time": "undisturbed, exact from a full window on",
        "unknown_input": "without noise, error tends to 0, whatever d is",
        "impulsive_input": "without noise, times and weights of impulses",
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
    if not np.isfinite(bounds).all():
        raise InputError(f"--initial must be finite; got {bounds.tolist()}.")
    return bounds.reshape(n, 2)
