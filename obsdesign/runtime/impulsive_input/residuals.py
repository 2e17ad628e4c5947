"""Residuals of a record against the stated noise, and the factor of deviations that follows.

Under the model what a fit leaves of whitened samples is chi-squared. Where it is significantly
more, plant or noise are not what the design says; deviations, which rest on both, are then
multiplied by the Birge ratio sqrt(chi-squared / degrees of freedom) (R. T. Birge, Phys. Rev. 40,
207, 1932), and the status says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from obsdesign.runtime.impulsive_input.whitening import chi_squared_limit

LARGER = "residuals larger than the noise"
# of chi-squared to its degrees of freedom: below it deviations are off by less than 5 per cent
_LEAST_RATIO = 1.1


@dataclass(frozen=True, slots=True)
class Residuals:
    """Chi-squared of the rows and windows so far, and its degrees of freedom.

    Each counts at most its own 0.999 quantile: one bad row, or a window with two impulses, does
    not widen all later deviations.
    """

    cost: float = 0.0
    freedom: int = 0

    def joined(self, cost: float, freedom: int) -> Residuals:
        """Add a further row or window."""
        if freedom < 1:
            return self
        counted = min(cost, chi_squared_limit(freedom))
        return Residuals(self.cost + counted, self.freedom + freedom)

    @property
    def ratio(self) -> float:
        """The Birge ratio, 1 where it is not significantly larger."""
        if self.cost <= _LEAST_RATIO * self.freedom:
            return 1.0
        return birge_ratio(self.cost, self.freedom)


def birge_ratio(cost: float, freedom: int) -> float:
    """sqrt(cost / freedom) where the cost is beyond the 0.999 quantile of chi-squared, else 1."""
    return math.sqrt(cost / freedom) if cost > chi_squared_limit(freedom) else 1.0
