"""Impulsive inputs: observer gain, window and exponents where they are left open.

The window is a part of the shortest dwell time. K: `observer_gain`; exponents:
`exponents`, and in noise `noisy_exponents`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.impulsive_input.requirements import (
    reason_against_jumps,
    reason_against_noise,
    reason_against_sizes,
)
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.impulsive_input.gains import LARGEST
from obsdesign.equations.impulsive_input.sampling import longest_period
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.options import ImpulsiveInputOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.impulsive_input.exponents import rule_for
from obsdesign.synthesis.impulsive_input.integral_window import IntegralWindow
from obsdesign.synthesis.impulsive_input.noisy_exponents import exponent_choices
from obsdesign.synthesis.impulsive_input.observer_gain import observer_gain
from obsdesign.synthesis.impulsive_input.operator import (
    is_samples_requested,
    period_for_integrals,
    reason_against_integrals,
    reason_for_samples,
    samples_within,
)
from obsdesign.synthesis.impulsive_input.samples import (
    WINDOW_SHARE,
    reason_against_samples,
    sampled_candidates,
)

_MARGIN_SHARE = 0.25  # of the window
_WINDOW_TIME_CONSTANTS = 6.0  # time constants of the slowest mode of A - K C that a window is worth


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Candidates in order of preference; InputError for what cannot be built at all."""
    problem.require("jump.H")
    low, _ = problem.require_dwell_time()
    problem.require_measured("continuous", "periodic")
    options = problem.options_as(ImpulsiveInputOptions)
    _check_plant(problem)
    _check_options(problem, options)
    weighting = _weighting(problem)
    if is_samples_requested(problem):
        yield from sampled_candidates(problem, low, "asked for")
        return
    window = _longest_window(problem, low) if options.window is None else options.window
    K = observer_gain(problem, window)
    integral = _integral_window(problem, K, window, weighting)
    D, window = integral.D, integral.window
    if reason := reason_against_integrals(problem, D, window):
        # the claim `samples` of operator `integral` fails for the same reason
        too_coarse = problem.plant.output.sample_spacing > longest_period(D, None, window)
        if too_coarse or reason_against_samples(problem) is None:
            longest = period_for_integrals(D, window)
            yield from sampled_candidates(problem, low, reason, longest=longest)
        else:
            reason = None
        if too_coarse:
            return
    elif reason := reason_for_samples(problem, window):
        count = samples_within(problem, window)
        yield from sampled_candidates(problem, low, reason, count=count)
    try:
        yield from _integral_candidates(integral, budget)
    except InputError:
        if not reason:
            raise  # otherwise the other operator has been proposed


def _integral_candidates(integral: IntegralWindow, budget: TimeBudget) -> Iterator[Candidate]:
    """Operator `integral` with exponents as given, or as chosen."""
    if integral.options.exponents is not None:
        given = np.array(integral.options.exponents, dtype=np.float64)
        rule = rule_for(integral, given)
        yield Candidate("given exponents", integral.gains(given, rule), searched=True)
        return
    for choice in exponent_choices(integral, budget):
        gains = integral.gains(choice.exponents, choice.rule)
        yield Candidate(
            choice.label, gains, searched=True, remarks=choice.remarks, solvers=choice.solvers
        )


def _check_plant(problem: Problem) -> None:
    plant = problem.plant
    if plant.jump is not None and (text := reason_against_jumps(plant.jump, plant.n)):
        raise DoesNotApply(text)
    if text := reason_against_sizes(plant) or reason_against_noise(plant.output):
        raise InputError(text)


def _longest_window(problem: Problem, low: float) -> float:
    """A part of the shortest dwell time, which leaves two periods of the samples."""
    period = Fraction(problem.plant.output.sample_spacing)
    left = low - 2 * float(period)
    if left <= 0:
        return WINDOW_SHARE * low or 1.0
    while Fraction(left) + 2 * period > Fraction(low):  # the claim `samples` is exact
        left = math.nextafter(left, 0.0)
    return min(WINDOW_SHARE * low, left)


def _shortened_window(D: Matrix, window: float, margin: float) -> float:
    """The window, cut to the time for which an impulse is left in the output."""
    slowest = float(-np.linalg.eigvals(D).real.max())
    if slowest <= 0:
        return window
    return min(window, max(_WINDOW_TIME_CONSTANTS / slowest, 4 * margin))


def _integral_window(problem: Problem, K: Matrix, window: float, weighting: str) -> IntegralWindow:
    """Gains but for the exponents; InputError for a margin that leaves nothing of the window.

    window: the longest that the dwell times allow.
    """
    plant, options = problem.plant, problem.options_as(ImpulsiveInputOptions)
    if options.window is None:
        D = flow_error_matrix(plant.flow.A, K, plant.output.C)
        window = _shortened_window(D, window, options.margin or 0.0)
    margin = _MARGIN_SHARE * window if options.margin is None else options.margin
    if margin >= window:
        raise InputError(
            f"observer.margin must be less than the window, {window!r}; got {margin!r}."
        )
    return IntegralWindow(problem=problem, K=K, window=window, margin=margin, weighting=weighting)


def _weighting(problem: Problem) -> str:
    """plain or gls; gls by default where every output has noise. InputError if it has none."""
    output = problem.plant.output
    silent = np.flatnonzero((output.noise_std == 0) & (output.noise_cv == 0))
    weighting = problem.options_as(ImpulsiveInputOptions).weighting
    weighting = weighting or ("plain" if len(silent) else "gls")
    if weighting == "gls" and len(silent):
        raise InputError(
            f"output.noise_std must be > 0 with observer.weighting = 'gls'; got 0 for output "
            f"{silent[0] + 1}."
        )
    return weighting


def _check_options(problem: Problem, options: ImpulsiveInputOptions) -> None:
    """InputError for options that do not fit the plant, or each other."""
    directions = problem.require("jump.H").shape[1]
    if options.nonnegative and directions > 1:
        raise InputError(
            f"observer.nonnegative takes one direction of impulses; jump.H has {directions}."
        )
    if options.state_correction and _weighting(problem) == "plain":
        raise InputError(
            "observer.state_correction needs observer.weighting = 'gls', and output.noise_std > 0: "
            "without noise there is nothing to weigh the state by."
        )
    if options.initial_std is not None and _weighting(problem) == "plain":
        raise InputError(
            "observer.initial_std needs observer.weighting = 'gls', and output.noise_std > 0: the "
            "plain norm weighs no error of the state."
        )
    if options.threshold is not None and options.smallest_weight is not None:
        raise InputError(
            "observer.threshold and observer.smallest_weight both say when an impulse is "
            "evaluated; drop one."
        )
    if options.smallest_weight is not None and directions > 1:
        raise InputError(
            f"observer.smallest_weight takes one direction of impulses; jump.H has {directions}."
        )
    if (largest := max(options.initial_std or (0.0,))) > LARGEST:
        raise InputError(
            f"observer.initial_std must be at most {LARGEST:g}, since it is squared; got "
            f"{largest:g}."
        )
