"""Choices of the unknown-input observer that synthesis and verification make the same way."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from obsdesign.equations.unknown_input.gains import SMOOTHING

# why the observer cannot serve a plant with jumps
REASON_AGAINST_JUMPS = (
    "[jump] and [[event]] must be absent for kind 'unknown_input': its equations hold between "
    "jumps only. Drop them, or choose kind luenberger and bound d as flow.disturbance."
)


def differentiator(stated: str | None, noise_std: Matrix) -> str:
    """Return the stated differentiator, else `fixed_lag` where all outputs have noise or `cell`."""
    return stated or ("fixed_lag" if np.all(noise_std > 0) else "cell")


def differentiation(
    name: str, noise_std: Matrix, noise_centre: Matrix | None, lag: int
) -> NewEntries:
    """A differentiator as a design stores it: its name, its entries about the noise, its lag."""
    stored: NewEntries = {
        "differentiator": name,
        "noise_std": noise_std if name in SMOOTHING else None,
        "noise_centre": noise_centre,
        "lag": lag if name == "fixed_lag" else None,
    }
    return {entry: value for entry, value in stored.items() if value is not None}
