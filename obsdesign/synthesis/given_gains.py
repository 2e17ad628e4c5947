"""Gains that a problem gives, and what every kind with L and M asks of them."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from obsdesign.equations.estimation_error import idle_gains
from obsdesign.errors import DoesNotApply, InputError, LimitError
from obsdesign.problem import Problem

# products of such entries would overflow
_LARGEST = 1e100


def refuse_beyond_floats(problem: Problem, found: Collection[str]) -> None:
    """LimitError where gains are to be found, these, and products of entries would overflow."""
    plant = problem.plant
    entries = {"flow.A": plant.flow.A} | ({} if plant.jump is None else {"jump.G": plant.jump.G})
    for name, values in entries.items():
        largest = float(np.abs(values).max())
        if found and largest > _LARGEST:
            raise LimitError(
                f"{name} must not exceed {_LARGEST:g} where gains are to be found; got "
                f"{largest:g}. Is it in the plant's units?"
            )


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
