"""Comparison of all observers of a plant on one record."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.memory import OversizeError
from lmi.time_budget import TimeBudget, ended_part
from obsdesign import workflow
from obsdesign.document import Design
from obsdesign.equations.finite_time.gains import METHODS
from obsdesign.equations.impulsive import gains as impulsive
from obsdesign.equations.interval import gains as interval
from obsdesign.errors import InputError
from obsdesign.kinds import KINDS, kind_named
from obsdesign.problem.problem import Problem
from obsdesign.studies.comparison.record import ComparisonRecord
from obsdesign.studies.comparison.row import ComparisonRow, filtered, run
from obsdesign.verification.answers import is_ended, reason, verdict_of_refusal

# the option of each kind that selects a variant, and its values
_VARIANTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "interval": ("form", interval.FORMS),
    "impulsive": ("strategy", impulsive.STRATEGIES),
    "finite_time": ("method", METHODS),
    "unknown_input": ("differentiator", ("cell", "damped", "batch", "fixed_lag")),
}
# rows on which a design is compared with the filter
MOST_ROWS = 5000


def compare(
    problem: Problem,
    record: ComparisonRecord,
    initial: Sequence[float] | None = None,
    *,
    kinds: Sequence[str] = KINDS,
    seconds: float | None = None,
) -> Iterator[ComparisonRow]:
    """One row per observer of these kinds that the plant admits, then the filter.

    Every kind with the problem's options, then its other variants. initial: x1_lo, x1_hi, ... at
    the first row; point observers begin in the middle. By default bounds around zero that are as
    far from it as the true state is, and a unit beyond. kinds: in any order. seconds: of processor
    time that searches may take in all. InputError for a name that is no kind.
    """
    for kind in kinds:
        kind_named(kind)
    start = _initial(problem, record, initial)
    for (kind, value), outcome in _designs(problem, kinds, seconds).items():
        yield _row(kind, outcome, record, start, value)
    yield filtered(problem.plant, record, start)


def compare_with_kalman(
    designs: Sequence[Design], record: ComparisonRecord, initial: Sequence[float] | None = None
) -> list[ComparisonRow]:
    """Designs of one plant and the filter on the first rows of a record; initial: as `compare`."""
    problem = Problem.from_dict(designs[0].problem)
    short = record.head(MOST_ROWS)
    start = _initial(problem, short, initial)
    rows = [ComparisonRow(design.kind, "", "", **run(design, short, start)) for design in designs]
    return [*rows, filtered(problem.plant, short, start)]


def _designs(
    problem: Problem, kinds: Sequence[str], seconds: float | None
) -> dict[tuple[str, str], workflow.Outcome | InputError]:
    """(kind, variant) -> outcome or refusal; the variant is "" with the problem's own options."""
    outcomes: dict[tuple[str, str], workflow.Outcome | InputError] = {}
    own: dict[tuple[str, str], Problem] = {}
    for kind in (kind for kind in KINDS if kind in kinds):
        try:
            own[kind, ""] = problem.for_kind(kind)[0]
        except InputError as error:
            outcomes[kind, ""] = error
    budget = TimeBudget.from_seconds(seconds)
    outcomes |= workflow.investigate_each(own, budget)
    variants: dict[tuple[str, str], Problem] = {}
    for (kind, _), own_problem in own.items():
        for value in _other_variants(kind, outcomes[kind, ""]):
            body = own_problem.to_dict()
            # given gains and a given lag belong to the problem's own variant
            kept = {name: x for name, x in body.get("observer", {}).items() if name != "lag"}
            body |= {"observer": {**kept, _VARIANTS[kind][0]: value, "gains": {}}}
            try:
                variants[kind, value] = Problem.from_dict(body)
            except InputError as error:
                outcomes[kind, value] = error
    outcomes |= workflow.investigate_each(variants, budget)
    return dict(sorted(outcomes.items(), key=lambda item: KINDS.index(item[0][0])))


def _other_variants(kind: str, outcome: workflow.Outcome | InputError) -> list[str]:
    """Values of the kind's option other than that of its design; none without a design."""
    if isinstance(outcome, InputError) or outcome.design is None or outcome.verdict == "refuted":
        return []
    option, values = _VARIANTS.get(kind, ("", ()))
    used = outcome.design.gains.get(option)  # none where the plant leaves no choice
    return [] if used is None else [value for value in values if value != str(used)]


def _row(
    kind: str,
    outcome: workflow.Outcome | InputError,
    record: ComparisonRecord,
    start: Matrix,
    value: str,
) -> ComparisonRow:
    if isinstance(outcome, InputError):
        return ComparisonRow(kind, value, verdict_of_refusal(outcome), reason=str(outcome))
    design = outcome.design
    if outcome.verdict != "proved" or design is None:
        failed = [claim for claim in outcome.claims if claim.verdict == outcome.verdict]
        text = f"{failed[0].id}: {reason(failed[0])}" if failed else ""
        end = next((ended_part(claim.evidence) for claim in failed if is_ended(claim)), {})
        return ComparisonRow(kind, value, outcome.verdict, reason=text, ended=end)
    variant = str(design.gains.get(_VARIANTS.get(kind, ("", ()))[0], ""))
    try:
        return ComparisonRow(
            kind, variant, "proved", _guarantee(design), **run(design, record, start)
        )
    except (InputError, OversizeError) as error:
        return ComparisonRow(kind, variant, "proved", _guarantee(design), reason=str(error))


def _guarantee(design: Design) -> str:
    """The first guarantee that the design gives; the design has them all."""
    return next((one.statement for one in design.guarantees if one.given), "")


def _initial(problem: Problem, record: ComparisonRecord, initial: Sequence[float] | None) -> Matrix:
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
