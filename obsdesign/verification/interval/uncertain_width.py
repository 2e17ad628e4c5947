"""The interval observer with an event at uncertain times: the width of its bounds.

A tube of the width of the body on the graph of the clocks, and beside it the ranges of the curves
of the last events (`analysis.interval.uncertain_widths_additive`). Both are made from the problem.
"""

from __future__ import annotations

from decimal import ROUND_CEILING

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, Matrix
from lmi.verdict import Verdict, proved, undecided
from obsdesign.analysis.interval.several_clocks import reason_against_clocks
from obsdesign.analysis.interval.uncertain_widths import reason_against_events
from obsdesign.analysis.interval.uncertain_widths_additive import UncertainAdditiveSystem
from obsdesign.analysis.interval.uncertain_widths_general import (
    SizeSystem,
    UncertainGeneralSystem,
    turns,
)
from obsdesign.document import Claim, Guarantee
from obsdesign.equations.clocks import events_of, sensors_of
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.equations.plant import Jump, Plant
from obsdesign.problem.problem import Problem
from obsdesign.verification.consistency import consistent_gains
from obsdesign.verification.interval.several_clocks import expected_of_clocks, proved_width
from obsdesign.verification.rates import six_digits
from obsdesign.verification.same_evidence import ROUNDED_WIDTHS

_ENCLOSURE = (
    "The bounds contain the state at every row, if they contain it at the start, b, c and v stay "
    "inside their bounds and every event happens within its time_error of its stamp; this holds "
    "for samples of each sensor at any spacing, missing ones included, for any times between "
    "events and whatever the rounding."
)
_UNIT_INPUTS = (
    "event.{}.input_bound is not stated: the proved width is for known inputs up to 1, and grows "
    "with them. input_bound = [...], the largest of each, gives the width for these."
)
_SOURCE = "docs/uncertain_times.md; comparison with fewer samples"


def uncertain_claims(
    problem: Problem, stored: Entries, certificates: EntriesByClaim
) -> tuple[Claim, ...]:
    """All claims of the design, each with its verdict; stored: gains as a file states them.

    certificates: {"late_width": {"cells", "tube"}} where it was found; it is checked.
    """
    reason = reason_against_clocks(problem)
    expected = {} if reason is not None else expected_of_clocks(problem, stored)
    agreement, gains = consistent_gains(
        reason, stored, expected, ClockedIntervalGains.from_document
    )
    if gains is None or reason_against_events(gains.events, gains.sensors):
        return (agreement,)
    name = problem.plant.uncertain_events[0]
    width = Claim.from_verdict(
        "late_width",
        f"asymptotically, as long as {name} happens, the width of the bounds is at most `before` "
        f"just before {name} may happen, `after` once it has, and `always` at any time farther "
        "than time_error from every stamp, for all times of events, stamps and samples that the "
        f"clocks allow{_inputs(problem.plant)}",
        _SOURCE,
        _width(gains, certificates.get("late_width", {})),
    )
    return (agreement, width)


def _uncertain(plant: Plant) -> Jump:
    """The one event at uncertain times."""
    return next(event for event in plant.events if event.stamp_error)


def _has_unit_inputs(plant: Plant) -> bool:
    """Has its event at uncertain times known inputs without a bound?"""
    event = _uncertain(plant)
    return event.E is not None and event.input_bound is None


def _inputs(plant: Plant) -> str:
    """The inputs for which widths are claimed, in words."""
    if _uncertain(plant).E is None:
        return ""
    if not _has_unit_inputs(plant):
        return " with known inputs within input_bound"
    # all that enters the widths is at most N times as large, and their maps are concave
    return " with known inputs up to 1, N times that with those up to N >= 1"


def _width(gains: ClockedIntervalGains, proposed: Entries) -> Verdict:
    """The tube of a certificate, proved, and what it comes to."""
    if not turns(gains):
        return _with_curves(UncertainAdditiveSystem(gains), proposed)
    if reason := UncertainGeneralSystem(gains).reason_against():
        return undecided(reason)
    sizes = proved_width(SizeSystem(gains), proposed.get("sizes", {}))
    if sizes.outcome != "proved":
        return undecided("no tube was found for the size of the state")
    name = gains.events[0].name
    system = UncertainGeneralSystem(gains, tuple(sizes.evidence["before"][name]))
    verdict = proved_width(system, proposed)
    if verdict.outcome != "proved":
        return verdict
    own = {part: verdict.evidence[part][name] for part in ("before", "after")}
    kept = {part: sizes.evidence[part] for part in ("cells", "tube")}
    kept["before"] = sizes.evidence["before"][name]
    return proved(**{**verdict.evidence, **own}, sizes=kept)


def _with_curves(system: UncertainAdditiveSystem, proposed: Entries) -> Verdict:
    """The tube of the body, proved, and the curves beside it."""
    if reason := system.reason_against():
        return undecided(reason)
    verdict = proved_width(system, proposed)
    if verdict.outcome != "proved":
        return verdict
    body, curves, name = verdict.evidence, system.curves, system.event.name
    with_curves = {
        "always": _plus(body["always"], curves.always),
        "before": _plus(body["before"][name], curves.before),
        "after": _plus(body["after"][name], curves.always),
    }
    return proved(**{**body, **with_curves, "body": body["always"]})


def _plus(body: list[float], half: Matrix) -> list[float]:
    """Width of a body and of curves, rounded up."""
    total: list[float] = np.nextafter(np.array(body) + 2 * half, np.inf).tolist()
    return total


def uncertain_guarantees(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on."""
    verdicts = {claim.id: claim.verdict for claim in claims}
    enclosure = Guarantee.from_verdicts(_ENCLOSURE, ["consistent"], verdicts)
    evidence = next((claim.evidence for claim in claims if claim.id == "late_width"), None)
    if evidence is None or verdicts["late_width"] != "proved":
        return (enclosure,)
    sentence = _width_sentence(evidence, problem.plant)
    width = Guarantee.from_verdicts(sentence, ["late_width"], verdicts)
    return (
        enclosure, width, Guarantee.from_verdicts(ROUNDED_WIDTHS, ["late_width"], verdicts)
    )  # fmt: skip


def uncertain_warnings(problem: Problem, claims: tuple[Claim, ...]) -> tuple[str, ...]:
    """Why no width of several events is claimed, or a sentence on inputs without a bound."""
    verdicts = {claim.id: claim.verdict for claim in claims}
    if "late_width" not in verdicts:
        reason = reason_against_events(events_of(problem.plant), sensors_of(problem.plant))
        return () if reason is None else (f"No width of the bounds is guaranteed: {reason}.",)
    if verdicts["late_width"] == "proved" and _has_unit_inputs(problem.plant):
        return (_UNIT_INPUTS.format(_uncertain(problem.plant).name),)
    return ()


def _width_sentence(evidence: Entries, plant: Plant) -> str:
    name = _uncertain(plant).name
    words = {
        "always": "farther than time_error from every stamp",
        "before": f"just before {name} may happen",
        "after": "once it has happened",
    }
    parts = [
        f"({', '.join(six_digits(x, ROUND_CEILING) for x in evidence[part])}) {text}"
        for part, text in words.items()
    ]
    return (
        f"Asymptotically the width of the bounds is at most {', '.join(parts)}{_inputs(plant)}. "
        f"While {name} may have happened or not, the bounds contain the states of both cases."
    )
