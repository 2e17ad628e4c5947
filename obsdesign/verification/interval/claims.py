"""Interval observers: every hypothesis of Theorems 5, 7 and 8 about given gains, proved.

Source: Degue, Efimov, Richard, NOLCOS 2016. The claims speak about the stored binary64 numbers:
A - L C and G - M C are formed in exact rationals. A split that was stored rounded is completed
to an exact one (`equations.completed_split`), and stability is proved for the completed pair.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, inverse
from lmi.prove.hurwitz import prove_hurwitz
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import idle_gains, plant_data
from obsdesign.equations.interval import splits as equations
from obsdesign.equations.interval.width import Coordinates, WidthSystem, width_system_of
from obsdesign.problem.problem import Problem
from obsdesign.verification.consistency import consistency
from obsdesign.verification.dwell import (
    Dwell,
    dwell_stability,
    source_of,
    unusable,
)
from obsdesign.verification.interval.guarantees import guarantees
from obsdesign.verification.interval.obstruction import explained, obstruction_claim
from obsdesign.verification.interval.sampled import at_any_spacing, samples_claim, spacing_claim
from obsdesign.verification.interval.signs import metzler_claim, nonnegative_claim, split_claim
from obsdesign.verification.interval.width import limit_claim, width_claim
from obsdesign.verification.rates import rates_claim

__all__ = ["claims", "dwell_pair", "expected_gains", "guarantees"]

_MATRICES = ("A", "C", "G", "L", "M", "D0", "D1", "Gp", "Gn", "S", "S2", "T")
PAPER = "Degue, Efimov, Richard, NOLCOS 2016"
THEOREMS = {
    "cooperative": "Theorem 5",
    "split": "Theorem 8",
    "coordinates": "Theorems 7 and 8 combined",
    "two_coordinates": "Theorem 7 as corrected",
}
_EQUATIONS = {
    "cooperative": "Assumption 2.i, (5)",
    "split": "Assumption 5, (10)",
    "coordinates": "Assumption 5, (10)",
    "two_coordinates": "(8) with |S^-1 S2| T |S2^-1 S| in place of T",
}


def claims(
    problem: Problem,
    gains: Mapping[str, Any],
    certificates: Mapping[str, Mapping[str, Any]],
    *,
    paranoid: bool = False,
) -> tuple[Claim, ...]:
    """All hypotheses of the design's theorem, each with its verdict.

    certificates: {"dwell_stability": {"P": n x n}} where one was found; it is checked, never
    believed.
    """
    agreement = consistency(_objection(problem), gains, expected_gains(problem, gains))
    if agreement.verdict == "proved":
        agreement = _within_limit(problem, gains, agreement)
    if agreement.verdict == "proved":
        agreement = _invertible(gains, agreement)
    if agreement.verdict != "proved":
        return (agreement,)
    form = gains["form"]
    source = f"{PAPER}, {THEOREMS[form]}"
    found = [agreement, *obstruction_claim(problem, gains, source), *_sign_claims(gains)]
    system = width_system_of(gains, exact, inverse)
    if "period" in gains:
        proposed = certificates.get("sampled_stability", {})
        stability = samples_claim(system, gains, proposed, f"{source}; samples as jumps")
        return explained(problem, (*found, stability))
    if system.N is None:
        found.append(_hurwitz_claim(system.W, "there are no jumps"))
        width = limit_claim(system, certificates.get("width", {}), source)
        return (*found, *width, *_spacing(problem, system, gains, certificates, width))
    low, high = (float(end) for end in gains["dwell_time"])
    dwell = Dwell(low, high, float(gains.get("dwell_jitter", math.inf)))
    if math.isinf(high):
        found.append(_hurwitz_claim(system.W, "there is no longest dwell time"))
    certificate = certificates.get("dwell_stability", {})
    found.append(_stability_claim(form, system, dwell, certificate, paranoid))
    found += rates_claim(system.W, system.N, dwell, certificates, source)
    width = width_claim(system, (low, high), certificates.get("width", {}), source)
    spacing = _spacing(problem, system, gains, certificates, width)
    return explained(problem, (*found, *width, *spacing))


def _spacing(
    problem: Problem,
    system: WidthSystem,
    gains: Mapping[str, Any],
    certificates: Mapping[str, Any],
    width: tuple[Claim, ...],
) -> tuple[Claim, ...]:
    """The step limit of a continuous y, where one was found; none is needed with L = 0."""
    if problem.plant.output.measured != "continuous":
        return ()
    if not np.any(gains["L"]):
        return tuple(at_any_spacing(claim) for claim in width)
    low, high = gains.get("dwell_time", (math.inf, math.inf))
    source = f"{PAPER}, {THEOREMS[gains['form']]}; slope scheme of docs/interval.md"
    ends = (float(low), float(high))
    return spacing_claim(system, gains, ends, certificates.get("sampled_width", {}), source)


def dwell_pair(gains: Mapping[str, Any]) -> tuple[Any, Any]:
    """(W, N), exact: the pair whose stability over a range of dwell times is claimed."""
    system = width_system_of(gains, exact, inverse)
    return system.W, system.N


def _within_limit(problem: Problem, gains: Mapping[str, Any], agreement: Claim) -> Claim:
    """The claim of consistency, refuted if a gain exceeds the limit that was asked for."""
    reason = equations.limit_objection(gains, problem.options, "gains")
    if reason is None:
        return agreement
    entry = reason.split(",")[0]
    evidence = {"witness": {"entry": entry, "reason": reason}}
    return replace(agreement, verdict="refuted", evidence=evidence)


def _invertible(gains: Mapping[str, Any], agreement: Claim) -> Claim:
    """The claim of consistency, refuted if coordinates are singular."""
    for name in ("S", "S2"):
        if name in gains and inverse(exact(gains[name])) is None:
            entry = f"gains.{name}"
            evidence = {"witness": {"entry": entry, "reason": f"{entry} is singular"}}
            return replace(agreement, verdict="refuted", evidence=evidence)
    return agreement


def _sign_claims(gains: Mapping[str, Any]) -> list[Claim]:
    """`flow_positive` and `jump_positive`: the hypotheses of the enclosure."""
    form, periodic = gains["form"], "period" in gains
    numbers = {name: exact(gains[name]) for name in _MATRICES if name in gains}
    frame = Coordinates.of(numbers, inverse)
    F, H = equations.flow_and_jump(numbers, gains["jump_measurement"], periodic)
    F = equations.in_coordinates(F, frame.S, frame.S_inverse)
    source = f"{PAPER}, {THEOREMS[form]}"
    flow, jump = "A" if periodic else "A - L C", "the jump matrix of the error, H,"
    if H is not None and form == "two_coordinates":
        H2 = equations.in_coordinates(H, frame.S2, frame.S2_inverse)
        return [metzler_claim(F, numbers, source), nonnegative_claim(numbers["T"], H2, source)]
    if form == "coordinates":
        flow, jump = f"S^-1 ({flow}) S", "S^-1 H S, H the jump matrix of the error,"
    found = [split_claim("flow", form, flow, F, numbers, source)]
    if H is not None:
        H = equations.in_coordinates(H, frame.S, frame.S_inverse)
        found.append(split_claim("jump", form, jump, H, numbers, source))
    return found


def _objection(problem: Problem) -> str | None:
    text = equations.objection(problem.plant, problem.gains, problem.options)
    text = text or (None if problem.plant.output.measured == "periodic" else unusable(problem))
    if text is None and problem.plant.output.noise_bound is None:
        text = "output.noise_bound is required by kind 'interval', which promises bounds."
    return text


def expected_gains(problem: Problem, gains: Mapping[str, Any]) -> dict[str, Any]:
    """Entries of `gains` and what the problem says of them: a value, or the shape it must have.

    The form that `gains` names decides which entries there are.
    """
    plant, form = problem.plant, gains.get("form")
    n, p = plant.n, plant.p
    forms = set(equations.forms_asked(problem.gains, problem.options))
    expected: dict[str, Any] = {"form": forms} | plant_data(plant)
    if plant.output.measured == "periodic":
        expected |= {"period": plant.output.period}
    elif _watches_steps(problem, gains):  # `sampled_width` is about this limit, and no other
        expected |= {"step_limit": gains["step_limit"]}
    if "dwell_time" in expected and _wider(problem, gains.get("dwell_time")):
        expected |= {"dwell_time": gains["dwell_time"]}
    expected |= {"L": (n, p), "M": (n, p), "D0": (n, n), "D1": (n, n)}
    if form == "two_coordinates":
        expected |= {"S": (n, n), "S2": (n, n), "T": (n, n)}
    elif plant.jump is not None:
        expected |= {"Gp": (n, n), "Gn": (n, n)}
    if form == "coordinates":
        expected |= {"S": (n, n)}
    zeros = {name: np.zeros((n, p)) for name in idle_gains(plant)}
    return expected | dict(problem.gains) | zeros


def _watches_steps(problem: Problem, gains: Mapping[str, Any]) -> bool:
    """A continuous y whose spacing the problem names, and that is used between jumps."""
    output = problem.plant.output
    named = output.measured == "continuous" and output.period is not None
    return named and "step_limit" in gains and bool(np.any(gains.get("L", 0.0)))


def _wider(problem: Problem, found: Any) -> bool:
    """The range of a search for the shortest dwell time holds the one that was asked for."""
    if problem.options.get("objective") != "shortest_dwell" or np.shape(found) != (2,):
        return False
    low, high = problem.require_dwell_time()
    return bool(0.0 <= found[0] <= low and found[1] == high)


def _hurwitz_claim(W: Any, why: str) -> Claim:
    verdict = prove_hurwitz(W)
    return Claim(
        "hurwitz",
        f"the width between jumps decays by itself (W = D0 + D1 is Hurwitz), needed as {why}",
        f"{PAPER}, Corollary 4, with the hypothesis it needs when T_max is infinite",
        verdict.outcome,
        verdict.evidence,
    )


def _stability_claim(
    form: str,
    system: WidthSystem,
    dwell: Dwell,
    certificate: Mapping[str, Any],
    paranoid: bool,
) -> Claim:
    """Inequality (5), or (10) on the n-dimensional pair, for all dwell times in the range."""
    verdict = dwell_stability(system.W, system.N, dwell, certificate, paranoid)
    jump = "|S^-1 S2| T |S2^-1 S|" if form == "two_coordinates" else "Gp + Gn"
    return Claim(
        "dwell_stability",
        f"the width map w -> e^(W T) N w, W = D0 + D1, N = {jump}, is stable for every sequence "
        f"of dwell times T in {dwell}: one P > 0 has N' e^(W' T) P e^(W T) N < P, or one P for "
        "each window of dwell times has, or one v > 0 has v' e^(W T) N < v' (or a like "
        "inequality), for all of them",
        source_of(verdict, f"{PAPER}, {THEOREMS[form]}, {_EQUATIONS[form]}"),
        verdict.outcome,
        {"dwell_time": [dwell.low, dwell.high], **verdict.evidence},
    )
