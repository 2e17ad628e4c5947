"""Which observers there are, and how each does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from lmi.memory import OversizeError
from lmi.time_budget import ended_part, total_budget
from obsdesign import workflow
from obsdesign.document import Design
from obsdesign.equations.finite_time import gains as finite_time
from obsdesign.equations.impulsive import gains as impulsive
from obsdesign.equations.interval import splits as interval
from obsdesign.errors import InputError
from obsdesign.problem.kinds import KINDS
from obsdesign.problem.problem import Problem
from obsdesign.studies.comparison.record import Record
from obsdesign.studies.comparison.row import Row, filtered, run
from obsdesign.verification.answers import is_ended, reason, verdict_of_refusal

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
    problem: Problem,
    record: Record,
    initial: Sequence[float] | None = None,
    *,
    seconds: float | None = None,
) -> Iterator[Row]:
    """One row per observer that the plant admits, as they come, then the filter.

    Every kind as the problem asks for it, then in its other ways. initial: x1_lo, x1_hi, ... at the
    first row; point observers begin in the middle. By default bounds around zero that are as far
    from it as the true state is, and a unit beyond. seconds: of processor time that searches may
    take in all.
    """
    start = _initial(problem, record, initial)
    for (kind, value), outcome in _designs(problem, seconds).items():
        yield _row(kind, outcome, record, start, value)
    yield filtered(problem.plant, record, start)


def compare_with_kalman(
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


def _designs(
    problem: Problem, seconds: float | None
) -> dict[tuple[str, str], workflow.Outcome | InputError]:
    """(kind, way) -> its design, or why there is none; the way is "" as the problem asks for it."""
    found: dict[tuple[str, str], workflow.Outcome | InputError] = {}
    own: dict[tuple[str, str], Problem] = {}
    for kind in KINDS:
        try:
            own[kind, ""] = problem.for_kind(kind)[0]
        except InputError as error:
            found[kind, ""] = error
    with total_budget(seconds):
        found |= workflow.investigate_each(own)
        ways: dict[tuple[str, str], Problem] = {}
        for (kind, _), asked in own.items():
            for value in _other_ways(kind, found[kind, ""]):
                body = asked.to_dict()
                # gains and a lag that were given are for the way that was asked for
                body["observer"].pop("lag", None)
                body["observer"] = {**body["observer"], _VARIANTS[kind][0]: value, "gains": {}}
                try:
                    ways[kind, value] = Problem.from_dict(body)
                except InputError as error:
                    found[kind, value] = error
        found |= workflow.investigate_each(ways)
    return dict(sorted(found.items(), key=lambda item: KINDS.index(item[0][0])))


def _other_ways(kind: str, outcome: workflow.Outcome | InputError) -> list[str]:
    """Values of the kind's option beside that of its design; none where there is no design."""
    if isinstance(outcome, InputError) or outcome.design is None or outcome.verdict == "refuted":
        return []
    option, values = _VARIANTS.get(kind, ("", ()))
    return [value for value in values if value != str(outcome.design.gains.get(option))]


def _row(
    kind: str,
    outcome: workflow.Outcome | InputError,
    record: Record,
    start: Array,
    value: str,
) -> Row:
    if isinstance(outcome, InputError):
        return Row(kind, value, verdict_of_refusal(outcome), reason=str(outcome))
    design = outcome.design
    if outcome.verdict != "proved" or design is None:
        failed = [claim for claim in outcome.claims if claim.verdict == outcome.verdict]
        text = f"{failed[0].id}: {reason(failed[0])}" if failed else ""
        end = next((ended_part(claim.evidence) for claim in failed if is_ended(claim)), {})
        return Row(kind, value, outcome.verdict, reason=text, ended=end)
    variant = str(design.gains.get(_VARIANTS.get(kind, ("", ()))[0], ""))
    try:
        return Row(kind, variant, "proved", _guarantee(design), **run(design, record, start))
    except (InputError, OversizeError) as error:
        return Row(kind, variant, "proved", _guarantee(design), reason=str(error))


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
