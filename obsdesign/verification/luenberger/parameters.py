"""Claims, guarantees and warnings of point observers of plants with parameters.

Proved of the nominal error, every parameter in the middle of its range: it decays. What parameters
add vanishes as x does; where x stays in a known box, the error comes to `error_bound` at most, an
ultimate bound. That the plant by itself is stable is claimed where it is proved, and required where
both gains are zero.
"""

from __future__ import annotations

from dataclasses import replace

from lmi.arithmetic.arrays import Entries, EntriesByClaim
from obsdesign.analysis.luenberger.driven_error import driven_error, reason_against_error_bound
from obsdesign.analysis.nominal import concerns_plant_alone
from obsdesign.document import Claim, Guarantee
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.errors import DoesNotApply
from obsdesign.problem.problem import Problem
from obsdesign.verification.absent_signals import absent_signals
from obsdesign.verification.assumptions import STATE_BOX, is_bounded, under_assumptions
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.luenberger.error_bound import (
    ID as ERROR_BOUND,
)
from obsdesign.verification.luenberger.error_bound import bound_sentence, error_bound_claim
from obsdesign.verification.luenberger.robust_stability import (
    ID as ROBUST,
)
from obsdesign.verification.luenberger.robust_stability import (
    INSTABILITY,
    instability_claim,
    robust_claim,
)
from obsdesign.verification.parameter_ranges import parameter_ranges
from obsdesign.verification.state_box import state_box

_NOMINAL = ("hurwitz", "dwell_stability")
_ADDED = (ROBUST, INSTABILITY, STATE_BOX, ERROR_BOUND)


def uncertain_claims(
    problem: Problem, nominal: tuple[Claim, ...], stored: Entries, certificates: EntriesByClaim
) -> tuple[Claim, ...]:
    """The claims about the nominal plant, as such, and those about the uncertain one."""
    middle = "with every parameter in the middle of its range, "
    named = tuple(
        replace(claim, statement=middle + claim.statement) if claim.id in _NOMINAL else claim
        for claim in nominal
        if claim.id != "rates"  # of an error that nothing drives
    )
    if nominal[0].verdict != "proved":
        return named
    gains = LuenbergerGains.from_document(stored)
    return (*named, *_stability(problem, certificates), *_bounds(problem, gains, certificates))


def _stability(problem: Problem, certificates: EntriesByClaim) -> tuple[Claim, ...]:
    """Claims about the plant by itself: what a certificate is of, or what the problem is about."""
    if ROBUST in certificates or concerns_plant_alone(problem):
        return (robust_claim(problem, certificates.get(ROBUST, {})),)
    return instability_claim(problem, certificates.get(INSTABILITY, {}))


def _bounds(
    problem: Problem, gains: LuenbergerGains, certificates: EntriesByClaim
) -> tuple[Claim, ...]:
    """Claims on the box of the state and on the error in it; none without a proposal."""
    plant, proposed = problem.plant, certificates.get(ERROR_BOUND, {})
    if not proposed or reason_against_error_bound(problem):
        return ()
    try:
        box_claims, bounds = state_box(plant, certificates.get(STATE_BOX, {}))
        if bounds is None:
            return ()
        error = driven_error(plant, gains, bounds)
    except DoesNotApply:  # a known input without a bound
        return ()
    dwell = None if plant.jump is None else Dwell.from_problem(problem)
    within = "in [state]" if plant.state is not None else "in the box of `state_box`"
    noise = "noise" if plant.output.noise_bound is not None else "no noise"
    drive = (
        f"for every course of the parameters in their ranges, x {within}, with disturbance inside "
        f"its bounds and {noise}"
    )
    return (*box_claims, *error_bound_claim(error, dwell, proposed, drive))


def uncertain_guarantees(
    problem: Problem, claims: tuple[Claim, ...], needed: list[str], measured: str, when: str
) -> tuple[Guarantee, ...]:
    """Sentences about the error of an uncertain plant.

    needed: claims of stability; measured, when: parts of sentences.
    """
    plant = problem.plant
    ranges, free = f"Assumed: {parameter_ranges(plant)}.", absent_signals(plant)
    verdicts = {claim.id: claim.verdict for claim in claims}
    nominal = [name for name in needed if name not in _ADDED]
    vanishing, bounded = "the state does", "A bounded state"
    if _has_uncertain_inputs(problem):  # their effect does not vanish as x does
        vanishing, bounded = "state and known inputs do", "Bounded state, known inputs"
    sentences = [
        (f"Without {free}, the estimation error tends to zero{when}, if {vanishing}.",
         nominal),
        (f"{bounded} and bounded {free} leave the estimation error bounded{when}.",
         nominal),
    ]  # fmt: skip
    if ROBUST in verdicts:
        both = [*nominal, ROBUST]
        sentences.append(
            (f"Bounded inputs, {free} leave state and estimation error bounded{when}.",
             both)
        )  # fmt: skip
        if not _is_driven(problem):
            text = f"Without {free}, state and estimation error tend to zero{when}."
            sentences.insert(0, (text, both))
    given = tuple(
        Guarantee.from_verdicts(text, ids, verdicts).under(ranges) for text, ids in sentences
    )
    bounds = tuple(
        Guarantee.from_verdicts(text, [*nominal, *ids], verdicts)
        for text, ids in bound_sentence(claims, measured, plant.output.noise_bound is not None)
    )
    return (*under_assumptions(plant, claims, bounds), *given)


def uncertain_warnings(problem: Problem, claims: tuple[Claim, ...]) -> tuple[str, ...]:
    """Sentences on a plant that is not proved stable by itself, and on an error without a bound."""
    listed = {claim.id: claim for claim in claims}
    if len(listed) == 1:  # the gains are not those of the problem
        return ()
    sentences = []
    if INSTABILITY in listed:
        reason = listed[INSTABILITY].evidence["witness"]["reason"]
        sentences.append(
            "The plant by itself is not stable for all its parameters, so that the estimation "
            f"error need not tend to zero: {reason}."
        )
    elif ROBUST not in listed:
        sentences.append(
            "The plant by itself is not proved stable for all its parameters; where it is not, the "
            "estimation error need not tend to zero."
        )
    if ERROR_BOUND not in listed:
        sentences.append(f"No bound of the estimation error is claimed: {_missing(problem)}.")
    return tuple(sentences)


def _missing(problem: Problem) -> str:
    """What a bound of the error would need."""
    if reason := reason_against_error_bound(problem):
        return reason.rstrip(".")
    plant = problem.plant
    bounds = {"flow": (plant.flow.B, plant.flow.input_bound)}
    if plant.jump is not None:
        bounds["jump"] = (plant.jump.E, plant.jump.input_bound)
    if plant.state is None or _has_uncertain_inputs(problem):
        for name, (matrix, largest) in bounds.items():
            if matrix is not None and largest is None:
                return f"it needs {name}.input_bound, the largest known input"
    if not is_bounded(plant, ()):
        return "it needs bounds of x, [state]"
    return "none is proved for these gains"


def _has_uncertain_inputs(problem: Problem) -> bool:
    """Does a parameter act on a known input?"""
    keys = {key for each in problem.plant.parameters for key in each.effects}
    return bool(keys & {"B", "E"})


def _is_driven(problem: Problem) -> bool:
    """Has the plant known inputs, or a disturbance around another value than zero?"""
    flow, jump = problem.plant.flow, problem.plant.jump
    bounds = [flow.b_bounds] + ([] if jump is None else [jump.c_bounds])
    is_shifted = any(bool((lower + upper).any()) for lower, upper in bounds)
    return flow.B is not None or (jump is not None and jump.E is not None) or is_shifted
