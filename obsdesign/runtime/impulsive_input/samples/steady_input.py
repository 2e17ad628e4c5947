"""What impulses have to be told from: a steady input in their direction.

A constant output above what the plant holds by itself is what a steady input w along jump.H leaves,
and a train of impulses imitates it as closely as few samples show. So the samples since the last
impulse that stands for itself are explained twice: by impulses, and by x' = A x + B u + b_mid + H w
with one unknown constant w. An impulse that is not clearly ahead says so. Not in the paper.

The filter is affine in w, x(w) = x + moved w, and so are its scaled innovations: the best w and
what it leaves follow from three sums.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.runtime.base import Vector
from obsdesign.runtime.impulsive_input.samples.filter import Filtered, Row, SampledPlant

Array = NDArray[Any]

STEADY = "a steady input explains the record about as well"


@dataclass(frozen=True, slots=True)
class Steady:
    """A filter that knows of no impulse, at a row; moved (n,): d x / d w.

    sums: of squares of scaled innovations, of products with their slopes in w, of slopes' squares.
    rival: what the impulses leave of the same samples.
    """

    at: Filtered
    moved: Vector
    sums: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rival: float = 0.0

    @classmethod
    def begin(cls, at: Filtered) -> Steady:
        """The steady input begins at this row."""
        return cls(at, np.zeros(len(at.x)))

    def cost(self, nonnegative: bool) -> float:
        """What the best steady input leaves, to be compared with chi-squared."""
        whole, product, size = self.sums
        if size <= 0 or (nonnegative and product <= 0):
            return whole
        return whole - product**2 / size

    def after(self, plant: SampledPlant, row: Row, rival: float) -> Steady:
        """At the next row, of which the impulses leave `rival`."""
        at = plant.after(self.at, row)
        once = plant.step(self.at.row.t, row.t)[1]
        moved = at.flow @ self.moved + once @ plant.H[:, 0]
        slope = at.shown @ moved  # the scaled innovation is surprise - slope w
        whole, product, size = self.sums
        sums = (whole + at.cost, product + float(slope @ at.surprise), size + float(slope @ slope))
        return Steady(at, at.kept @ moved, sums, self.rival + rival)
