"""Finite-time estimation: the stored gains give the state, proved.

Source: F. Mazenc, S. Ahmed, MICNON 2018, with the corrections of docs/papers.md. Claims come in
the order in which a plant fails: unobservable, badly sampled, too short a window, a singular
matrix of the method, gains that miss what they should. T is k nu for the stored binary64 nu.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, Matrix, NewEntries
from lmi.arithmetic.balls import precision
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.analysis.finite_time.error_radius import PRECISIONS
from obsdesign.analysis.finite_time.requirements import (
    reason_against,
    relative_deviations,
    stored_plant,
    window_samples,
)
from obsdesign.document import Claim
from obsdesign.equations.finite_time.gains import (
    CORRECTED,
    MOST_SAMPLES,
    NEED_L,
    PRINTED,
    FiniteTimeGains,
    require_window,
)
from obsdesign.equations.finite_time.rows import START
from obsdesign.problem.options import FiniteTimeOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.choices import mark_witness, open_choices
from obsdesign.verification.consistency import consistent_gains
from obsdesign.verification.finite_time.discrete_time import step_window_claims
from obsdesign.verification.finite_time.gains import (
    INVERTIBLE,
    error_radius_claim,
    invertible,
    method_gains_claim,
    unbiased,
)
from obsdesign.verification.finite_time.theorem_1 import bound_claims
from obsdesign.verification.finite_time.window import (
    long_enough,
    observable,
    sampled_observable,
    unobserved_modes_decay,
)

# choices that a claim rests on beside the plant, where they are not both window and L
_RESTS_ON: Mapping[str, tuple[str, ...]] = {
    "observable": (),
    "sampled_observable": ("window",),
    "window_long_enough": ("window",),
}


def claims(
    problem: Problem,
    stored: Entries,
    certificates: EntriesByClaim,
    *,
    paranoid: bool = False,
    budget: TimeBudget = UNLIMITED,
) -> tuple[Claim, ...]:
    """All hypotheses of the design, in the order of refusal, until one is not proved.

    stored: gains as a design file states them; certificates: coordinates S for the norms of
    Theorem 1, if any; paranoid proves with twice the precision.
    """
    del budget  # every claim is decided by arithmetic of a fixed length
    if problem.plant.flow.dt is not None:
        return step_window_claims(problem, stored)
    objection = reason_against(problem)
    expected = {} if objection else expected_gains(problem, stored)
    agreement, gains = consistent_gains(objection, stored, expected, FiniteTimeGains.from_document)
    if gains is None:
        return (agreement,)
    require_window(gains.n, gains.samples)
    S = _coordinates(certificates, problem.plant.n)
    hypotheses: list[Claim] = []
    for bits in PRECISIONS[1:] if paranoid else PRECISIONS:
        with precision(bits):
            hypotheses = _hypotheses(gains, S)
        if all(claim.verdict != "undecided" for claim in hypotheses):
            break
    return (agreement, *(_with_marked_witness(problem, claim) for claim in hypotheses))


def _with_marked_witness(problem: Problem, claim: Claim) -> Claim:
    """The claim, its witness marked where it holds for all open windows and L."""
    L = problem.gains.get("L")
    if claim.id in INVERTIBLE and L is not None and not np.any(L @ problem.plant.output.C):
        return mark_witness(claim, ())
    names = _RESTS_ON.get(claim.id, ("window", "L"))
    return mark_witness(claim, open_choices(problem, *names))


def _coordinates(certificates: EntriesByClaim, n: int) -> Matrix | None:
    """S of a certificate, or None where there is none that is an (n, n) matrix of numbers."""
    try:
        S = np.asarray(certificates.get("theorem_1_coordinates", {}).get("S"), dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return S if S.shape == (n, n) and np.isfinite(S).all() else None


def expected_gains(problem: Problem, stored: Entries) -> NewEntries:
    """Entries of `gains` that the problem requires: a value, or the shape it must have."""
    plant, options = problem.plant, problem.options_as(FiniteTimeOptions)
    method = options.method
    if options.window is None:
        count = stored.get("samples")
        k = int(count) if isinstance(count, int | float) and 1 <= count <= MOST_SAMPLES else 0
    else:
        k = window_samples(options.window, plant.output.sample_period)
    expected = stored_plant(plant) | {"method": method, "samples": float(k)}
    expected |= {"window_gain": (plant.n, k * plant.p)}
    if method in NEED_L:
        expected |= {"L": (plant.n, plant.p)}
    if method == "approximate":
        expected |= {"half_sample": CORRECTED if options.half_sample_correction else PRINTED}
    else:
        expected |= {"state_error": (plant.n, plant.n)}
        if plant.output.noise_bound is not None:
            expected |= {"radius": (plant.n,)}
        if "reference" in stored:  # without it, the window's end
            expected |= {"reference": {START}}
    if method == "least_squares":
        expected |= {"deviations": relative_deviations(plant.output)}
    return expected | {name: X for name, X in problem.gains.items() if name in expected}


def _hypotheses(gains: FiniteTimeGains, S: Matrix | None) -> list[Claim]:
    sampled = Sampled.from_plant(
        gains.A, gains.C, gains.period, gains.samples, gains.window_reference
    )
    hypotheses: list[Claim] = []
    for claim in _in_order(gains, sampled, S):
        hypotheses.append(claim)
        if claim.verdict != "proved":
            break
    return hypotheses


def _in_order(gains: FiniteTimeGains, sampled: Sampled, S: Matrix | None) -> Iterator[Claim]:
    yield observable(sampled)
    decayed = unobserved_modes_decay(sampled, gains)
    yield sampled_observable(sampled, decayed)
    yield long_enough(sampled, decayed)
    if gains.method in NEED_L:
        yield invertible(sampled, gains)
        yield method_gains_claim(sampled, gains)
    if not gains.is_unbiased:
        yield from bound_claims(sampled, gains, S)
        return
    yield unbiased(sampled, gains)
    if gains.radius is not None and (np.any(gains.radius) or _is_disturbed(gains)):
        yield error_radius_claim(sampled, gains)
    if gains.method == "exact":
        yield from bound_claims(sampled, gains, S)


def _is_disturbed(gains: FiniteTimeGains) -> bool:
    return bool(np.any(gains.flow_lower != gains.flow_upper) or np.any(gains.noise))
