"""Impulsive inputs: the sentences that follow from proved claims, and what is not promised."""

from __future__ import annotations

from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, fixed_vector
from obsdesign.document import Claim
from obsdesign.problem.problem import Problem

_KNOWN_INTEGRALS = ", and with the integrals of y known exactly (y measured continuously)"


def guarantees(problem: Problem, found: tuple[Claim, ...]) -> tuple[dict[str, Any], ...]:
    """The sentences a user may rely on, and those that were asked for and not proved."""
    verdicts = {claim.id: claim.verdict for claim in found}
    needed = list(verdicts)
    plant = problem.plant
    without = ["disturbance"] + (["unknown input d"] if plant.flow.D is not None else [])
    low = "" if plant.jump is None else f"{problem.require_dwell_time()[0]!r}"
    between = _between_samples(plant)
    integrals = _KNOWN_INTEGRALS if "hurwitz" in verdicts else ""
    told = [
        (
            _promise(problem, low, " and ".join(without) + integrals, between),
            all(verdicts[name] == "proved" for name in needed),
            needed,
        ),
        (
            "Two impulses within one window are not told apart where one impulse explains the "
            "record as well; the test of fit flags them only where noise does not hide them.",
            False,
            [],
        ),
        ("That every impulse is found in noise is not claimed: small ones are missed.", False, []),
    ]
    told += [(text, False, ["samples"]) for text in _left_by_sampling(problem, found)]
    return tuple({"statement": text, "given": given, "claims": ids} for text, given, ids in told)


def _promise(problem: Problem, low: str, without: str, between: str) -> str:
    """What holds without noise, for the weighting, rule and weights that the problem asks for."""
    options, output = problem.options, problem.plant.output
    positive = bool(options.get("nonnegative"))
    noisy = bool(((output.noise_std > 0) | (output.noise_cv > 0)).all())
    if options.get("weighting", "gls" if noisy else "plain") == "gls":
        said = "Negative weights are not looked for. " if positive else ""
        return (
            f"Without noise and {without}, and up to what is left of the initial error, the record "
            f"of a window that holds one impulse determines its time and weight{between}. "
            f"{said}What is reported is an estimate that allows for the stated noise, with its "
            "deviation: without noise too it is not exact, and an impulse that noise could explain "
            "is not reported."
        )
    sign = " of nonnegative weight" if positive else ""
    threshold = ""
    if "threshold" in options:
        threshold = (
            f", each with features that first exceed the threshold "
            f"{float(options['threshold'])!r} at an age within the margin and the window (smaller "
            "ones are missed, larger ones evaluated too early: the evidence of `uniqueness` tells "
            "the weights)"
        )
    return (
        f"Without noise and {without}, impulses{sign} all at least {low} apart, each with "
        f"an output no smaller than 1e-5 of the largest before it and of the whole output, what "
        f"known inputs make of it included{threshold}, are found at their times and with their "
        "weights, up to what is left of the initial error, which decays, where windows hold them "
        f"alone{between}."
    )


def _left_by_sampling(problem: Problem, found: tuple[Claim, ...]) -> list[str]:
    """What operator `integral` does not promise of a sampled output."""
    return [
        f"That samples {problem.plant.output.period!r} apart reproduce these integrals is not "
        "claimed: between them the residual is taken as linear. The fastest mode of A - K C times "
        f"the period is {claim.evidence['approx_mode_times_period']:.3g}, the largest exponent "
        f"times the period {claim.evidence['approx_exponent_times_period']:.3g}."
        for claim in found
        if claim.id == "samples" and "approx_mode_times_period" in claim.evidence
    ]


def _between_samples(plant: Any) -> str:
    """What samples cannot tell: the onset between two of them, where e^{A v} H g stays in H."""
    if plant.output.measured != "periodic":
        return ""
    H, A = exact(plant.jump.H), exact(plant.flow.A)
    if fixed_vector([np.hstack([H, A @ H])]) is None:
        return ""
    some = " for weights g with flow.A jump.H g in the span of jump.H" if H.shape[1] > 1 else ""
    return f"; samples show only between which two of them it came{some}"
