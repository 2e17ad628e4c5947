"""Point observers with jumps: stability of the error for all dwell times, proved.

Source: C. Briat, Automatica 49 (2013), Theorem 3, applied to (A - L C, G - M C); with an infinite
longest dwell time the flow must be Hurwitz as well (docs/papers.md, Corollary 4 of Degue et al.).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, EntriesByClaim, NewEntries
from lmi.arithmetic.balls import Exact, exact
from lmi.prove.hurwitz import prove_hurwitz
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import overall
from obsdesign.analysis.nominal import counted_inputs, nominal_problem, reason_against_options
from obsdesign.analysis.riccati import faster_rates, riccati_shift
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import idle_gains
from obsdesign.equations.gains import plant_data
from obsdesign.equations.luenberger.error_system import cell_count
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification import stated_poles, stated_weights
from obsdesign.verification.choices import mark_witness
from obsdesign.verification.consistency import consistent_gains, inconsistent
from obsdesign.verification.dwell import Dwell, dwell_stability, reason_against_problem, source_of
from obsdesign.verification.gain_constraints import (
    IDS,
    constraint_claims,
    error_matrix,
    within_structure,
    witness_within_structure,
)
from obsdesign.verification.luenberger.discrete_time import step_claims
from obsdesign.verification.luenberger.parameters import uncertain_claims
from obsdesign.verification.luenberger.schedule import reason_against_borders, scheduled_stability
from obsdesign.verification.rates import rates_claim
from obsdesign.verification.tails import proved_tails

PAPER = "Briat, Automatica 49 (2013), Theorem 3"


def claims(
    problem: Problem,
    stored: Entries,
    certificates: EntriesByClaim,
    *,
    paranoid: bool = False,
    budget: TimeBudget = UNLIMITED,
) -> tuple[Claim, ...]:
    """All hypotheses of the design, each with its verdict.

    stored: gains as a design file states them; certificates: {"dwell_stability": {"P": n x n},
    "decay_rate": {"P": n x n}} or windows in place of P, and "tails"; with parameters also
    "error_bound",
    "state_box", "robust_stability" or "robust_instability"; all are checked.
    """
    del budget  # proofs end by their number of boxes
    if problem.plant.flow.dt is not None:
        return step_claims(problem, stored, certificates, paranoid)
    if not problem.plant.parameters:
        return _claims(problem, stored, certificates, paranoid, {})
    if reason := reason_against_options(problem):
        return (inconsistent(reason),)
    inputs = counted_inputs(problem.plant) if certificates.get("error_bound") else {}
    nominal = _claims(nominal_problem(problem), stored, certificates, paranoid, inputs)
    return uncertain_claims(problem, nominal, stored, certificates)


def _claims(
    problem: Problem,
    stored: Entries,
    certificates: EntriesByClaim,
    paranoid: bool,
    inputs: NewEntries,
) -> tuple[Claim, ...]:
    """Claims about a plant without parameters; inputs: entries that its gains have besides."""
    objection = reason_against_problem(problem) or reason_against_borders(problem, stored)
    agreement, gains = consistent_gains(
        objection, stored, _expected(problem) | inputs, LuenbergerGains.from_document
    )
    if gains is None:
        return (agreement,)
    F, options = error_matrix(gains, "L", gains.L), problem.options_as(LuenbergerOptions)
    shifted = F + exact(options.decay_rate * np.eye(problem.plant.n))
    claims = [
        agreement,
        *_choice_of_L(problem, gains, F),
        *constraint_claims(problem, gains, _stored(gains)),
    ]
    if problem.plant.jump is None:
        claims += _flow_claims(F, shifted, options.decay_rate, certificates)
        return _with_marked_witnesses(problem, shifted, claims)
    if math.isinf(problem.require_dwell_time()[1]):
        claims.append(_hurwitz(F, "hurwitz", "there is no longest dwell time"))
    if options.schedule is not None:
        return (*claims, *_scheduled(problem, gains, F, certificates, paranoid))
    claims += _jump_claims(problem, gains, shifted, certificates, paranoid)
    return _with_marked_witnesses(problem, shifted, claims)


def _flow_claims(
    F: Exact, shifted: Exact, rate: float, certificates: EntriesByClaim
) -> Iterator[Claim]:
    """Claims of an error without jumps; shifted: F + rate I."""
    yield _with_tails(_hurwitz(F, "hurwitz", "there are no jumps"), F, certificates)
    if rate > 0:
        claim = _hurwitz(shifted, "decay_rate", f"decay_rate = {rate!r} is required", rate)
        yield _with_tails(claim, shifted, certificates)


def _with_tails(claim: Claim, F: Exact, certificates: EntriesByClaim) -> Claim:
    """The claim that F is Hurwitz, with those tails of its certificate that show it too."""
    if claim.verdict != "proved":
        return claim
    tails = proved_tails(F, certificates.get(claim.id, {}).get("tails"))
    return replace(claim, evidence={**claim.evidence, **tails})


def _jump_claims(
    problem: Problem,
    gains: LuenbergerGains,
    shifted: Exact,
    certificates: EntriesByClaim,
    paranoid: bool,
) -> Iterator[Claim]:
    """Claims of an error with jumps, for all dwell times; shifted: A - L C + rate I."""
    rate, dwell = problem.options_as(LuenbergerOptions).decay_rate, Dwell.from_problem(problem)
    F, H = error_matrix(gains, "L", gains.L), error_matrix(gains, "M", gains.M)
    yield _stability(F, H, dwell, certificates, paranoid)
    yield from rates_claim(F, H, dwell, certificates, PAPER)
    if rate > 0:
        yield _decay(shifted, H, dwell, certificates, rate=rate, paranoid=paranoid)


def _choice_of_L(problem: Problem, gains: LuenbergerGains, F: Exact) -> Iterator[Claim]:
    """Claims that L is the one that stated poles or weights choose; F = A - L C."""
    plant, options = problem.plant, problem.options_as(LuenbergerOptions)
    must_decay = plant.jump is None or math.isinf(problem.require_dwell_time()[1])
    if options.poles is not None:
        changes = stated_poles.rounding_of_gain(gains.L, gains.C)
        rate = options.decay_rate if must_decay else None
        A = exact(gains.A)
        yield stated_poles.poles_claim(F, options.poles, changes=changes, flow=A, rate=rate)
    if options.weights:
        rates = faster_rates(gains.A, options.decay_rate)
        shifts = [riccati_shift(gains.A, gains.C, rate) for rate in rates]
        yield stated_weights.weights_claim(gains.A, gains.C, gains.L, options.weights, shifts)


def _with_marked_witnesses(
    problem: Problem, shifted: Exact, claims: list[Claim]
) -> tuple[Claim, ...]:
    """The claims, their witnesses marked where a mode or a pair that no gain reaches refutes."""
    own = (*IDS, stated_poles.ID, stated_weights.ID)
    about_error = [claim for claim in claims if claim.id not in own]
    is_refuted = any(claim.verdict == "refuted" for claim in about_error)
    if not (is_refuted and _is_refuted_for_all_gains(problem, shifted)):
        return tuple(claims)
    scope = within_structure(problem, "L", "M")
    return tuple(
        claim if claim.id in own else mark_witness(_with_scope(claim, scope)) for claim in claims
    )


def _with_scope(claim: Claim, scope: str) -> Claim:
    """The claim, its reason naming the structure that the gains are held to."""
    reason = claim.evidence.get("reason") or claim.evidence.get("witness", {}).get("reason")
    if claim.verdict != "refuted" or not scope or reason is None:
        return claim
    text = f"{reason}; no gain{scope} changes that part of the error"
    return replace(claim, evidence={**claim.evidence, "reason": text})


def _is_refuted_for_all_gains(problem: Problem, shifted: Exact) -> bool:
    """Decide exactly whether no gain can serve; shifted: A - L C + rate I of the design."""
    plant, options = problem.plant, problem.options_as(LuenbergerOptions)
    is_given = "L" in {*problem.gains, *idle_gains(plant)}
    is_flow_alone = plant.jump is None or math.isinf(problem.require_dwell_time()[1])
    if is_given and is_flow_alone and prove_hurwitz(shifted).outcome == "refuted":
        return True
    return witness_within_structure(problem, options.decay_rate) is not None


def _stored(gains: LuenbergerGains) -> dict[str, Array]:
    """The gains that a design stores, by name; with a schedule one for each cell."""
    cells = () if gains.M_cells is None else gains.M_cells
    return {"L": gains.L, "M": gains.M} | {f"M_cells[{i}]": M for i, M in enumerate(cells)}


def dwell_pair(stored: Entries) -> tuple[Exact, Exact]:
    """(F, H), exact: the pair whose stability over a range of dwell times is claimed."""
    gains = LuenbergerGains.from_document(stored)
    return error_matrix(gains, "L", gains.L), error_matrix(gains, "M", gains.M)


def _expected(problem: Problem) -> NewEntries:
    n, p = problem.plant.n, problem.plant.p
    zeros = {name: np.zeros((n, p)) for name in idle_gains(problem.plant)}
    expected = plant_data(problem.plant) | {"L": (n, p), "M": (n, p)} | dict(problem.gains) | zeros
    schedule = problem.options_as(LuenbergerOptions).schedule
    if schedule is not None:
        cells = cell_count(schedule)
        borders = (cells - 1,) if isinstance(schedule, int) else np.array(schedule)
        expected |= {"M_cells": (cells, n, p), "dwell_borders": borders}
    return expected


def _hurwitz(F: Exact, name: str, why: str, rate: float = 0.0) -> Claim:
    verdict = prove_hurwitz(F)
    shift = f" + {rate!r} I" if rate else ""
    return Claim.from_verdict(
        name,
        f"the error between jumps decays by itself (A - L C{shift} is Hurwitz), needed as {why}",
        "Lyapunov's theorem",
        verdict,
    )


def _stability(F: Exact, H: Exact, dwell: Dwell, certificates: Entries, paranoid: bool) -> Claim:
    verdict = dwell_stability(F, H, dwell, certificates.get("dwell_stability", {}), paranoid)
    return Claim.from_verdict(
        "dwell_stability",
        f"the error e -> e^(F T) H e, F = A - L C, H its matrix at jumps, is stable for every "
        f"sequence of dwell times T in {dwell}",
        source_of(verdict, PAPER),
        verdict,
    )


def _scheduled(
    problem: Problem,
    gains: LuenbergerGains,
    F: Exact,
    certificates: Entries,
    paranoid: bool,
) -> list[Claim]:
    """Claim stability, and the decay rate, with gains by cells of the last dwell time."""
    dwell, claims = Dwell.from_problem(problem), []
    rate = problem.options_as(LuenbergerOptions).decay_rate
    goals = [("dwell_stability", 0.0, "is stable")]
    goals += [("decay_rate", rate, f"decays like e^(-{rate!r} t)")] if rate > 0 else []
    for name, shift, what in goals:
        shifted = F + exact(shift * np.eye(problem.plant.n))
        certificate = certificates.get(name, {})
        verdict = scheduled_stability(problem, gains, shifted, certificate, paranoid)
        statement = (
            "the error, corrected at a jump by the gain for the dwell time that ends there, "
            f"{what} for every sequence of dwell times T in {dwell}"
        )
        claims.append(Claim.from_verdict(name, statement, PAPER, verdict))
    return claims


def _decay(
    shifted: Exact,
    H: Exact,
    dwell: Dwell,
    certificates: Entries,
    *,
    rate: float,
    paranoid: bool,
) -> Claim:
    flow = prove_hurwitz(shifted) if math.isinf(dwell.high) else None
    verdict = dwell_stability(shifted, H, dwell, certificates.get("decay_rate", {}), paranoid)
    if flow is not None and overall([flow.outcome, verdict.outcome]) == flow.outcome != "proved":
        verdict = flow
    return Claim.from_verdict(
        "decay_rate",
        f"the error decays like e^(-{rate!r} t) for every sequence of dwell times in {dwell}",
        source_of(verdict, f"{PAPER}, for A - L C + {rate!r} I"),
        verdict,
    )
