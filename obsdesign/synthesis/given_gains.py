"""Gains that a problem gives, and what every kind with L and M asks of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from obsdesign.equations.estimation_error import idle_gains
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.problem import Problem


def refuse_unusable(problem: Problem) -> None:
    """DoesNotApply or InputError for what no observer with gains L, M can execute."""
    plant, kind = problem.plant, problem.kind
    if plant.jump is not None:
        problem.require_dwell_time()
    if plant.output.measured == "periodic":
        raise DoesNotApply(
            f"output.measured = 'periodic' is not available for kind {kind!r} in this version; "
            "it must be continuous or at_jumps.",
            "output.measured",
        )
    for name, why in idle_gains(plant).items():
        if np.any(problem.gains.get(name, 0)):
            raise InputError(f"observer.gains.{name} must be zero: {why}; got nonzero entries.")


def given_gain(problem: Problem, name: str) -> Any:
    """The gain as it is given; zeros where nothing is measured; None when it is left open."""
    if name in problem.gains:
        return problem.gains[name]
    plant = problem.plant
    return np.zeros((plant.n, plant.p)) if name in idle_gains(plant) else None
