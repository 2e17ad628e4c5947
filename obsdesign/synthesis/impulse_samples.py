"""Coarse samples: the window of the discrete operator; nothing else is left to choose."""

from __future__ import annotations

import math
from typing import Any

from obsdesign.equations.estimation_error import plant_data
from obsdesign.errors import InputError
from obsdesign.problem import Problem
from obsdesign.synthesis.candidate import Candidate

_WINDOW = 4  # samples, where they are few and dwell times allow them


def sampled_candidate(
    problem: Problem, low: float, reason: str, *, longest: float | None = None, count: int = _WINDOW
) -> Candidate:
    """Gains for operator `samples`; InputError where it cannot work.

    longest: the period up to which operator `integral` would do, where `samples` was not asked for;
    count: samples of a window that is left open.
    """
    plant = problem.plant
    _check(problem, reason, longest)
    period = problem.require("output.period")
    window = _window(problem, low, float(period), count)
    data: dict[str, Any] = plant_data(plant) | {
        "H": problem.require("jump.H"),
        "noise_std": plant.output.noise_std, "noise_cv": plant.output.noise_cv,
        "period": float(period), "window": float(window),
        "margin": float(period), "weighting": "gls",
        "operator": "samples", "state_correction": True,
        "nonnegative": bool(problem.options.get("nonnegative", False)),
    }  # fmt: skip
    return Candidate(f"samples: {reason}", data)


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


def _window(problem: Problem, low: float, period: float, samples: int) -> float:
    """As asked, else so many samples where the dwell time allows them."""
    window = problem.options.get("window")
    if window is None:
        most = math.ceil(low / period * (1 - 1e-9)) - 1
        window = period * max(min(samples, most), 1)
    count = float(window) / period
    if abs(count - round(count)) > 1e-6 or round(count) < 1:
        raise InputError(
            f"observer.window must be a multiple of output.period = {period!r} for operator "
            f"'samples'; got {window!r}."
        )
    return float(window)
