"""Finite-time estimation: what makes the stored gains give the state, proved.

Source: F. Mazenc, S. Ahmed, MICNON 2018, with the corrections of docs/papers.md. Claims come in
the order in which a plant fails: unobservable, badly sampled, too short a window, a singular
matrix of the method, gains that miss what they should. T is k nu for the stored binary64 nu.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.arithmetic.balls import precision
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.document import Claim
from obsdesign.equations.finite_time import gains as equations
from obsdesign.problem.problem import Problem
from obsdesign.verification.choices import mark_witness, open_choices
from obsdesign.verification.consistency import consistency
from obsdesign.verification.finite_time.gains import (
    error_radius_claim,
    invertible,
    of_the_method,
    unbiased,
)
from obsdesign.verification.finite_time.guarantees import guarantees
from obsdesign.verification.finite_time.theorem_1 import bound_claims
from obsdesign.verification.finite_time.window import (
    dead_otherwise,
    long_enough,
    observable,
    sampled_observable,
)

__all__ = ["claims", "guarantees"]

# what a claim rests on beside the plant, where that is not both window and L
_RESTS_ON: Mapping[str, tuple[str, ...]] = {
    "observable": (),
    "sampled_observable": ("window",),
    "window_long_enough": ("window",),
}
# precisions in turn, where the first leaves something open
_BITS = (160, 320)


def claims(
    problem: Problem,
    gains: Mapping[str, Any],
    certificates: Mapping[str, Mapping[str, Any]],
    *,
    paranoid: bool = False,
) -> tuple[Claim, ...]:
    """All hypotheses of the design, in the order of refusal, until one is not proved.

    certificates: coordinates S for the norms of Theorem 1, if any; paranoid
    proves with twice the precision.
    """
    agreement = consistency(_objection(problem), gains, expected_gains(problem, gains))
    if agreement.verdict != "proved":
        return (agreement,)
    S = _coordinates(certificates, problem.plant.n)
    found: list[Claim] = []
    for bits in _BITS[1:] if paranoid else _BITS:
        with precision(bits):
            found = _hypotheses(gains, S)
        if all(claim.verdict != "undecided" for claim in found):
            break
    return (agreement, *(_with_marked_witness(problem, claim) for claim in found))


def _with_marked_witness(problem: Problem, claim: Claim) -> Claim:
    """The claim, its witness marked where no window and no L that is open would change it."""
    L = problem.gains.get("L")
    silent = L is not None and not np.any(L @ problem.plant.output.C)
    singular = claim.id in ("difference_invertible", "injection_invertible")
    names = _RESTS_ON.get(claim.id, ("window", "L"))
    return mark_witness(claim, () if singular and silent else open_choices(problem, *names))


def _coordinates(certificates: Mapping[str, Mapping[str, Any]], n: int) -> Any:
    """S of a certificate, or None where there is none that is an (n, n) matrix of numbers."""
    try:
        S = np.asarray(certificates["theorem_1_coordinates"]["S"], dtype=np.float64)
    except (KeyError, TypeError, ValueError):
        return None
    return S if S.shape == (n, n) and np.isfinite(S).all() else None


def _objection(problem: Problem) -> str | None:
    text = equations.objection(problem.plant, problem.options)
    return text or equations.objective_objection(problem.options, "L" in problem.gains)


def expected_gains(problem: Problem, gains: Mapping[str, Any]) -> dict[str, Any]:
    """Entries of `gains` and what the problem says of them: a value, or the shape it must have."""
    plant, options = problem.plant, problem.options
    method = options.get("method", "least_squares")
    samples: Any = gains.get("samples")
    k = int(samples) if _is_count(samples) else 0
    if "window" in options and equations.objection(plant, options) is None:
        k = equations.window_samples(options["window"], plant.output.period or 1.0)
    expected = equations.stored_plant(plant) | {"method": method, "samples": float(k)}
    expected |= {"window_gain": (plant.n, k * plant.p)}
    if method in equations.NEED_L:
        expected |= {"L": (plant.n, plant.p)}
    if method == "approximate":
        corrected = bool(options.get("half_sample_correction"))
        expected |= {"half_sample": "corrected" if corrected else "printed"}
    else:
        expected |= {"state_error": (plant.n, plant.n)}
        if plant.output.noise_bound is not None:
            expected |= {"radius": (plant.n,)}
        if "reference" in gains:  # without it, the window's end
            expected |= {"reference": {equations.START}}
    if method == "least_squares":
        expected |= {"deviations": equations.relative_deviations(plant.output)}
    return expected | {name: X for name, X in problem.gains.items() if name in expected}


def _is_count(value: Any) -> bool:
    return isinstance(value, int | float) and 1 <= value <= equations.MOST_SAMPLES


def _hypotheses(gains: Mapping[str, Any], S: Any) -> list[Claim]:
    sampled = Sampled.of(
        gains["A"], gains["C"], gains["period"], int(gains["samples"]),
        gains.get("reference", equations.END),
    )  # fmt: skip
    found: list[Claim] = []
    for claim in _in_order(gains, sampled, S):
        found.append(claim)
        if claim.verdict != "proved":
            break
    return found


def _in_order(gains: Mapping[str, Any], sampled: Sampled, S: Any) -> Any:
    yield observable(sampled)
    dead = dead_otherwise(sampled, gains)
    yield sampled_observable(sampled, dead)
    yield long_enough(sampled, dead)
    method = gains["method"]
    if method in equations.NEED_L:
        yield invertible(sampled, gains)
        yield of_the_method(sampled, gains)
    if method == "approximate":
        yield from bound_claims(sampled, gains, S)
        return
    yield unbiased(sampled, gains)
    if "radius" in gains and (np.any(gains["radius"]) or _disturbed(gains)):
        yield error_radius_claim(sampled, gains)
    if method == "exact":
        yield from bound_claims(sampled, gains, S)


def _disturbed(gains: Mapping[str, Any]) -> bool:
    moved = np.any(np.asarray(gains["flow_lower"]) != gains["flow_upper"])
    return bool(moved or np.any(gains["noise_bound"]))
