"""Choice of the operator where the problem leaves it open: integrals, or samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.impulsive_input import features as equations
from obsdesign.equations.impulsive_input import rule as impulse_rule
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem

Matrix = NDArray[np.float64]

_LEAST_WINDOW_SAMPLES = 12  # samples of a window
_MOST_WINDOW_SAMPLES = 32  # samples of a window of operator `samples`: more only take time
_LEAST_JUMP_SHARE = (
    0.05  # of its response that an impulse must show at once: then the output jumps with it
)


def is_samples_requested(problem: Problem) -> bool:
    """Whether the problem names operator `samples`; InputError beside options of `integral`."""
    requested = problem.options.get("operator") == "samples"
    if requested and (own := impulse_rule.integral_entries(problem.options, problem.gains)):
        raise InputError(
            f"observer.{own[0]} belongs to operator 'integral'; with 'samples' all samples of "
            "the window are used as they are."
        )
    return requested


def reason_against_integrals(problem: Problem, D: Matrix, window: float) -> str | None:
    """Return why samples are too few for operator `integral` where it is open, or None."""
    if not impulse_rule.operator_is_open(problem):
        return None
    period = float(problem.plant.output.period or 0.0)
    longest = equations.longest_period(D, None, window)
    if period > longest:
        fastest = float(np.abs(np.linalg.eigvals(D)).max()) * period
        limit = fastest * longest / period
        return f"the fastest mode of A - K C times the period is {fastest:.3g}, above {limit:.3g}"
    if window < _LEAST_WINDOW_SAMPLES * period:
        return f"the window holds only {window / period:.4g} samples"
    return None


def reason_for_samples(problem: Problem, window: float, weighting: str) -> str | None:
    """Return why `samples` is chosen in noise where the output jumps with an impulse, or None.

    None also where `samples` cannot work, since the problem leaves the operator open.
    """
    plant, options = problem.plant, problem.options
    if not impulse_rule.operator_is_open(problem):
        return None
    A, H = plant.flow.A, problem.require("jump.H")
    refused = weighting == "plain" or "margin" in options or H.shape[1] > 1
    refused |= options.get("state_correction") is False
    samples = float(options.get("window", 0.0)) / plant.output.sample_period
    if refused or not H.any() or abs(samples - round(samples)) > 1e-6:
        return None
    along = np.hstack([H, A @ H])
    hidden = np.linalg.matrix_rank(along / np.linalg.norm(along, axis=0).clip(1e-300)) < 2
    share = equations.jump_share(A, plant.output.C, H, window)
    if hidden or share < _LEAST_JUMP_SHARE:
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
    longest = min(equations.longest_period(D, None, window), window / _LEAST_WINDOW_SAMPLES)
    return equations.rounded_down(longest)
