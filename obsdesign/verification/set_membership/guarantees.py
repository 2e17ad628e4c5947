"""Guarantees of the multiplier observer, in sentences, and its numbers for each state."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR

from lmi.arithmetic.arrays import Entries
from obsdesign.analysis.set_membership.requirements import pattern_of
from obsdesign.document import Claim, Guarantee
from obsdesign.problem.problem import Problem
from obsdesign.verification.assumptions import is_bounded, under_assumptions
from obsdesign.verification.rates import six_digits
from obsdesign.verification.same_evidence import ROUNDED_WIDTHS
from obsdesign.verification.silent_sensors import missing_samples
from obsdesign.verification.state_widths import StateWidths, sensor_strips, state_labels

_ENCLOSURE = (
    "The bounds contain the state at every row, if they contain it at the start, {bounded} and v "
    "stay inside their bounds and jumps are reported at their times; this holds for samples at any "
    "spacing, {missing}, for any dwell time and whatever the rounding."
)
_INPUT = (
    "The bounds of d contain the unknown input at every row, if it stays inside flow.d_bounds and "
    "changes no faster than flow.d_bounds.rate."
)
_NO_RATE = (
    "No bounds of the unknown input narrower than flow.d_bounds exist, since flow.d_bounds.rate is "
    "not stated: a short spike of d leaves no trace in y."
)
_CONTRADICTION = (
    "Bounds that cross prove that plant, declared bounds and data contradict each other; the "
    "samples whose multipliers prove it are named."
)


def guarantees(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on."""
    verdicts = {claim.id: claim.verdict for claim in claims}
    own = problem.plant.flow.d_bounds
    bounded = "b, c" if own is None else "b, c, d"
    enclosure = _ENCLOSURE.format(bounded=bounded, missing=missing_samples(problem.plant))
    sentences = [(enclosure, ["consistent"]), (_CONTRADICTION, ["consistent"])]
    if own is not None and own.rate is not None:
        sentences.insert(1, (_INPUT, ["consistent"]))
    rows = states(problem, claims)
    widths = [row.width for row in rows]
    if None not in widths:
        above = _shown(widths, ROUND_CEILING)
        pattern = pattern_of(problem.plant)
        text = f"With {pattern}, the ultimate bound of the width after a row is {above}."
        sentences += [(text, ["width"]), (ROUNDED_WIDTHS, ["width"])]
        least = _least_possible(rows)
        sentences += [] if least is None else [(least, ["width", "optimal"])]
    entries = tuple(Guarantee.from_verdicts(text, names, verdicts) for text, names in sentences)
    return under_assumptions(problem.plant, claims, entries)


def warnings(problem: Problem, claims: tuple[Claim, ...]) -> tuple[str, ...]:
    """Where the data alone tell how narrow the bounds are."""
    own = problem.plant.flow.d_bounds
    spikes = (_NO_RATE,) if own is not None and own.rate is None else ()
    if any(claim.id == "width" for claim in claims):
        return spikes
    if not is_bounded(problem.plant, claims):
        why = "[state] is not stated, and no box of x proved that bounds effects of parameters"
        return (f"No width of the bounds is proved: {why}. The bounds of each row hold.", *spikes)
    pattern = pattern_of(problem.plant)
    why = pattern if isinstance(pattern, str) else "no tube was found on the nominal pattern"
    return (f"No width of the bounds is proved: {why}. The bounds of each row hold.", *spikes)


def states(problem: Problem, claims: tuple[Claim, ...]) -> tuple[StateWidths, ...]:
    """Sensor strip, certified width, least possible width and their ratio, for each state."""
    proved: dict[str, Entries] = {
        claim.id: claim.evidence for claim in claims if claim.verdict == "proved"
    }
    n = problem.plant.n
    none = [None] * n
    width = proved.get("width", {}).get("always", none)
    optimal = proved.get("optimal", {})
    best, ratio = optimal.get("least", none), optimal.get("ratio") or none
    labels, strips = state_labels(problem), sensor_strips(problem.plant.outputs)
    if any("C" in parameter.effects for parameter in problem.plant.parameters):
        strips = [None] * n  # how much a sample leaves open depends on x
    pattern = pattern_of(problem.plant) if "width" in proved else ""
    times = None if isinstance(pattern, str) else pattern.described(problem.names.time_unit)
    return tuple(
        StateWidths(*labels[i], strip, width[i], best=best[i], ratio=ratio[i], pattern=times)
        for i, strip in enumerate(strips)
    )


def _least_possible(rows: Sequence[StateWidths]) -> str | None:
    """Ratio of certified and least possible widths in a sentence; None where all of these are 0.

    States with a least width of 0 are left out: nothing is known of how near theirs are.
    """
    known = [row for row in rows if row.best and row.ratio is not None]
    if not known:
        return None
    least = _shown([row.best for row in known], ROUND_FLOOR)
    times = _shown([row.ratio for row in known], ROUND_CEILING)
    of = "" if len(known) == len(rows) else f" of {', '.join(row.name for row in known)}"
    return (
        f"No observer can guarantee widths{of} below {least} after all of these rows: the "
        f"certified width is at most {times} times the least possible one."
    )


def _shown(values: list[float | None], rounding: str) -> str:
    """Text of a vector in six digits."""
    return "(" + ", ".join(six_digits(x, rounding) for x in values if x is not None) + ")"
