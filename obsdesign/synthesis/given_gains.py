"""Gains that a problem gives, and the requirements of kinds with L and M."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.estimation_error import idle_gains
from obsdesign.errors import InputError
from obsdesign.problem.options import ImpulsiveInputOptions, LuenbergerOptions, UnknownInputOptions
from obsdesign.problem.problem import Problem


def refuse_unusable(problem: Problem) -> None:
    """DoesNotApply or InputError for problems that no observer with gains L, M can serve."""
    plant = problem.plant
    if plant.jump is not None:
        problem.require_dwell_time()
    problem.require_measured("continuous", "at_jumps")
    for name, why in idle_gains(plant).items():
        if np.any(problem.gains.get(name, 0)):
            raise InputError(f"observer.gains.{name} must be zero: {why}; got nonzero entries.")


def refuse_second_choice(
    options: LuenbergerOptions | UnknownInputOptions | ImpulsiveInputOptions,
    given: str | None,
    gain: str = "L",
) -> None:
    """InputError where more than one of poles, weights and a given gain chooses the gain.

    given: what else decides about the gain, in words; None where nothing does.
    """
    for name in ("poles", "weights"):
        if given is not None and options.is_stated(name):
            raise InputError(f"observer.{name} chooses {gain}, but {gain} {given}; drop one.")
    if options.poles is not None and options.weights is not None:
        raise InputError(f"observer.poles and observer.weights both choose {gain}; drop one.")


def refuse_vain_constraints(problem: Problem, constraints: object) -> None:
    """InputError for a user's constraints where no gain is open to them."""
    if constraints is not None and all(given_gain(problem, name) is not None for name in "LM"):
        raise InputError("constraints choose L and M, but both are given or must be zero.")


def given_gain(problem: Problem, name: str) -> Matrix | None:
    """The gain as it is given; zeros where nothing is measured; None when it is left open."""
    if name in problem.gains:
        return problem.gains[name]
    plant = problem.plant
    return np.zeros((plant.n, plant.p)) if name in idle_gains(plant) else None
