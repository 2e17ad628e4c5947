"""Requirements on plants with unknown impulses, and operators that a problem leaves open."""

from __future__ import annotations

import numpy as np

from obsdesign.equations.impulsive_input.gains import LARGEST, SMALLEST
from obsdesign.equations.plant import Output
from obsdesign.problem.options import ImpulsiveInputOptions
from obsdesign.problem.plant import Jump, Plant
from obsdesign.problem.problem import Problem

# squares of what an impulse makes of y are multiplied with each other
_LEAST_OUTPUT = 1e-70


def reason_against_jumps(jump: Jump, n: int) -> str | None:
    """Return what else than impulses happens at the jumps of a plant with n states, or None."""
    if not np.array_equal(jump.G, np.eye(n)):
        return (
            "jump.G must be the identity for kind 'impulsive_input': impulses add to the state at "
            "unknown times, and nothing else may happen then. Leave jump.G out."
        )
    if jump.E is not None:
        return (
            "jump.E is refused by kind 'impulsive_input': jump times are unknown, so that no known "
            "input can act at them."
        )
    return None


def reason_against_sizes(plant: Plant) -> str | None:
    """Return which number of a plant floats cannot square, or None."""
    output, jump = plant.output, plant.jump
    entries = {
        "flow.A": plant.flow.A,
        "jump.H": np.zeros(0) if jump is None or jump.H is None else jump.H,
        "output.C": output.C,
        "output.noise_std": output.noise_std,
        "output.noise_cv": output.noise_cv,
    }
    for name, values in entries.items():
        sizes = np.abs(values[values != 0])
        least = SMALLEST if "noise" in name else 0.0
        wrong = sizes[(sizes > LARGEST) | (sizes < least)]
        largest = float(sizes.max(initial=0.0))
        allowed = ""
        if len(wrong):
            largest = float(wrong[0])
            bound = f"between {least:g} and {LARGEST:g}" if least else f"at most {LARGEST:g}"
            allowed = f"0, or {bound}" if least else bound
        elif name in ("output.C", "jump.H") and 0 < largest < _LEAST_OUTPUT:
            allowed = f"0, or at least {_LEAST_OUTPUT:g}"
        if allowed:
            return (
                f"{name} must be {allowed} in size for kind 'impulsive_input', which squares it; "
                f"got {largest:g}. Are the units what they should be?"
            )
    return None


def reason_against_noise(output: Output) -> str | None:
    """Return which output is exact beside others with noise, or None.

    It would outweigh them without limit, by rounding alone.
    """
    silent = (output.noise_std == 0) & (output.noise_cv == 0)
    if silent.all() or not silent.any():
        return None
    return (
        "output.noise_std (or noise_cv) must be > 0 for every output or for none, kind "
        f"'impulsive_input'; got 0 for output {np.flatnonzero(silent)[0] + 1}, beside others with "
        "noise. State its resolution."
    )


def integral_entries(problem: Problem) -> list[str]:
    """Names of the entries of a problem that only operator `integral` uses."""
    options = problem.options_as(ImpulsiveInputOptions)
    names = (
        "exponents", "ratio", "threshold", "smallest_weight", "uncertainty", "poles", "weights",
    )  # fmt: skip
    stated = [name for name in names if options.is_stated(name)]
    return stated + (["gains.K"] if "K" in problem.gains else [])


def operator_is_open(problem: Problem) -> bool:
    """Whether the problem leaves the operator open and both are possible."""
    options = problem.options_as(ImpulsiveInputOptions)
    periodic = problem.plant.output.measured == "periodic"
    return periodic and options.operator is None and not integral_entries(problem)
