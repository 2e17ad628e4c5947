"""The box around the image of a box, exactly rounded outward."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from lmi.arithmetic.arrays import Matrix


def image_box(columns: Matrix, lower: Matrix, upper: Matrix) -> tuple[Matrix, Matrix]:
    """The smallest binary64 box around all columns @ w, lower <= w <= upper; (n,) each."""
    ends = [[_extreme(row, (lower, upper), sign) for row in columns] for sign in (-1, 1)]
    return np.array(ends[0]), np.array(ends[1])


def _extreme(row: Matrix, box: tuple[Matrix, Matrix], sign: int) -> float:
    """The least (sign -1) or largest (sign 1) value of row @ w, rounded outward."""
    total = Fraction(0)
    for entry, low, high in zip(row.tolist(), box[0].tolist(), box[1].tolist(), strict=True):
        end = high if sign * entry > 0 else low
        total += Fraction(entry) * Fraction(end)
    nearest = float(total)
    is_inside = sign * (total - Fraction(nearest)) > 0
    return math.nextafter(nearest, sign * math.inf) if is_inside else nearest
