"""The jump of a point estimate, and the refusal of one where the plant has none."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.equations.gains import PlantGains
from obsdesign.runtime.base import Vector, vector


def no_jumps() -> ValueError:
    """The refusal of a sample that says jump, for a plant without jumps."""
    return ValueError("this plant has no jumps ([jump] is absent), but a sample says jump.")


def corrected_jump(
    gains: PlantGains,
    x: Vector,
    w: ArrayLike | None,
    y: Vector | None = None,
    M: Vector | None = None,
) -> Vector:
    """x after a jump with the correction M (y - C x), x before or after it as y is measured.

    Without correction where y or M is missing. ValueError where w has another size than E has
    columns.
    """
    after = gains.jump_matrix @ x + gains.jump_drift
    if gains.E is not None and w is not None:
        after = after + gains.E @ vector(w, gains.E.shape[1], "w")
    if y is None or M is None or gains.jump_measurement == "none":
        return np.asarray(after)
    expected = gains.C @ (after if gains.jump_measurement == "after" else x)
    return np.asarray(after + M @ (y - expected))
