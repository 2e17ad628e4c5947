"""Choice of the operator where the problem leaves it open: integrals, or samples."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import exponential_grid
from lmi.arithmetic.spectrum import spectral_radius
from obsdesign.analysis.impulsive_input.requirements import integral_entries, operator_is_open
from obsdesign.equations.impulsive_input.sampling import longest_period, rounded_down
from obsdesign.errors import InputError
from obsdesign.problem.options import ImpulsiveInputOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.impulsive_input.samples import reason_against_samples

_LEAST_WINDOW_SAMPLES = 12  # samples of a window
_MOST_WINDOW_SAMPLES = 32  # samples of a window of operator `samples`: more only take time
_LEAST_JUMP_SHARE = (
    0.05  # of its response that an impulse must show at once: then the output jumps with it
)


def is_samples_requested(problem: Problem) -> bool:
    """Whether the problem names operator `samples`; InputError beside options of `integral`."""
    requested = problem.options_as(ImpulsiveInputOptions).operator == "samples"
    if requested and (own := integral_entries(problem)):
        raise InputError(
            f"observer.{own[0]} belongs to operator 'integral'; with 'samples' all samples of "
            "the window are used as they are."
        )
    return requested


def reason_against_integrals(problem: Problem, D: Matrix, window: float) -> str | None:
    """Return why samples are too few for operator `integral` where it is open, or None."""
    if not operator_is_open(problem):
        return None
    period = problem.plant.output.sample_spacing
    longest = longest_period(D, None, window)
    if period > longest:
        fastest = spectral_radius(D) * period
        limit = fastest * longest / period
        return f"the fastest mode of A - K C times the period is {fastest:.3g}, above {limit:.3g}"
    if window < _LEAST_WINDOW_SAMPLES * period:
        return f"the window holds only {window / period:.4g} samples"
    return None


def reason_for_samples(problem: Problem, window: float) -> str | None:
    """Return why `samples` is chosen in noise where the output jumps with an impulse, or None.

    None also where `samples` cannot work, since the problem leaves the operator open.
    """
    plant, options = problem.plant, problem.options_as(ImpulsiveInputOptions)
    if not operator_is_open(problem):
        return None
    H = problem.require("jump.H")
    samples = (options.window or 0.0) / plant.output.sample_period
    refused = reason_against_samples(problem) is not None or not H.any()
    if refused or abs(samples - round(samples)) > 1e-6:
        return None
    share = jump_share(plant.flow.A, plant.output.C, H, window)
    if share < _LEAST_JUMP_SHARE:
        return None
    return (
        f"the output jumps with an impulse, by {share:.0%} of what it leaves at most: in noise "
        "integrals of samples miss such impulses, samples as they are do not"
    )


def samples_within(problem: Problem, window: float) -> int:
    """Samples of a window of operator `samples` that could be as long as this one."""
    return min(int(window / problem.plant.output.sample_period * (1 + 1e-9)), _MOST_WINDOW_SAMPLES)


def period_for_integrals(D: Matrix, window: float) -> float:
    """Longest period for which operator `integral` suffices; three digits, rounded down."""
    longest = min(longest_period(D, None, window), window / _LEAST_WINDOW_SAMPLES)
    return rounded_down(longest)


def jump_share(A: Matrix, C: Matrix, H: Matrix, window: float, count: int = 200) -> float:
    """Part of an impulse's largest output within a window that appears at once; floats.

    The least over the directions, for the output that jumps most.
    """
    shown = np.abs(C @ exponential_grid(A, 0.0, window / count, count + 1) @ H)  # (k, p, q)
    largest = shown.max(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(largest > 0, shown[0] / largest, 0.0)
    return float(share.max(axis=0).min())
