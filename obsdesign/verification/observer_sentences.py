"""What a design of an unknown-input observer promises, in sentences, and what it does not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from obsdesign.document import Claim
from obsdesign.equations import unknown_input as equations
from obsdesign.problem import Problem

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
        result += _about_zeros(claims["zeros"].evidence)
    if "hurwitz" in claims:
        result += _about_steps(problem, claims["hurwitz"].evidence)
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


def _about_zeros(evidence: Mapping[str, Any]) -> list[Sentence]:
    told = []
    if zeros := evidence.get("zeros"):
        text = ", ".join(f"{re:.6g}" + (f" +- {im:.6g}i" if im else "") for re, im in zeros)
        told.append(_plain(f"The poles include the invariant zeros {text}, which no gain moves; "
                           "errors along them decay at their own rate.", True))  # fmt: skip
    if mode := evidence.get("nearly"):
        text = f"{mode['real']:.6g}" + (f" +- {mode['imag']:.6g}i" if mode["imag"] else "")
        told.append(
            _plain(
                f"It survives rounding of the plant: s = {text} is within {mode['margin']:.1g} of "
                "being an invariant zero that does not decay.",
                False,
            )
        )
    return told


def _about_steps(problem: Problem, evidence: Mapping[str, Any]) -> list[Sentence]:
    """h |f| <= 2 for every pole f: no ringing."""
    fastest, h = float(evidence.get("approx_fastest", 0.0)), problem.plant.output.period
    if h is None or not math.isfinite(fastest):
        return []
    product = h * fastest
    limit = equations.STEP_LIMIT
    text = f"h |f| = {product:.3g} for the period h = {h:g} and the fastest pole f"
    if product <= limit:
        return [_plain(f"The steps do not ring: {text} is at most {limit:g}.", True)]
    return [
        _plain(
            f"The steps do not ring: {text} exceeds {limit:g}, so that errors alternate from row "
            "to row. Is the period in the time unit of flow.A? Else choose slower poles.",
            False,
        )
    ]


def _plain(statement: str, given: bool) -> Sentence:
    return {"statement": statement, "given": given, "claims": []}
