"""Impulsive observers: the hypotheses of Theorem 3.1 for given gains and all spacings.

Source: E. A. Medina, D. A. Lawrence, State Estimation for Linear Impulsive Systems. The claims
speak about the stored binary64 numbers; strong observability is proved with a margin, for every
sequence of spacings in `jump.dwell_time` (Definition 2.3 restricted to it, as its proofs use it).
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, NewEntries
from lmi.arithmetic.balls import exact
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict, overall, proved, refuted, undecided
from obsdesign.analysis.hidden_modes import not_detectable
from obsdesign.analysis.impulsive_noise import estimate, missed_target
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import seen_before_jump
from obsdesign.equations.gains import plant_data
from obsdesign.equations.impulsive.formulas import Core
from obsdesign.equations.impulsive.gains import STRATEGIES, ImpulsiveGains
from obsdesign.problem.options import ImpulsiveOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.choices import mark_witness
from obsdesign.verification.consistency import consistent_gains
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.impulsive.blocks import (
    Blocks,
    Whole,
    in_own_coordinates,
    in_state,
    plant_blocks,
    whole_bound,
)
from obsdesign.verification.impulsive.lyapunov import LyapunovFunction, lyapunov_function
from obsdesign.verification.impulsive.rate import (
    Bound,
    RankProof,
    certified_rate,
    in_balls,
    quadratic_bound,
    robust_to_rounding,
    window_reach,
)
from obsdesign.verification.impulsive.spacing import bounded_spacing, shortest_spacing
from obsdesign.verification.impulsive.statements import (
    decay_claim,
    noise_target,
    nominal_plant,
    rate_claim,
    strongly_observable,
)
from obsdesign.verification.impulsive.uncorrected_blocks import (
    BlockDecay,
    block_decay,
    quadratic_claims,
)


@np.errstate(all="ignore")
def claims(
    problem: Problem,
    stored: Entries,
    certificates: EntriesByClaim,
    *,
    paranoid: bool = False,
    budget: TimeBudget = UNLIMITED,
) -> tuple[Claim, ...]:
    """All hypotheses of the design's theorem, each with its verdict.

    stored: gains as a design file states them; certificates: {"strongly_observable": {"asked"} or
    {"witness"}} and those of the strategies.
    """
    agreement, gains = _agreement(problem, stored)
    if gains is None:
        return (agreement,)
    high = problem.require_dwell_time()[1]
    listed = [agreement, bounded_spacing(high), shortest_spacing(problem)]
    if overall(claim.verdict for claim in listed) == "refuted":
        return tuple(listed)
    if gains.has_window:
        claims, bound = _windowed(problem, gains, certificates, paranoid, budget)
    else:
        claims, bound = quadratic_claims(problem, gains, certificates, paranoid)
    listed += claims
    is_proved = overall(claim.verdict for claim in listed) == "proved"
    bound = bound if is_proved else None
    lyapunov = _lyapunov(problem, gains, listed, certificates) if is_proved else None
    listed += _rate_claims(problem, gains, bound, certificates, lyapunov)
    if certificates.get("noise_target"):
        listed.append(noise_target(missed_target(problem, gains)))
    return tuple(listed)


def _agreement(problem: Problem, stored: Entries) -> tuple[Claim, ImpulsiveGains | None]:
    """The claim that stored gains are those of the problem, and the gains where it is proved."""
    expected = NewEntries()
    objection = problem.reason_unless_measured("at_jumps")
    objection = objection or problem.reason_without("jump.dwell_time")
    if objection is None:
        try:
            expected = _expected(problem, stored, ImpulsiveGains.from_document(stored))
        except ValueError as error:
            objection = str(error).removesuffix(".")
    return consistent_gains(objection, stored, expected, ImpulsiveGains.from_document)


def _rate_claims(
    problem: Problem,
    gains: ImpulsiveGains,
    bound: Bound | None,
    certificates: EntriesByClaim,
    lyapunov: LyapunovFunction | None,
) -> list[Claim]:
    """Claims of the rate that follows from a proved bound, and of the problem's decay rate."""
    high, goal = problem.require_dwell_time()[1], problem.options_as(ImpulsiveOptions).decay_rate
    claims, rate, certificate = list[Claim](), None, certificates.get("rate", {})
    if bound is not None:
        with in_balls():
            rate = certified_rate(bound, high, certificate)
    if rate is not None:
        estimated = estimate(problem, gains) if "estimated" in certificate else None
        claims.append(rate_claim(rate, estimated, lyapunov))
    if goal > 0:
        claims.append(decay_claim(rate, goal, high))
    return claims


def _lyapunov(
    problem: Problem,
    gains: ImpulsiveGains,
    proved_claims: list[Claim],
    certificates: EntriesByClaim,
) -> LyapunovFunction | None:
    """The function of Theorem 2.2, where the certificate of the rate names it (strategy `full`).

    Designs of earlier versions do not.
    """
    certificate = certificates.get("rate", {})
    if gains.strategy != "full" or LyapunovFunction.ENTRY not in certificate:
        return None
    observable = next(claim for claim in proved_claims if claim.id == "strongly_observable")
    rank = RankProof.from_evidence(observable.evidence)
    core, ends = Core.from_gains(gains, exact), problem.require_dwell_time()
    with in_balls():
        proved_now = lyapunov_function(
            core, ends, gains.window_length, gains.window_weight, rank.sigma_min
        )
    stored = LyapunovFunction.from_evidence(certificate)
    if proved_now is None or stored is None or not stored.follows_from(proved_now):
        return proved_now
    return stored


def _windowed(
    problem: Problem,
    gains: ImpulsiveGains,
    certificates: EntriesByClaim,
    paranoid: bool,
    budget: TimeBudget,
) -> tuple[list[Claim], Bound | None]:
    """Claims of a window on the plant or on a part of it, and the bound that follows."""
    low, high = problem.require_dwell_time()
    core, window = Core.from_gains(gains, exact), gains.window_length
    certificate = certificates.get("strongly_observable", {})
    observable = strongly_observable(problem, core, window, certificate, budget)
    claims = [observable]
    own, into = in_own_coordinates(core, low, high, window)
    blocks = plant_blocks(gains, own, into)
    if blocks is None:
        reason = "gains.basis is singular"
        claims.append(nominal_plant(gains, refuted({"entry": "gains.basis", "reason": reason})))
        return claims, None
    rate = problem.options_as(ImpulsiveOptions).decay_rate
    uncorrected, decaying = _uncorrected(problem, blocks, certificates, paranoid)
    claims += uncorrected
    whole = None
    if overall(claim.verdict for claim in claims) == "proved":
        rank = RankProof.from_evidence(observable.evidence)
        with in_balls():
            reach = window_reach(own, (low, high), window, gains.window_weight, rank)
            whole = whole_bound(blocks, reach, decaying, high, rate)
    if gains.strategy != "full":
        claims.append(nominal_plant(gains, _nominal(blocks, whole)))
    if whole is None or claims[-1].verdict != "proved":
        return claims, None
    with in_balls():
        return claims, in_state(whole.bound, blocks)


def _uncorrected(
    problem: Problem, blocks: Blocks, certificates: EntriesByClaim, paranoid: bool
) -> tuple[list[Claim], dict[str, Bound]]:
    """Claims that the blocks without correction decay, and their bounds by name."""
    claims, bounds = list[Claim](), dict[str, Bound]()
    rate = problem.options_as(ImpulsiveOptions).decay_rate
    for name, pair in (("hidden", blocks.hidden_pair), ("rest", blocks.rest_pair)):
        if pair is None:
            continue
        certificate = certificates.get(f"{name}_decays", {})
        claim = block_decay(
            name, pair, Dwell.from_problem(problem), certificate, paranoid=paranoid, rate=rate
        )
        if name == "hidden" and (blocks.is_exact or _is_undetectable(problem)):
            claim = mark_witness(claim)  # the same in every basis
        claims.append(claim)
        decay = BlockDecay.from_evidence(claim.evidence)
        if decay is not None:
            bounds[name] = quadratic_bound(decay.P, decay.factor)
    return claims, bounds


def _nominal(blocks: Blocks, whole: Whole | None) -> Verdict:
    """Decide whether the plant is the nominal one, or near enough to it."""
    if blocks.is_exact:
        return proved(exact=True)
    if whole is None:
        return undecided("it differs from it, and no convergence is proved to absorb that")
    with in_balls():
        return robust_to_rounding(whole.bound, whole.change)


def _is_undetectable(problem: Problem) -> bool:
    """Whether an unobservable part of the state does not decay, exactly."""
    flow, jump, output = problem.plant.flow, problem.plant.jump, problem.plant.output
    assert jump is not None
    C = seen_before_jump(jump.G, output.C, output.jump_measurement)
    return not_detectable(flow.A, jump.G, C, problem.require_dwell_time()) is not None


def _expected(problem: Problem, stored: Entries, gains: ImpulsiveGains) -> NewEntries:
    """The value, or the shape, that the problem requires of each entry of `stored`."""
    n, p = problem.plant.n, problem.plant.p
    options = problem.options_as(ImpulsiveOptions)
    words = set(STRATEGIES) if options.strategy == "auto" else {options.strategy}
    expected: NewEntries = plant_data(problem.plant) | {"strategy": words}
    if not gains.has_window:
        cells = len(gains.gain_table[1])
        return expected | {"cells": (cells + 1,), "table": (cells, n, p)}
    d = n
    if gains.strategy == "subspace":
        columns = gains.core_columns
        d = columns.stop - columns.start
        expected |= {"basis": (n, n), "core_place": (2,)}
        expected |= {"core_A": (d, d), "core_C": (p, d), "core_G": (d, d)}
    if gains.image is not None:
        r = gains.image.shape[1]
        expected |= {"image": (d, r), "coimage": (r, d)}
    own = {"window": options.window, "alpha": options.alpha}
    return expected | {name: stored.get(name) if x is None else x for name, x in own.items()}
