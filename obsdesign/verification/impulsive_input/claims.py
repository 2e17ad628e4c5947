"""Hypotheses of an observer of Mattsson and Medvedev, proved for its numbers.

Beyond the paper: (12) does not make W(tau) of full rank where the spectrum is complex, so that its
rank is proved by itself; uniqueness of (17) is false in general, and decided
(`uniqueness`). See docs/impulsive_input.md.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, Value
from lmi.arithmetic.balls import exact, to_float
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.impulsive_input.requirements import (
    reason_against_jumps,
    reason_against_noise,
    reason_against_sizes,
)
from obsdesign.analysis.riccati import riccati_shift
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.impulsive_input.evaluation_rule import reason_against_exponents
from obsdesign.equations.impulsive_input.expectations import expectations
from obsdesign.equations.impulsive_input.features import FeatureWindow
from obsdesign.equations.impulsive_input.gains import (
    IntegralGains,
    SamplesGains,
    are_exponents,
    gains_from_document,
    is_positive,
    is_whole_multiple,
)
from obsdesign.problem.options import ImpulsiveInputOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.verification import stated_poles, stated_weights
from obsdesign.verification.consistency import consistent_gains
from obsdesign.verification.impulsive_input import window as window_claims
from obsdesign.verification.impulsive_input.choices import mark_inevitable
from obsdesign.verification.impulsive_input.rank import full_rank
from obsdesign.verification.impulsive_input.required_gains import margin_and_window, required_gains
from obsdesign.verification.impulsive_input.robustness import robustness
from obsdesign.verification.impulsive_input.samples import sampled_claims, window_samples
from obsdesign.verification.impulsive_input.smallest_weight import smallest_weight
from obsdesign.verification.impulsive_input.uniqueness import SOURCE, decide_uniqueness


def claims(
    problem: Problem,
    stored: Entries,
    certificates: EntriesByClaim,
    *,
    paranoid: bool = False,
    budget: TimeBudget = UNLIMITED,
) -> tuple[Claim, ...]:
    """All hypotheses of the design, each with its verdict; nothing is taken from certificates.

    stored: gains as a design file states them.
    """
    agreement, gains = consistent_gains(
        _reason_against(problem, stored),
        stored,
        required_gains(problem, stored),
        gains_from_document,
    )
    if gains is None:
        return (agreement,)
    low, _ = problem.require_dwell_time()
    A, C = exact(gains.A), exact(gains.C)
    claims = [
        agreement,
        window_claims.observable(A, C, problem.names.states_of(problem.plant.n)),
        window_claims.dwell(gains.window, low),
    ]
    if isinstance(gains, SamplesGains):
        claims += sampled_claims(gains, low)
    else:
        if gains.period is not None:
            claims.append(window_samples(gains, gains.period, low))
        claims += _integral_claims(problem, gains, budget)
    marked = [mark_inevitable(problem, gains.operator, claim) for claim in claims]
    chosen = [] if isinstance(gains, SamplesGains) else _choice_of_K(problem, gains)
    return (*marked, *chosen)


def _choice_of_K(problem: Problem, gains: IntegralGains) -> Iterator[Claim]:
    """Claims that K is the one that stated poles or weights choose."""
    options = problem.options_as(ImpulsiveInputOptions)
    if options.poles is not None:
        D = flow_error_matrix(exact(gains.A), exact(gains.K), exact(gains.C))
        changes = stated_poles.rounding_of_gain(gains.K, gains.C)
        yield stated_poles.poles_claim(D, options.poles, name="A - K C", changes=changes)
    if options.weights:
        shifts = [riccati_shift(gains.A, gains.C, 0.0)]
        yield stated_weights.weights_claim(
            gains.A, gains.C, gains.K, options.weights, shifts, letter="K"
        )


def _integral_claims(problem: Problem, gains: IntegralGains, budget: TimeBudget) -> list[Claim]:
    """Claims about the features of operator `integral`."""
    A, C, H = exact(gains.A), exact(gains.C), exact(gains.H)
    D = flow_error_matrix(A, exact(gains.K), C)
    units = gains.output_units
    response = C if units is None else C / exact(units)[:, None]
    window = FeatureWindow(
        D, response, H, exponents=gains.exponents, tau=gains.window, margin=gains.margin
    )
    claims = [
        window_claims.hurwitz(D),
        window_claims.enough_exponents(D, C, gains.exponents.tolist()),
        full_rank(D, C, gains.exponents.tolist(), gains.window),
    ]
    options = problem.options_as(ImpulsiveInputOptions)
    if options.ratio is not None:
        claims.append(window_claims.ratio(window, options.ratio))
    if options.uncertainty is not None:
        claims.append(robustness(window, A, np.array(options.uncertainty)))
    weight = options.smallest_weight
    if weight is not None and gains.threshold is not None:
        claims.append(smallest_weight(window, weight, gains.threshold))
    nonnegative = bool(gains.nonnegative)
    verdict = decide_uniqueness(window, nonnegative, budget)
    try:
        expected = expectations(to_float(D), gains).to_evidence()
    except ValueError:  # numbers beyond what floats can follow: nothing to expect
        expected = {}
    claims.append(
        Claim(
            "uniqueness",
            f"without noise and error of the state, the features of a window determine time and "
            f"{'nonnegative ' if nonnegative else ''}weight of an impulse whose age lies in "
            f"[{gains.margin!r}, {gains.window!r}]",
            SOURCE,
            verdict.outcome,
            {**verdict.evidence, "approx_expected": expected},
        )
    )
    return claims


def _reason_against(problem: Problem, stored: Entries) -> str | None:
    """Return why the kind cannot serve the problem, or the stored gains are none; or None."""
    plant = problem.plant
    required = problem.reason_without("jump.H", "jump.dwell_time")
    if text := required or problem.reason_unless_measured("continuous", "periodic"):
        return text
    assert plant.jump is not None
    if text := reason_against_jumps(plant.jump, plant.n) or reason_against_sizes(plant):
        return text
    if text := reason_against_noise(plant.output):
        return text
    for name in ("window", "margin"):
        if not is_positive(stored.get(name)):
            return f"gains.{name} must be a positive number"
    for name in ("state_correction", "nonnegative"):
        if not isinstance(stored.get(name), bool):
            return f"gains.{name} must be true or false"
    text = None
    if stored.get("operator") == "integral":
        text = _reason_against_integral(plant, stored)
    elif stored.get("operator") == "samples":
        text = _reason_against_samples(plant, stored)
    if text is not None:
        return text
    noisy = (plant.output.noise_std > 0) | (plant.output.noise_cv > 0)
    if stored.get("weighting") == "gls" and not noisy.all():
        return "weighting 'gls' needs noise on every output"
    return None


def _reason_against_integral(plant: Plant, stored: Entries) -> str | None:
    ends = margin_and_window(stored)
    if ends is None or not ends[0] < ends[1]:
        return "gains.margin must be less than gains.window"
    exponents = stored.get("exponents")
    if not are_exponents(exponents):
        return "gains.exponents must be distinct, finite numbers, one or more"
    return reason_against_exponents(np.asarray(exponents), plant.n, plant.p, ends[1])


def _reason_against_samples(plant: Plant, stored: Entries) -> str | None:
    period = plant.output.period
    window: Value = stored.get("window")
    H = None if plant.jump is None else plant.jump.H
    if plant.output.measured != "periodic" or period is None or not is_positive(period):
        return "output.measured must be 'periodic' for operator 'samples'"
    if not is_whole_multiple(window, period):
        return f"gains.window must be a multiple of output.period = {period!r}; got {window!r}"
    if stored.get("weighting") != "gls":
        return "gains.weighting must be 'gls' for operator 'samples'"
    if H is None or H.shape[1] != 1:
        return "jump.H must have one column for operator 'samples'"
    return None
