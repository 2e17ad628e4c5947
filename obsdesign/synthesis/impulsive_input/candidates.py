"""Impulsive inputs: observer gain, window and exponents where they are left open.

K places the poles of A - K C at real, distinct places a little faster than those of A: slow
observers leave more of an impulse to be seen, and with a real spectrum few exponents determine an
impulse (`verification.uniqueness`). The window is a part of the shortest dwell time. Exponents:
`synthesis.impulse_exponents`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.analysis.hidden_modes import approx_unobservable_modes
from obsdesign.equations.estimation_error import flow_error_matrix, plant_data
from obsdesign.equations.impulsive_input import features as equations
from obsdesign.equations.impulsive_input.curve import balanced_size
from obsdesign.equations.impulsive_input.features import longest_period
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.impulsive_input.exponents import exponent_choices, rule_for
from obsdesign.synthesis.impulsive_input.operator import (
    asks_for_samples,
    few_samples,
    jumping_output,
    period_for_integrals,
    samples_within,
)
from obsdesign.synthesis.impulsive_input.samples import initial_std, sampled_candidates
from obsdesign.synthesis.placement import placed_gain

Matrix = NDArray[np.float64]

_WINDOW = 0.8  # of the shortest dwell time
_MARGIN = 0.25  # of the window
_LARGEST_GAIN = 1e3  # size of A - K C against that of A
_MEMORY = 6.0  # time constants of the slowest mode of A - K C that a window is worth
_FASTER, _APART = 1.25, 1.2  # poles of the observer against those of the plant and each other


def synthesize(problem: Problem) -> Iterator[Candidate]:
    """Candidates in order of preference; InputError for what cannot be built at all."""
    plant = problem.plant
    problem.require("jump.H")
    low, _ = problem.require_dwell_time()
    problem.require_measured("continuous", "periodic")
    _check_plant(plant)
    _check_options(problem)
    weighting = _weighting(problem)
    if asks_for_samples(problem):
        yield from sampled_candidates(problem, low, "asked for")
        return
    window = float(problem.options.get("window", _longest(problem, low)))
    K = problem.gains.get("K")
    K = _gain(problem, window) if K is None else K
    D = flow_error_matrix(plant.flow.A, K, plant.output.C)
    data = _data(problem, D, window) | {"K": K, "weighting": weighting, "operator": "integral"}
    data["state_correction"] = bool(problem.options.get("state_correction", weighting == "gls"))
    window = data["window"]
    if reason := few_samples(problem, D, window):
        longest = period_for_integrals(D, window)
        yield from sampled_candidates(problem, low, reason, longest=longest)
        if float(problem.plant.output.period or 0.0) > longest_period(D, None, window):
            return  # the claim `samples` of operator `integral` fails for the same reason
    elif reason := jumping_output(problem, window, weighting):
        count = samples_within(problem, window)
        yield from sampled_candidates(problem, low, reason, count=count)
    try:
        yield from _integral_candidates(problem, data, D)
    except InputError:
        if not reason:
            raise  # otherwise the other operator has been proposed


def _integral_candidates(problem: Problem, data: dict[str, Any], D: Matrix) -> Iterator[Candidate]:
    """Operator `integral` with exponents as given, or as chosen."""
    if "exponents" in problem.options:
        given = np.array(problem.options["exponents"], dtype=np.float64)
        rule = rule_for(data, D, given)
        yield Candidate("given exponents", data | {"exponents": given, "rule": rule}, searched=True)
        return
    for label, chosen, rule in exponent_choices(problem, data, D):
        yield Candidate(label, data | {"exponents": chosen, "rule": rule}, searched=True)


def _check_plant(plant: Plant) -> None:
    if text := equations.plant_objection(plant):
        raise DoesNotApply(text)
    if text := equations.objection(plant):
        raise InputError(text)


def _longest(problem: Problem, low: float) -> float:
    """A part of the shortest dwell time, which leaves two periods of the samples."""
    period = Fraction(float(problem.plant.output.period or 0.0))
    left = low - 2 * float(period)
    if left <= 0:
        return _WINDOW * low or 1.0
    while Fraction(left) + 2 * period > Fraction(low):  # the claim `samples` is exact
        left = math.nextafter(left, 0.0)
    return min(_WINDOW * low, left)


def _remembered(problem: Problem, D: Matrix, window: float) -> float:
    """No longer than something of an impulse is left in the output, so that all of it is used."""
    slowest = float(-np.linalg.eigvals(D).real.max())
    if slowest <= 0:
        return window
    return min(window, max(_MEMORY / slowest, 4 * float(problem.options.get("margin", 0.0))))


def _data(problem: Problem, D: Matrix, window: float) -> dict[str, Any]:
    """Gains but for K and exponents; InputError for a margin that leaves nothing of the window."""
    plant, options = problem.plant, problem.options
    if "window" not in options:
        window = _remembered(problem, D, window)
    margin = float(options.get("margin", _MARGIN * window))
    if margin >= window:
        raise InputError(
            f"observer.margin must be less than the window, {window!r}; got {margin!r}."
        )
    data = plant_data(plant) | {
        "H": problem.require("jump.H"), "window": window, "margin": margin,
        "noise_std": plant.output.noise_std, "noise_cv": plant.output.noise_cv,
    }  # fmt: skip
    data["nonnegative"] = bool(options.get("nonnegative", False))
    data |= initial_std(problem)
    if plant.output.measured == "periodic":
        data["period"] = float(plant.output.period or 0.0)
    if "threshold" in options:
        data["threshold"] = float(options["threshold"])
    return data


def _weighting(problem: Problem) -> str:
    """plain or gls; gls by default where every output has noise. InputError if it has none."""
    output = problem.plant.output
    silent = np.flatnonzero((output.noise_std == 0) & (output.noise_cv == 0))
    asked = problem.options.get("weighting", "plain" if len(silent) else "gls")
    if asked == "gls" and len(silent):
        raise InputError(
            f"output.noise_std must be > 0 with observer.weighting = 'gls'; got 0 for output "
            f"{silent[0] + 1}."
        )
    return str(asked)


def _check_options(problem: Problem) -> None:
    options, jump = problem.options, problem.plant.jump
    directions = 0 if jump is None or jump.H is None else jump.H.shape[1]
    if options.get("nonnegative") and directions > 1:
        raise InputError(
            f"observer.nonnegative takes one direction of impulses; jump.H has {directions}."
        )
    if options.get("state_correction") and _weighting(problem) == "plain":
        raise InputError(
            "observer.state_correction needs observer.weighting = 'gls', and output.noise_std > 0: "
            "without noise there is nothing to weigh the state by."
        )
    if "initial_std" in options and _weighting(problem) == "plain":
        raise InputError(
            "observer.initial_std needs observer.weighting = 'gls', and output.noise_std > 0: the "
            "plain norm weighs no error of the state."
        )
    if options.get("check_exponents"):
        if "exponents" in options or options.get("operator") == "samples":
            other = "exponents" if "exponents" in options else "operator = 'samples'"
            raise InputError(
                f"observer.check_exponents looks at exponents that are left open; observer.{other} "
                "leaves none."
            )
        if _weighting(problem) == "gls":
            raise InputError(
                "observer.check_exponents is about observer.weighting = 'plain': whitened features "
                "hardly depend on the exponents."
            )
        if directions > 1:
            raise InputError(
                f"observer.check_exponents takes one direction of impulses; jump.H has "
                f"{directions}."
            )


def _gain(problem: Problem, window: float) -> Matrix:
    """Real distinct poles; zero where a mode is not seen (a claim says so).

    Also zero where that would take a gain beyond all measure and the plant forgets by itself: some
    direction is hardly seen.
    """
    A, C = problem.plant.flow.A, problem.plant.output.C
    if approx_unobservable_modes(A, C):
        return np.zeros((problem.plant.n, problem.plant.p))
    speeds = np.sort(np.abs(np.linalg.eigvals(A)))
    poles: list[float] = []
    for speed in speeds.tolist():
        wanted = max(_FASTER * speed, 1.0 / window)
        poles.append(max(wanted, _APART * poles[-1]) if poles else wanted)
    K = placed_gain(A, C, [-pole for pole in poles])
    immense = balanced_size(A - K @ C) > _LARGEST_GAIN * max(balanced_size(A), 1.0 / window)
    forgets = float(np.linalg.eigvals(A).real.max()) * window < -1
    return np.zeros_like(K) if immense and forgets else K
