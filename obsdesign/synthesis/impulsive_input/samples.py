"""Candidates of operator `samples`, for coarse samples: only the window is open."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import exponential_grid
from obsdesign.equations.impulsive_input.gains import SamplesGains, is_whole_multiple
from obsdesign.errors import InputError
from obsdesign.problem.options import ImpulsiveInputOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.runtime.impulsive_input.significance import LEAST_WEIGHT_DEVIATIONS, least_ratio
from obsdesign.synthesis.candidate import Candidate

WINDOW_SHARE = 0.8  # of the shortest dwell time: the longest window that is left open
_WINDOW = 4  # samples, where they are few and dwell times allow them
_LEAST_ANGLE = 1e-6  # between a response and its slope, below which they are parallel
_LONGEST = 512  # samples of a window that is left open: a row costs as much as there are


def sampled_candidates(
    problem: Problem, low: float, reason: str, *, longest: float | None = None, count: int = _WINDOW
) -> Iterator[Candidate]:
    """Gains for operator `samples`; InputError where it cannot work.

    longest: the period up to which operator `integral` would do, where the operator is open;
    count: samples of a window that is left open, where they show a weight (`_count`). Windows of
    twice as many follow, since a few samples need not determine the state.
    """
    options = problem.options_as(ImpulsiveInputOptions)
    if text := reason_against_samples(problem):
        due = f" It is chosen since {reason}; 'integral' needs an output.period of at most"
        raise InputError(text if longest is None else f"{text}{due} {longest:g}.")
    period = float(problem.require("output.period"))
    if options.window is None:
        count = _count(problem, low, period, count)
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


def reason_against_samples(problem: Problem) -> str | None:
    """Return why operator `samples` cannot work, a sentence, or None."""
    plant, options = problem.plant, problem.options_as(ImpulsiveInputOptions)
    if plant.output.measured != "periodic":
        return (
            "output.measured must be 'periodic', with a period, for operator 'samples'; got "
            f"{plant.output.measured!r}."
        )
    if options.margin is not None:
        return (
            "observer.margin belongs to operator 'integral'; 'samples' has no use for it. Leave it "
            f"out; got {options.margin!r}."
        )
    if options.state_correction is False:
        return (
            "observer.state_correction = false belongs to operator 'integral': 'samples' always "
            "corrects the state. Leave it out."
        )
    H = problem.require("jump.H")
    if H.shape[1] > 1:
        return f"jump.H must have one column for operator 'samples'; it has {H.shape[1]}."
    silent = np.flatnonzero((plant.output.noise_std == 0) & (plant.output.noise_cv == 0))
    if len(silent):
        place = f"output {silent[0] + 1}"
        return f"output.noise_std must be > 0 for operator 'samples'; got 0 for {place}."
    if options.weighting == "plain":
        return "observer.weighting must be 'gls' for operator 'samples'; got 'plain'."
    return None


def _count(problem: Problem, low: float, period: float, count: int) -> int:
    """Samples of a window: `count`, doubled until they show a just detectable weight.

    The longest that dwell times allow where none does; `count` where a later impulse is a smaller
    earlier one at any length: then no window tells them apart.
    """
    longest = max(min(int(WINDOW_SHARE * low / period * (1 + 1e-9)), _LONGEST), count)
    counts = [count]
    while counts[-1] < longest:
        counts.append(min(2 * counts[-1], longest))
    angles = [_angle(problem.plant, problem.require("jump.H"), period, each) for each in counts]
    if max(angles) < _LEAST_ANGLE:
        return count
    deviations = [math.sqrt(least_ratio(n)) * s for n, s in zip(counts, angles, strict=True)]
    enough = (n for n, d in zip(counts, deviations, strict=True) if d >= LEAST_WEIGHT_DEVIATIONS)
    return next(enough, longest)


def _angle(plant: Plant, H: Matrix, period: float, count: int) -> float:
    """Sine of the angle between the response C e^{A s} H at `count` samples and its slope.

    An unknown onset makes the deviation of a weight larger by its inverse.
    """
    A, output = plant.flow.A, plant.output
    states = exponential_grid(A, period / 2, period, count) @ H
    shown, slope = (output.C @ states)[..., 0], (output.C @ A @ states)[..., 0]
    noise = np.hypot(output.noise_std, output.noise_cv * np.abs(shown).max(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        g, d = (np.where(noise > 0, each / noise, 0.0).ravel() for each in (shown, slope))
        g, d = g / np.linalg.norm(g), d / np.linalg.norm(d)
    sine = float(np.linalg.norm(d - g * float(g @ d)))
    return sine if math.isfinite(sine) else 0.0


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
