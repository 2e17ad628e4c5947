"""The rival explanation of an impulse train: one constant input along jump.H.

A constant output above what the plant holds by itself is what a steady input w along jump.H leaves,
and a train of impulses imitates it as closely as few samples show. So the samples since the last
impulse that stands for itself are explained twice: by impulses, and by x' = A x + B u + b_mid + H w
with one unknown constant w. An impulse that is not clearly ahead has a doubt. Not in the paper.

The filter is affine in w, x(w) = x + sensitivity w, and so are its scaled innovations: the best w
and its chi-squared follow from three sums.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.runtime.impulsive_input.samples.filter import Filtered, Row, SampledPlant
from obsdesign.runtime.state_marks import States

STEADY = "a steady input explains the record about as well"


@dataclass(frozen=True, slots=True)
class Steady:
    """A filter without impulses, at a row; sensitivity (n,): d x / d w.

    Of the scaled innovations so far: the sum of their squares, of their products with their slopes
    in w, and of the squares of these. rival: what the impulses leave of the same samples.
    """

    at: Filtered
    sensitivity: States
    squares: float = 0.0
    products: float = 0.0
    slopes: float = 0.0
    rival: float = 0.0

    @classmethod
    def begin(cls, at: Filtered) -> Steady:
        """The steady input begins at this row."""
        return cls(at, np.zeros(len(at.x)))

    def cost(self, nonnegative: bool) -> float:
        """Chi-squared of the best steady input."""
        if self.slopes <= 0 or (nonnegative and self.products <= 0):
            return self.squares
        return self.squares - self.products**2 / self.slopes

    def after(self, plant: SampledPlant, row: Row, rival: float) -> Steady:
        """At the next row, of which the impulses leave `rival`."""
        at = plant.after(self.at, row)
        once = plant.step(row.t - self.at.row.t)[1]
        sensitivity = at.flow @ self.sensitivity + once @ plant.H[:, 0]
        slope = at.shown @ sensitivity  # the scaled innovation is `innovation` - slope w
        return Steady(
            at=at,
            sensitivity=at.kept @ sensitivity,
            squares=self.squares + at.cost,
            products=self.products + float(slope @ at.innovation),
            slopes=self.slopes + float(slope @ slope),
            rival=self.rival + rival,
        )


@dataclass(frozen=True, slots=True)
class SteadyInputs:
    """Steady inputs since the last impulse that stands for itself, and since the last one."""

    long: Steady
    short: Steady

    @classmethod
    def begin(cls, at: Filtered) -> SteadyInputs:
        """Both begin at this row."""
        return cls(Steady.begin(at), Steady.begin(at))

    def after(self, plant: SampledPlant, row: Row, rival: float) -> SteadyInputs:
        """Both at the next row, of which the impulses leave `rival`."""
        return SteadyInputs(self.long.after(plant, row, rival), self.short.after(plant, row, rival))
