"""Options of the unknown-input observer that synthesis and verification read the same way."""

from __future__ import annotations

from typing import Any

import numpy as np

from obsdesign.equations.unknown_input.gains import SMOOTHING

# samples that `fixed_lag` waits for: with windows of three lags about as good as `batch`
LAG = 10


def reason_against_plant(plant: Any) -> str | None:
    """Return why the observer cannot serve a plant at all, or None; one sentence."""
    if plant.jump is not None:
        return (
            "[jump] must be absent for kind 'unknown_input': its equations hold between jumps "
            "only. Drop [jump], or choose kind luenberger and bound d as flow.disturbance."
        )
    return None


def differentiator(problem: Any) -> str:
    """Return the differentiator: `fixed_lag` where all outputs have noise, else `cell`."""
    noisy = bool(np.all(problem.plant.output.noise_std > 0))
    return str(problem.options.get("differentiator", "fixed_lag" if noisy else "cell"))


def differentiation(problem: Any, differentiator: str) -> dict[str, Any]:
    """A differentiator as a design stores it: its name, its entries about the noise, its lag."""
    stored: dict[str, Any] = {"differentiator": differentiator}
    if differentiator in SMOOTHING:
        stored["noise_std"] = problem.plant.output.noise_std
    if problem.plant.output.noise_centre is not None:
        stored["noise_centre"] = problem.plant.output.noise_centre
    if differentiator == "fixed_lag":
        stored["lag"] = problem.options.get("lag", LAG)
    return stored
