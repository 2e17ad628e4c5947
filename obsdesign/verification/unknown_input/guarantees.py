"""Guarantees of an unknown-input observer: the sentences that follow from its claims."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from lmi.arithmetic.arrays import Entries
from obsdesign.analysis.invariant_zeros import NearZero
from obsdesign.document import Claim, Guarantee
from obsdesign.equations.unknown_input.formulas import STEP_LIMIT
from obsdesign.problem.options import UnknownInputOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification import stated_poles
from obsdesign.verification.unknown_input.discrete_time import step_input_guarantees
from obsdesign.verification.unknown_input.steady_state_error import SteadyBounds


def guarantees(problem: Problem, listed: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on."""
    if problem.plant.flow.dt is not None:
        return step_input_guarantees(problem, listed)
    claims = {claim.id: claim for claim in listed}
    verdicts = {claim.id: claim.verdict for claim in listed}
    needed = ["rank", "zeros", "observer_equations", "hurwitz", "rounding"]
    result = [
        Guarantee.from_verdicts(
            "Without noise, disturbance and jumps the estimate of the state tends to "
            "x, and that of the unknown input to its mean over each sampling interval, up to the "
            "curvature of y within an interval (the trapezoid rule stands in for it)"
            f"{_rounding(claims)}.",
            needed,
            verdicts,
        ),
        Guarantee.from_verdicts(
            "Bounded noise and disturbance leave both errors bounded, for any "
            "sequence of sampling intervals between two positive bounds.",
            needed,
            verdicts,
        ),
        *_of_poles(claims, verdicts),
    ]
    product = _step_product(problem, claims)
    if product is not None and product <= STEP_LIMIT:
        sentence = (
            f"The steps do not ring: {_step_words(problem, product)} is at most {STEP_LIMIT:g}."
        )
        result.append(Guarantee.from_verdicts(sentence, ["hurwitz"], verdicts))
    return tuple(result)


def _of_poles(claims: Mapping[str, Claim], verdicts: Mapping[str, str]) -> Iterator[Guarantee]:
    """Sentences on invariant zeros, which are poles, and on poles that the problem states."""
    if zeros := _evidence(claims, "zeros").get("zeros"):
        text = ", ".join(f"{re:.6g}" + (f" +- {im:.6g}i" if im else "") for re, im in zeros)
        sentence = (
            f"The poles include the invariant zeros {text}, which no gain moves; errors along "
            "them decay at their own rate."
        )
        yield Guarantee.from_verdicts(sentence, ["zeros"], verdicts)
    if stated_poles.ID in claims:
        text = claims[stated_poles.ID].statement
        sentence = f"{text[0].upper()}{text[1:]}."
        yield Guarantee.from_verdicts(sentence, [stated_poles.ID], verdicts)


def warnings(problem: Problem, listed: tuple[Claim, ...]) -> tuple[str, ...]:
    """Sentences on weights, zeros that rounding of the plant may destabilise, ringing steps."""
    if problem.plant.flow.dt is not None:
        return ()
    claims = {claim.id: claim for claim in listed}
    sentences = []
    if problem.options_as(UnknownInputOptions).weights:
        sentences.append("That L and N follow from `weights` is not claimed.")
    if near := NearZero.from_evidence(_evidence(claims, "zeros")):
        sentences.append(
            f"Rounding the plant may destroy stability: s = {near} is within {near.margin:.1g} of "
            "being an invariant zero that does not decay."
        )
    product = _step_product(problem, claims)
    if product is not None and product > STEP_LIMIT:
        sentences.append(
            f"The steps ring: {_step_words(problem, product)} exceeds {STEP_LIMIT:g}, so that "
            "errors alternate from row to row. Is the period in the time unit of flow.A? Else "
            "choose slower poles."
        )
    return tuple(sentences)


def _step_product(problem: Problem, claims: Mapping[str, Claim]) -> float | None:
    """h |f| for the period h and the fastest pole f, at most 2 without ringing; None if unknown."""
    h = problem.plant.output.period
    if "hurwitz" not in claims or h is None:
        return None
    fastest = float(_evidence(claims, "hurwitz").get("approx_fastest", 0.0))
    return h * fastest if math.isfinite(fastest) else None


def _step_words(problem: Problem, product: float) -> str:
    h = problem.plant.output.period
    return f"h |f| = {product:.3g} for the period h = {h:g} and the fastest pole f"


def _evidence(claims: Mapping[str, Claim], name: str) -> Entries:
    """The evidence of a claim; {} without such a claim."""
    claim = claims.get(name)
    return {} if claim is None else claim.evidence


def _rounding(claims: Mapping[str, Claim]) -> str:
    """The steady-state error caused by rounding the stored matrices, as part of a sentence."""
    bounds = SteadyBounds.from_evidence(_evidence(claims, "rounding"))
    if bounds is None:
        return ""
    return (
        f" and to the rounding of the stored matrices: {_up(bounds.state)} of the largest state "
        f"and {_up(bounds.input)} of the largest input, in units that balance the plant"
    )


def _up(value: float) -> str:
    """One digit, not below the value."""
    if not 1e-20 < value < math.inf:
        return "1e-20" if value <= 1e-20 else "inf"
    power = math.floor(math.log10(value))
    digit = math.ceil(value / 10.0**power)
    return f"{digit}e{power}" if digit < 10 else f"1e{power + 1}"
