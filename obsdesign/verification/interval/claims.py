"""Interval observers: every hypothesis of Theorems 5, 7 and 8 about given gains, proved.

Source: Degue, Efimov, Richard, NOLCOS 2016. The claims speak about the stored binary64 numbers:
A - L C and G - M C are formed in exact rationals. A split that was stored rounded is completed
to an exact one (`splits.completed_split`), and stability is proved for the completed pair.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, EntriesByClaim, NewEntries, Value
from lmi.arithmetic.balls import exact, inverse
from lmi.prove.hurwitz import prove_hurwitz
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.interval.requirements import large_gain, open_forms, reason_against
from obsdesign.document import Claim
from obsdesign.entries import is_number
from obsdesign.equations.estimation_error import idle_gains
from obsdesign.equations.gains import plant_data
from obsdesign.equations.interval.gains import IntervalGains, shaped_data
from obsdesign.equations.interval.splits import in_coordinates
from obsdesign.equations.interval.width import Coordinates, WidthSystem, error_matrices
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.consistency import consistent_gains
from obsdesign.verification.dwell import (
    Dwell,
    dwell_stability,
    reason_against_problem,
    source_of,
)
from obsdesign.verification.gain_constraints import constraint_claims
from obsdesign.verification.interval.obstruction import obstruction_claim, with_hints
from obsdesign.verification.interval.sampled import at_any_spacing, samples_claim, spacing_claim
from obsdesign.verification.interval.several_clocks import clocked_claims
from obsdesign.verification.interval.signs import (
    FLOW,
    JUMP,
    SplitMatrix,
    metzler_claim,
    nonnegative_claim,
    split_claim,
)
from obsdesign.verification.interval.uncertain_width import uncertain_claims
from obsdesign.verification.interval.width import limit_claim, width_claim
from obsdesign.verification.rates import rates_claim

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
    stored: Entries,
    certificates: EntriesByClaim,
    *,
    paranoid: bool = False,
    budget: TimeBudget = UNLIMITED,
) -> tuple[Claim, ...]:
    """All hypotheses of the design's theorem, each with its verdict.

    stored: gains as a design file states them. certificates: {"dwell_stability": {"P": n x n}}
    where one was found; they are checked.
    """
    del budget  # proofs end by their number of boxes
    if problem.plant.uncertain_events:
        return uncertain_claims(problem, stored, certificates)
    if problem.plant.needs_clock_gains:
        return clocked_claims(problem, stored, certificates)
    agreement, gains = consistent_gains(
        _reason_against(problem), stored, expected_gains(problem, stored),
        IntervalGains.from_document,
    )  # fmt: skip
    if gains is None:
        return (agreement,)
    agreement = _invertible(gains, _within_limit(problem, gains, agreement))
    if agreement.verdict != "proved":
        return (agreement,)
    agreement = _marked(gains, agreement)
    source = f"{PAPER}, {THEOREMS[gains.form]}"
    hypotheses = (agreement, *_hypotheses(problem, gains, source))
    system = WidthSystem.from_gains(gains, exact, inverse)
    if gains.is_periodic:
        proposed = certificates.get("sampled_stability", {})
        sampled = samples_claim(system, gains, proposed, f"{source}; samples as jumps")
        return with_hints(problem, (*hypotheses, sampled))
    if system.N is None:
        return (*hypotheses, *_claims_without_jumps(problem, system, gains, certificates))
    width = width_claim(system, gains.dwell_range, certificates.get("width", {}), source)
    stability = _jump_claims(system, gains, certificates, paranoid)
    spacing = _spacing(problem, system, gains, certificates, width)
    return with_hints(problem, (*hypotheses, *stability, *width, *spacing))


def _marked(gains: IntervalGains, agreement: Claim) -> Claim:
    """The claim that gains and problem agree, with a mark where they do not use the sensor."""
    if gains.L.any() or gains.M.any():
        return agreement
    return replace(agreement, evidence={**agreement.evidence, "zero_gains": True})


def _claims_without_jumps(
    problem: Problem, system: WidthSystem, gains: IntervalGains, certificates: EntriesByClaim
) -> tuple[Claim, ...]:
    """Stability, limit of the width and step limit of a plant without jumps."""
    source = f"{PAPER}, {THEOREMS[gains.form]}"
    width = limit_claim(system, certificates.get("width", {}), source)
    stability = _hurwitz_claim(system.W, "there are no jumps")
    return (stability, *width, *_spacing(problem, system, gains, certificates, width))


def _hypotheses(problem: Problem, gains: IntervalGains, source: str) -> Iterator[Claim]:
    """Claims of gains as they are: constraints on them, what no gains can do, and signs."""
    yield from constraint_claims(problem, gains, {"L": gains.L, "M": gains.M})
    yield from obstruction_claim(problem, gains, source)
    yield from sign_claims(gains)


def _jump_claims(
    system: WidthSystem,
    gains: IntervalGains,
    certificates: EntriesByClaim,
    paranoid: bool,
) -> tuple[Claim, ...]:
    """Stability and rates of the width of a plant with jumps."""
    low, high = gains.dwell_range
    jitter = math.inf if gains.dwell_jitter is None else gains.dwell_jitter
    dwell, N = Dwell(low, high, jitter), system.at_jumps[0]
    decay = [_hurwitz_claim(system.W, "there is no longest dwell time")] if math.isinf(high) else []
    certificate = certificates.get("dwell_stability", {})
    stability = _stability_claim(gains.form, system, dwell, certificate, paranoid)
    source = f"{PAPER}, {THEOREMS[gains.form]}"
    rates = rates_claim(system.W, N, dwell, certificates, source)
    return (*decay, stability, *rates)


def _spacing(
    problem: Problem,
    system: WidthSystem,
    gains: IntervalGains,
    certificates: EntriesByClaim,
    width: tuple[Claim, ...],
) -> tuple[Claim, ...]:
    """Claim of a step limit of a continuous y, if one is proposed; none is needed with L = 0."""
    if problem.plant.output.measured != "continuous":
        return ()
    if not np.any(gains.L):
        return tuple(at_any_spacing(claim) for claim in width)
    source = f"{PAPER}, {THEOREMS[gains.form]}; slope scheme of docs/interval.md"
    return spacing_claim(system, gains, certificates.get("sampled_width", {}), source)


def dwell_pair(stored: Entries) -> tuple[Array, Array | None]:
    """(W, N), exact: the pair whose stability over a range of dwell times is claimed."""
    system = WidthSystem.from_gains(IntervalGains.from_document(stored), exact, inverse)
    return system.W, system.N


def _within_limit(problem: Problem, gains: IntervalGains, agreement: Claim) -> Claim:
    """The claim of consistency, refuted if a gain exceeds the limit of the problem."""
    large = large_gain(gains.L, gains.M, problem.options_as(IntervalOptions).gain_limit)
    if large is None:
        return agreement
    return _refuted(agreement, large.entry("gains"), large.reason("gains"))


def _invertible(gains: IntervalGains, agreement: Claim) -> Claim:
    """The claim of consistency, refuted if coordinates are singular."""
    if agreement.verdict != "proved":
        return agreement
    for name, S in (("gains.S", gains.S), ("gains.S2", gains.S2)):
        if S is not None and inverse(exact(S)) is None:
            return _refuted(agreement, name, f"{name} is singular")
    return agreement


def _refuted(agreement: Claim, entry: str, reason: str) -> Claim:
    evidence = {"witness": {"entry": entry, "reason": reason}}
    return replace(agreement, verdict="refuted", evidence=evidence)


def sign_claims(gains: IntervalGains) -> list[Claim]:
    """`flow_positive` and `jump_positive`: the hypotheses of the enclosure."""
    form = gains.form
    frame = Coordinates.from_matrices(gains.S, gains.S2, inverse, exact)
    F, H = error_matrices(gains, exact)
    F = frame.similar(F)
    source = f"{PAPER}, {THEOREMS[form]}"
    flow, jump = "A" if gains.is_periodic else "A - L C", "the jump matrix of the error, H,"
    D0, D1 = exact(gains.D0), exact(gains.D1)
    if H is not None and gains.T is not None:
        H2 = in_coordinates(H, frame.S2, frame.S2_inverse)
        return [metzler_claim(F, D0, D1, source), nonnegative_claim(exact(gains.T), H2, source)]
    if form == "coordinates":
        flow, jump = f"S^-1 ({flow}) S", "S^-1 H S, H the jump matrix of the error,"
    claims = [split_claim(FLOW, form, flow, SplitMatrix(F, D0, D1), source)]
    if H is not None:
        Gp, Gn = (exact(half) for half in gains.jump_split)
        matrix = SplitMatrix(frame.similar(H), Gp, Gn)
        claims.append(split_claim(JUMP, form, jump, matrix, source))
    return claims


def _reason_against(problem: Problem) -> str | None:
    """Reason against an interval observer for the problem, or None."""
    reason = reason_against(problem)
    is_periodic = problem.plant.output.measured == "periodic"
    reason = reason or (None if is_periodic else reason_against_problem(problem))
    return reason or problem.reason_without_noise_bound()


def expected_gains(problem: Problem, stored: Entries) -> NewEntries:
    """Entries of the stored gains, each with the value that the problem fixes, or its shape.

    The form that they name decides which entries there are.
    """
    plant, form = problem.plant, stored.get("form")
    n, p = plant.n, plant.p
    forms = set(open_forms(problem))
    expected: NewEntries = {"form": forms} | plant_data(plant)
    if plant.output.measured == "periodic":
        expected |= {"period": plant.output.period}
    elif _has_step_limit(problem, stored):  # `sampled_width` is about this limit, and no other
        expected |= {"step_limit": stored.get("step_limit")}
    if "dwell_time" in expected and _is_wider(problem, stored.get("dwell_time")):
        expected |= {"dwell_time": stored.get("dwell_time")}
    expected |= {"L": (n, p), "M": (n, p), "D0": (n, n), "D1": (n, n)}
    if form == "two_coordinates":
        expected |= {"S": (n, n), "S2": (n, n), "T": (n, n)}
    elif plant.jump is not None:
        expected |= {"Gp": (n, n), "Gn": (n, n)}
    if form == "coordinates":
        expected |= {"S": (n, n)}
    expected |= {name: value for name, value in shaped_data(plant).items() if name in stored}
    zeros = {name: np.zeros((n, p)) for name in idle_gains(plant)}
    given = dict(problem.gains)
    if (R := given.pop("R", None)) is not None:  # R is stored as D0; S and S2 are built for it
        given |= {"D0": R, "D1": 0 * R}
    return expected | given | zeros


def _has_step_limit(problem: Problem, stored: Entries) -> bool:
    """Does the problem name the spacing of a continuous y that is used between jumps?"""
    output = problem.plant.output
    named = output.measured == "continuous" and output.period is not None
    has_limit = is_number(stored.get("step_limit"))
    return named and has_limit and bool(np.any(stored.get("L", 0.0)))


def _is_wider(problem: Problem, dwell_time: Value) -> bool:
    """Does the range of a search for the shortest dwell time hold the one of the problem?"""
    if problem.options_as(IntervalOptions).objective != "shortest_dwell" or np.shape(
        dwell_time
    ) != (2,):
        return False
    low, high = problem.require_dwell_time()
    return bool(0.0 <= dwell_time[0] <= low and dwell_time[1] == high)


def _hurwitz_claim(W: Array, why: str) -> Claim:
    verdict = prove_hurwitz(W)
    return Claim.from_verdict(
        "hurwitz",
        f"the width between jumps decays by itself (W = D0 + D1 is Hurwitz), needed as {why}",
        f"{PAPER}, Corollary 4, with the hypothesis it needs when T_max is infinite",
        verdict,
    )


def _stability_claim(
    form: str,
    system: WidthSystem,
    dwell: Dwell,
    certificate: Entries,
    paranoid: bool,
) -> Claim:
    """Inequality (5), or (10) on the n-dimensional pair, for all dwell times in the range."""
    verdict = dwell_stability(system.W, system.at_jumps[0], dwell, certificate, paranoid)
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
