"""Which operator an impulsive input needs where none is asked for: integrals, or samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.impulsive_input import features as equations
from obsdesign.equations.impulsive_input import rule as impulse_rule
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem

Matrix = NDArray[np.float64]

_FEWEST = 12  # samples of a window
_MOST = 32  # samples of a window of operator `samples`: more only take time
_JUMPS = 0.05  # of its response that an impulse must show at once: then the output jumps with it


def asks_for_samples(problem: Problem) -> bool:
    """Is operator `samples` asked for? InputError beside what belongs to the other one."""
    asked = problem.options.get("operator") == "samples"
    if asked and (own := impulse_rule.integral_entries(problem.options, problem.gains)):
        raise InputError(
            f"observer.{own[0]} belongs to operator 'integral'; with 'samples' all samples of "
            "the window are used as they are."
        )
    return asked


def few_samples(problem: Problem, D: Matrix, window: float) -> str | None:
    """Why samples are too few for operator `integral` where the operator is open, or None."""
    if not impulse_rule.operator_is_open(problem):
        return None
    period = float(problem.plant.output.period or 0.0)
    longest = equations.longest_period(D, None, window)
    if period > longest:
        fastest = float(np.abs(np.linalg.eigvals(D)).max()) * period
        limit = fastest * longest / period
        return f"the fastest mode of A - K C times the period is {fastest:.3g}, above {limit:.3g}"
    if window < _FEWEST * period:
        return f"the window holds only {window / period:.4g} samples"
    return None


def jumping_output(problem: Problem, window: float, weighting: str) -> str | None:
    """Why `samples` is chosen in noise where the output jumps with an impulse, or None.

    None also where `samples` cannot work: it is a choice, nobody asked for it.
    """
    plant, options = problem.plant, problem.options
    if not impulse_rule.operator_is_open(problem):
        return None
    A, H = plant.flow.A, problem.require("jump.H")
    refused = weighting == "plain" or "margin" in options or H.shape[1] > 1
    refused |= options.get("state_correction") is False
    asked = float(options.get("window", 0.0)) / float(plant.output.period or 1.0)
    if refused or not H.any() or abs(asked - round(asked)) > 1e-6:
        return None
    along = np.hstack([H, A @ H])
    hidden = np.linalg.matrix_rank(along / np.linalg.norm(along, axis=0).clip(1e-300)) < 2
    share = equations.jump_share(A, plant.output.C, H, window)
    if hidden or share < _JUMPS:
        return None
    return (
        f"the output jumps with an impulse, by {share:.0%} of what it leaves at most: in noise "
        "integrals of samples miss such impulses, samples as they are do not"
    )


def samples_within(problem: Problem, window: float) -> int:
    """Samples of a window of operator `samples` that could be as long as this one."""
    return min(int(window / float(problem.plant.output.period or 1.0) * (1 + 1e-9)), _MOST)


def period_for_integrals(D: Matrix, window: float) -> float:
    """At most this period lets operator `integral` do; three digits."""
    longest = min(equations.longest_period(D, None, window), window / _FEWEST)
    return equations.rounded_down(longest)
