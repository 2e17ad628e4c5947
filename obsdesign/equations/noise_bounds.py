"""Bounds of the noise: symmetric ones, or pairs, as a centre and a radius."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix


def noise_box(bound: ArrayLike) -> tuple[Matrix | None, Matrix]:
    """(centre, radius) of bounds of the noise, (p,) or pairs (p, 2); all |v - centre| <= radius.

    centre: None where all bounds are symmetric.
    """
    values = np.asarray(bound, dtype=np.float64)
    if values.ndim == 1:
        return None, values
    lower, upper = values.T
    centre = lower + (0.5 * upper - 0.5 * lower)
    radius = np.maximum(_difference_up(upper, centre), _difference_up(centre, lower))
    return (centre if centre.any() else None), radius


def _difference_up(a: Matrix, b: Matrix) -> Matrix:
    """a - b, rounded up where it is rounded; by the error of a sum (Knuth, TAOCP 2, 4.2.2)."""
    difference = a - b
    virtual = difference - a
    error = (a - (difference - virtual)) - (b + virtual)
    return np.where(error > 0, np.nextafter(difference, np.inf), difference)
