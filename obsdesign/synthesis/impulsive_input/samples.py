"""Coarse samples: the window of the discrete operator; nothing else is left to choose."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from obsdesign.equations.estimation_error import plant_data
from obsdesign.equations.impulsive_input.features import LARGEST
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate

_WINDOW = 4  # samples, where they are few and dwell times allow them
_LONGEST = 512  # samples of a window that is left open: a row costs as much as there are


def sampled_candidates(
    problem: Problem, low: float, reason: str, *, longest: float | None = None, count: int = _WINDOW
) -> Iterator[Candidate]:
    """Gains for operator `samples`; InputError where it cannot work.

    longest: the period up to which operator `integral` would do, where `samples` was not asked for;
    count: samples of a window that is left open. Windows of twice as many follow, since a few
    samples need not determine the state.
    """
    plant = problem.plant
    _check(problem, reason, longest)
    period = float(problem.require("output.period"))
    data: dict[str, Any] = plant_data(plant) | {
        "H": problem.require("jump.H"),
        "noise_std": plant.output.noise_std, "noise_cv": plant.output.noise_cv,
        "period": period, "margin": period, "weighting": "gls",
        "operator": "samples", "state_correction": True,
        "nonnegative": bool(problem.options.get("nonnegative", False)),
    }  # fmt: skip
    data |= initial_std(problem)
    for k, window in enumerate(_windows(problem, low, period, count)):
        longer = f"; {round(window / period)} samples in a window" if k else ""
        label = f"samples: {reason}{longer}"
        yield Candidate(label, data | {"window": window}, searched=True)


def initial_std(problem: Problem) -> dict[str, Any]:
    """The deviations of the initial state as a design stores them, where the file gives them.

    InputError for one that floats cannot square.
    """
    if "initial_std" not in problem.options:
        return {}
    given = np.array(problem.options["initial_std"], dtype=np.float64)
    if given.max() > LARGEST:
        raise InputError(
            f"observer.initial_std must be at most {LARGEST:g}, since it is squared; got "
            f"{given.max():g}."
        )
    return {"initial_std": given}


def _check(problem: Problem, reason: str, longest: float | None) -> None:
    plant = problem.plant
    if plant.output.measured != "periodic":
        raise InputError(
            "output.measured must be 'periodic', with a period, for operator 'samples'; got "
            f"{plant.output.measured!r}."
        )
    if "margin" in problem.options:
        raise InputError(
            f"observer.margin belongs to operator 'integral'; 'samples' ({reason}) has no use for "
            f"it. Leave it out; got {problem.options['margin']!r}."
        )
    if problem.options.get("state_correction") is False:
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
    for i in range(plant.p):
        if plant.output.noise_std[i] == 0 and plant.output.noise_cv[i] == 0:
            raise InputError(
                f"output.noise_std must be > 0 for operator 'samples' ({reason}); got 0 for "
                f"output {i + 1}.{other}"
            )
    if problem.options.get("weighting") == "plain":
        raise InputError("observer.weighting must be 'gls' for operator 'samples'; got 'plain'.")


def _windows(problem: Problem, low: float, period: float, count: int) -> list[float]:
    """The window of the file, else of so many samples and more, as the dwell time allows."""
    window = problem.options.get("window")
    if window is None:
        most = max(math.ceil(low / period * (1 - 1e-9)) - 1, 1)
        counts = [min(count, most)]
        while counts[-1] < min(most, _LONGEST):
            counts.append(min(2 * counts[-1], most, _LONGEST))
        return [period * count for count in counts]
    whole = float(window) / period
    if abs(whole - round(whole)) > 1e-6 or round(whole) < 1:
        raise InputError(
            f"observer.window must be a multiple of output.period = {period!r} for operator "
            f"'samples'; got {window!r}."
        )
    return [float(window)]
