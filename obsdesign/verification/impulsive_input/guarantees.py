"""Guarantees of observers of unknown impulses, and their limits."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.balls import exact, fixed_vector
from obsdesign.document import Claim, Guarantee
from obsdesign.equations.impulsive_input.evaluation_rule import has_noise
from obsdesign.problem.options import ImpulsiveInputOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.verification import stated_poles, stated_weights
from obsdesign.verification.impulsive_input.samples import SpeedsPerPeriod

_KNOWN_INTEGRALS = ", and with the integrals of y known exactly (y measured continuously)"


def guarantees(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """Sentences that follow from the claims, given where these are proved."""
    verdicts = {claim.id: claim.verdict for claim in claims}
    # with the stated A: what a wrong one changes is a guarantee of its own
    own = ("robustness", stated_poles.ID, stated_weights.ID)
    needed = [name for name in verdicts if name not in own]
    plant = problem.plant
    absent = ["disturbance"] + (["unknown input d"] if plant.flow.D is not None else [])
    low = "" if plant.jump is None else f"{problem.require_dwell_time()[0]!r}"
    between = _between_samples(plant)
    is_integral = "hurwitz" in verdicts
    integrals = _KNOWN_INTEGRALS if is_integral else ""
    # of samples the claim is about an impulse in the first interval
    place = "" if is_integral else ", between its first two samples,"
    main = _main_sentence(problem, low, " and ".join(absent) + integrals, (place, between))
    return (
        Guarantee.from_verdicts(main, needed, verdicts),
        *(
            Guarantee.from_verdicts(_sentence(claim.statement), [claim.id], verdicts)
            for claim in claims
            if claim.id in own
        ),
        *(
            Guarantee(text, ("samples",), given=False)
            for text in _sampling_sentences(problem, claims)
        ),
    )


def warnings(problem: Problem, claims: tuple[Claim, ...]) -> tuple[str, ...]:
    """Impulses that the observer misses or takes for others."""
    return (
        "Two impulses within one window are not told apart where one impulse explains the "
        "record as well; the test of fit flags them only where noise does not hide them.",
        "That every impulse is found in noise is not claimed: small ones are missed.",
    )


def _sentence(statement: str) -> str:
    """A statement as a sentence of its own."""
    return f"{statement[0].upper()}{statement[1:]}."


def _main_sentence(problem: Problem, low: str, absent: str, onset: tuple[str, str]) -> str:
    """Sentence for exact records, for the weighting, rule and weights of the problem.

    onset: clauses on where in a window the impulse is, and on what is lost between samples.
    """
    place, between = onset
    options, noisy = problem.options_as(ImpulsiveInputOptions), has_noise(problem.plant.output)
    if (options.weighting or ("gls" if noisy else "plain")) == "gls":
        signs = "Negative weights are excluded. " if options.nonnegative else ""
        return (
            f"Without noise and {absent}, and up to what is left of the initial error, the record "
            f"of a window that holds one impulse{place} determines its time and weight{between}. "
            f"{signs}What is reported is an estimate that allows for the stated noise, with its "
            "deviation: without noise too it is not exact, and an impulse that noise could explain "
            "is not reported."
        )
    sign = " of nonnegative weight" if options.nonnegative else ""
    threshold, least = "", ""
    if options.has_threshold:
        value = f" {options.threshold!r}"
        if options.smallest_weight is not None:
            value, least = "", f" of weight {options.smallest_weight!r} or more and"
        threshold = (
            f", each{least} with features that first exceed the threshold{value} "
            f"at an age within the margin and the window (smaller "
            "ones are missed, larger ones evaluated too early: the evidence of `uniqueness` states "
            "the weights)"
        )
    return (
        f"Without noise and {absent}, impulses{sign} all at least {low} apart, each with "
        f"an output no smaller than 1e-5 of the largest before it and of the whole output, what "
        f"known inputs make of it included{threshold}, are found at their times and with their "
        "weights, up to what is left of the initial error, which decays, where windows hold them "
        f"alone{between}."
    )


def _sampling_sentences(problem: Problem, claims: tuple[Claim, ...]) -> list[str]:
    """Limits of operator `integral` on a sampled output."""
    return [
        f"That samples {problem.plant.output.period!r} apart reproduce these integrals is not "
        "claimed: between them the residual is taken as linear. The fastest mode of A - K C times "
        f"the period is {speeds.mode:.3g}, the largest exponent "
        f"times the period {speeds.exponent:.3g}."
        for claim in claims
        if claim.id == "samples" and (speeds := SpeedsPerPeriod.from_evidence(claim.evidence))
    ]


def _between_samples(plant: Plant) -> str:
    """Clause on onsets between two samples, which are lost where e^{A v} H g stays in H."""
    if plant.output.measured != "periodic" or plant.jump is None or plant.jump.H is None:
        return ""
    H, A = exact(plant.jump.H), exact(plant.flow.A)
    if fixed_vector([np.hstack([H, A @ H])]) is None:
        return ""
    some = " for weights g with flow.A jump.H g in the span of jump.H" if H.shape[1] > 1 else ""
    return (
        ", but for its time between two samples: samples show only between which two of them "
        f"it came, and the weight for every time between them{some}"
    )
