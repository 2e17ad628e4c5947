"""What a design of an unknown-input observer promises, in sentences, and what it does not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from obsdesign.document import Claim
from obsdesign.equations.unknown_input import matrices as equations
from obsdesign.problem.problem import Problem

Sentence = dict[str, Any]


def sentences(problem: Problem, found: tuple[Claim, ...]) -> tuple[Sentence, ...]:
    """Guarantees of a design: {"statement", "given", "claims"} each."""
    claims = {claim.id: claim for claim in found}
    needed = ["rank", "zeros", "observer_equations", "hurwitz", "rounding"]
    given = all(claims[name].verdict == "proved" for name in needed if name in claims)
    given = given and set(needed) <= set(claims)
    result = [
        {
            "statement": "Without noise, disturbance and jumps the estimate of the state tends to "
            "x, and that of the unknown input to its mean over each sampling interval, up to the "
            "curvature of y within an interval (the trapezoid rule stands in for it)"
            f"{_rounding(claims)}.",
            "given": given,
            "claims": needed,
        },
        {
            "statement": "Bounded noise and disturbance leave both errors bounded, for any "
            "sequence of sampling intervals between two positive bounds.",
            "given": given,
            "claims": needed,
        },
    ]
    if "zeros" in claims:
        result += _about_zeros(claims["zeros"])
    if "hurwitz" in claims:
        result += _about_steps(problem, claims["hurwitz"])
    return tuple(result)


def _rounding(claims: Mapping[str, Claim]) -> str:
    """What the stored matrices leave for ever."""
    found = claims["rounding"].evidence.get("bounds") if "rounding" in claims else None
    if found is None:
        return ""
    return (
        f" and to the rounding of the stored matrices: {_up(found['state'])} of the largest state "
        f"and {_up(found['input'])} of the largest input, in units that balance the plant"
    )


def _up(value: float) -> str:
    """One digit, not below the value."""
    if not 1e-20 < value < math.inf:
        return "1e-20" if value <= 1e-20 else "inf"
    power = math.floor(math.log10(value))
    digit = math.ceil(value / 10.0**power)
    return f"{digit}e{power}" if digit < 10 else f"1e{power + 1}"


def _about_zeros(claim: Claim) -> list[Sentence]:
    told, evidence = [], claim.evidence
    if zeros := evidence.get("zeros"):
        text = ", ".join(f"{re:.6g}" + (f" +- {im:.6g}i" if im else "") for re, im in zeros)
        told.append(
            _given_by(
                claim,
                f"The poles include the invariant zeros {text}, which no gain moves; errors along "
                "them decay at their own rate.",
            )
        )
    if mode := evidence.get("nearly"):
        text = f"{mode['real']:.6g}" + (f" +- {mode['imag']:.6g}i" if mode["imag"] else "")
        told.append(
            _not_given(
                f"It survives rounding of the plant: s = {text} is within {mode['margin']:.1g} of "
                "being an invariant zero that does not decay."
            )
        )
    return told


def _about_steps(problem: Problem, claim: Claim) -> list[Sentence]:
    """h |f| <= 2 for every pole f: no ringing."""
    fastest, h = float(claim.evidence.get("approx_fastest", 0.0)), problem.plant.output.period
    if h is None or not math.isfinite(fastest):
        return []
    product = h * fastest
    limit = equations.STEP_LIMIT
    text = f"h |f| = {product:.3g} for the period h = {h:g} and the fastest pole f"
    if product <= limit:
        return [_given_by(claim, f"The steps do not ring: {text} is at most {limit:g}.")]
    return [
        _not_given(
            f"The steps do not ring: {text} exceeds {limit:g}, so that errors alternate from row "
            "to row. Is the period in the time unit of flow.A? Else choose slower poles."
        )
    ]


def _given_by(claim: Claim, statement: str) -> Sentence:
    return {"statement": statement, "given": claim.verdict == "proved", "claims": [claim.id]}


def _not_given(statement: str) -> Sentence:
    return {"statement": statement, "given": False, "claims": []}
