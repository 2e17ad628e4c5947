"""Interval observers: every hypothesis of Theorems 5, 7 and 8 about given gains, proved.

Source: Degue, Efimov, Richard, NOLCOS 2016. The claims speak about the stored binary64 numbers:
A - L C and G - M C are formed in exact rationals. A split that was stored rounded is completed
to an exact one (`splits.completed_split`), and stability is proved for the completed pair.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, EntriesByClaim
from lmi.arithmetic.balls import exact, inverse
from lmi.prove.hurwitz import prove_hurwitz
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.document import Claim
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.splits import in_coordinates
from obsdesign.equations.interval.width import Coordinates, WidthSystem, error_matrices
from obsdesign.problem.problem import Problem
from obsdesign.verification.dwell import Dwell, dwell_stability, source_of
from obsdesign.verification.gain_constraints import constraint_claims
from obsdesign.verification.interval.agreement import agreed_gains
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
from obsdesign.verification.interval.sourced_width import sourced_claims
from obsdesign.verification.interval.state_box import nominal_in_box
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
    nominal, box_claims = nominal_in_box(problem, certificates)
    if nominal is None:
        return box_claims
    uncertain, problem = problem, nominal.problem
    agreement, gains = agreed_gains(problem, stored, nominal.entries)
    if gains is None or agreement.verdict != "proved":
        return (agreement,)
    source = f"{PAPER}, {THEOREMS[gains.form]}"
    hypotheses = (agreement, *box_claims, *_hypotheses(problem, gains, source))
    if not nominal.is_bounded:
        sourced = sourced_claims(uncertain, gains, certificates, paranoid)
        return with_hints(problem, (*hypotheses, *sourced))
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
