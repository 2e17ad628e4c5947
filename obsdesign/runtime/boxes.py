"""Boxes of states, disturbances and noise, as observers with bounds read them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.base import vector


def midpoint(lower: Matrix, upper: Matrix) -> tuple[Matrix, Matrix]:
    """Centre and radius of a box; the radius is rounded up so that the box is contained."""
    centre = lower + (0.5 * upper - 0.5 * lower)
    radius = np.maximum(upper - centre, centre - lower)
    return centre, np.where(lower == upper, 0.0, np.nextafter(radius, np.inf))


def initial_bounds(n: int, lower: ArrayLike, upper: ArrayLike) -> tuple[Matrix, Matrix]:
    """Bounds of x as two vectors (n,); ValueError unless they are finite and not crossed."""
    low, high = vector(lower, n, "lower"), vector(upper, n, "upper")
    for i in np.flatnonzero(~(np.isfinite(low) & np.isfinite(high))):
        raise ValueError(
            f"initial bounds of x{i + 1} must be finite numbers; got {low[i]:g}, {high[i]:g}."
        )
    for i in np.flatnonzero(low > high):
        raise ValueError(f"initial bounds of x{i + 1}: lower {low[i]:g} exceeds upper {high[i]:g}.")
    return low, high
