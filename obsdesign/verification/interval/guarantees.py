"""Guarantees of interval observers, in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from obsdesign.analysis.interval.requirements import objective_of
from obsdesign.document import Claim, Guarantee
from obsdesign.problem.problem import Problem
from obsdesign.verification.assumptions import is_bounded, under_assumptions
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.gain_constraints import constraint_sentences
from obsdesign.verification.interval.discrete_time import step_warnings
from obsdesign.verification.interval.sampled import in_every_period, no_spacing, sampled_sentences
from obsdesign.verification.interval.several_clocks import clocked_guarantees
from obsdesign.verification.interval.sourced_width import sourced_sentences
from obsdesign.verification.interval.uncertain_width import uncertain_guarantees, uncertain_warnings
from obsdesign.verification.interval.width import width_sentence
from obsdesign.verification.rates import DRIVING, rates_sentence
from obsdesign.verification.same_evidence import ROUNDED_WIDTHS
from obsdesign.verification.state_widths import StateWidths, widths_of_claim

_ENCLOSURE = (
    "The bounds contain the state at every instant, if they contain it at the start, {} and "
    "v stay inside their bounds and jumps are reported at their times; this holds for "
    "samples at any spacing, missing ones included, and for any dwell time."
)


def guarantees(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on, and those that were required and not proved."""
    plant = problem.plant
    if plant.uncertain_events:
        return uncertain_guarantees(problem, claims)
    if plant.needs_clock_gains:
        return clocked_guarantees(problem, claims)
    verdicts = {claim.id: claim.verdict for claim in claims}
    enclosing = _present(verdicts, ("consistent", "flow_positive", "jump_positive"))
    at_jumps = plant.output.measured == "at_jumps"
    is_periodic = plant.output.measured == "periodic"
    skips = plant.jump is not None and plant.output.jump_measurement == "none"
    measured = "With y measured at every jump" if at_jumps else "With y measured continuously"
    measured = in_every_period(skips) if is_periodic else measured
    bounded = _present(verdicts, ("hurwitz", "dwell_stability"))
    bounded = ["sampled_stability"] if is_periodic else bounded
    has_input = plant.flow.d_bounds is not None
    absent = "disturbance, noise and effects of parameters" if plant.parameters else DRIVING
    enclosure = _ENCLOSURE.format("b, c, d" if has_input else "b, c")
    sentences = [
        (enclosure, enclosing),
        (_bounded_width(problem, claims, measured), enclosing + bounded),
        *((text, [*enclosing, *ids]) for text, ids in sourced_sentences(claims, measured)),
        *(
            (f"{measured}: {text}", ids)
            for text, ids in rates_sentence(claims, "the width", absent)
        ),
    ]
    sampled = sampled_sentences(claims, skips)
    decaying = _present(verdicts, ("hurwitz",))
    for text, ids in [*width_sentence(claims, measured), *sampled]:
        sentences.append((text, [*enclosing, *decaying, *ids]))
    sentences += constraint_sentences(claims)
    entries = [Guarantee.from_verdicts(text, ids, verdicts) for text, ids in sentences]
    if not (at_jumps or is_periodic or sampled):
        entries.append(Guarantee.not_proved(no_spacing()))
    entries.append(Guarantee.from_verdicts(ROUNDED_WIDTHS, enclosing, verdicts))
    return under_assumptions(plant, claims, tuple(entries))


def warnings(problem: Problem, claims: tuple[Claim, ...]) -> tuple[str, ...]:
    """Sentences on clocks without a graph, and on gains that are all zero."""
    if problem.plant.uncertain_events:
        return uncertain_warnings(problem, claims)
    if problem.plant.flow.dt is not None:
        verdicts = {claim.id: claim.verdict for claim in claims}
        is_open = verdicts["consistent"] == "proved" and "event_stability" not in verdicts
        return step_warnings(problem.plant) if is_open else ()
    if not any(claim.evidence.get("zero_gains") for claim in claims):
        return ()
    if "L" in problem.gains:
        other = "without gains.L and gains.M the narrowest bounds are searched for"
    elif objective_of(problem) == "narrowest":
        other = (
            "objective 'narrowest' keeps them only where it finds none with a smaller proved "
            "width, 'feasible' takes the first bounds that stay bounded"
        )
    else:
        other = "objective 'narrowest' chooses gains for the smallest width"
    return (
        "The observer does not use the sensor: L = M = 0, so that every proved width is that of "
        f"the plant alone; at run time only the strip of each sample cuts the bounds; {other}.",
    )


def states(problem: Problem, claims: tuple[Claim, ...]) -> tuple[StateWidths, ...]:
    """Sensor strip and proved width of each state, with samples where a width with them is."""
    if problem.plant.uncertain_events:
        return widths_of_claim(problem, claims, "late_width")
    if problem.plant.needs_clock_gains:
        return widths_of_claim(problem, claims, "event_width")
    rows = widths_of_claim(problem, claims, "sampled_stability", "sampled_width", "width")
    box = problem.plant.state
    if not problem.plant.parameters or box is None:
        return rows
    sizes = (box.upper - box.lower).tolist()  # bounds are cut with the stated box
    return tuple(
        row if row.width is None else replace(row, width=min(row.width, size))
        for row, size in zip(rows, sizes, strict=True)
    )


def _bounded_width(problem: Problem, claims: tuple[Claim, ...], measured: str) -> str:
    when, jumps = "", ""
    if problem.plant.jump is not None:
        when = f" for every sequence of dwell times in {_dwell_range(problem, claims)}"
        jumps = " as jumps go on"
    if not is_bounded(problem.plant, claims):
        return (
            f"{measured}, the width of the bounds stays bounded{when} as long as y, u and w do, "
            "whether the state is bounded or not."
        )
    if problem.plant.parameters:
        return f"{measured}, the width of the bounds stays bounded{when}."
    return (
        f"{measured}, the width of the bounds stays bounded{when}, and without disturbance and "
        f"noise it tends to zero{jumps}."
    )


def _dwell_range(problem: Problem, claims: tuple[Claim, ...]) -> Dwell:
    """The range of dwell times that is claimed."""
    for claim in claims:
        if claim.id == "dwell_stability" and (ends := claim.evidence.get("dwell_time")):
            low, high = ends
            return replace(Dwell.from_problem(problem), low=float(low), high=float(high))
    return Dwell.from_problem(problem)


def _present(verdicts: Mapping[str, str], names: tuple[str, ...]) -> list[str]:
    return [name for name in names if name in verdicts]
