"""Candidates of operator `samples`, for coarse samples: only the window is open."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from obsdesign.equations.impulsive_input.gains import SamplesGains, is_whole_multiple
from obsdesign.errors import InputError
from obsdesign.problem.options import ImpulsiveInputOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate

_WINDOW = 4  # samples, where they are few and dwell times allow them
_LONGEST = 512  # samples of a window that is left open: a row costs as much as there are


def sampled_candidates(
    problem: Problem, low: float, reason: str, *, longest: float | None = None, count: int = _WINDOW
) -> Iterator[Candidate]:
    """Gains for operator `samples`; InputError where it cannot work.

    longest: the period up to which operator `integral` would do, where the operator is open;
    count: samples of a window that is left open. Windows of twice as many follow, since a few
    samples need not determine the state.
    """
    options = problem.options_as(ImpulsiveInputOptions)
    _check(problem, options, reason, longest)
    period = float(problem.require("output.period"))
    for k, window in enumerate(_windows(options.window, low, period, count)):
        gains = SamplesGains.from_plant(
            problem.plant,
            operator="samples",
            window=window,
            margin=period,
            period=period,
            weighting="gls",
            state_correction=True,
            nonnegative=options.nonnegative,
            initial_std=options.initial_std,
        )
        longer = f"; {gains.window_samples} samples in a window" if k else ""
        yield Candidate(f"samples: {reason}{longer}", gains, searched=True)


def _check(
    problem: Problem, options: ImpulsiveInputOptions, reason: str, longest: float | None
) -> None:
    """InputError where the operator cannot work."""
    plant = problem.plant
    if plant.output.measured != "periodic":
        raise InputError(
            "output.measured must be 'periodic', with a period, for operator 'samples'; got "
            f"{plant.output.measured!r}."
        )
    if options.margin is not None:
        raise InputError(
            f"observer.margin belongs to operator 'integral'; 'samples' ({reason}) has no use for "
            f"it. Leave it out; got {options.margin!r}."
        )
    if options.state_correction is False:
        raise InputError(
            "observer.state_correction = false belongs to operator 'integral': 'samples' "
            f"({reason}) always corrects the state. Leave it out."
        )
    H = problem.require("jump.H")
    if H.shape[1] > 1:
        raise InputError(
            f"jump.H must have one column for operator 'samples'; it has {H.shape[1]}."
        )
    other = " Or sample faster: operator 'integral' needs an output.period of at most"
    other = "" if longest is None else f"{other} {longest:g}."
    silent = np.flatnonzero((plant.output.noise_std == 0) & (plant.output.noise_cv == 0))
    if len(silent):
        raise InputError(
            f"output.noise_std must be > 0 for operator 'samples' ({reason}); got 0 for "
            f"output {silent[0] + 1}.{other}"
        )
    if options.weighting == "plain":
        raise InputError("observer.weighting must be 'gls' for operator 'samples'; got 'plain'.")


def _windows(window: float | None, low: float, period: float, count: int) -> list[float]:
    """The window of the file, else of so many samples and more, as the dwell time allows."""
    if window is None:
        most = max(math.ceil(low / period * (1 - 1e-9)) - 1, 1)
        counts = [min(count, most)]
        while counts[-1] < min(most, _LONGEST):
            counts.append(min(2 * counts[-1], most, _LONGEST))
        return [period * count for count in counts]
    if not is_whole_multiple(window, period):
        raise InputError(
            f"observer.window must be a multiple of output.period = {period!r} for operator "
            f"'samples'; got {window!r}."
        )
    return [float(window)]
