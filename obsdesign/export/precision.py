"""Numbers of the target: their unit roundoff, and rows of bounds rounded outward to them.

A row [s, -e] of a kernel (`runtime.interval.kernel`) gives s v - e |v| at most some lower bound for
every v, in exact arithmetic. A target adds N products in any order, fused or not, with the error

    |fl(a v) - a v| <= gamma |a| |v|,   gamma = N u / (1 - N u)

(N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., section 3.1). The row
[s', -e'] with s' = fl(s) and e' >= (e + |s - s'| + gamma |s'|) / (1 - gamma), computed on the
target, is then at most s v - e |v| again. Products that underflow, and subnormal numbers that a
target takes for zero, err by the smallest normal number times the other factor, or by itself: they
go to the column of the 1 in v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT, raised

# products of a row besides those with an entry of its own that is not zero
_MARGIN_TERMS = 2
# how far above the smallest normal number the smallest margins are
_ABOVE_UNDERFLOW = 2.0**40


@dataclass(frozen=True)
class Precision:
    """A floating-point type of C. unit: its unit roundoff; tiny: its smallest normal number."""

    name: str
    digits: int
    suffix: str
    limits: str
    dtype: type[np.floating]

    @property
    def unit(self) -> float:
        """Largest relative error of an operation."""
        return float(2.0**-self.digits)

    @property
    def tiny(self) -> float:
        """The smallest normal number."""
        return float(np.finfo(self.dtype).tiny)

    @property
    def largest(self) -> float:
        """The largest finite number."""
        return float(np.finfo(self.dtype).max)

    def nearest(self, values: Matrix) -> Matrix:
        """The nearest numbers of the target; subnormal ones are zero."""
        with np.errstate(over="ignore"):
            near = np.asarray(values, dtype=self.dtype).astype(np.float64)
        return np.where(np.abs(near) < self.tiny, 0.0, near)

    def above(self, values: Matrix) -> Matrix:
        """Numbers of the target that are not below `values` >= 0, zero or far above underflow.

        Products with them would be subnormal, which takes many processors a hundred times as long.
        """
        least = _ABOVE_UNDERFLOW * self.tiny
        with np.errstate(over="ignore"):
            near = np.asarray(np.maximum(values, np.where(values > 0, least, 0.0)), self.dtype)
            upper = np.nextafter(near, self.dtype(np.inf))
        return np.where(near.astype(np.float64) < values, upper, near).astype(np.float64)

    def literal(self, value: float) -> str:
        """The nearest number of the target as a hexadecimal constant of C99."""
        value = float(self.dtype(value))
        if value == 0.0:
            return f"0.0{self.suffix}"
        mantissa, exponent = value.hex().split("p")
        return f"{mantissa.rstrip('0').rstrip('.')}p{exponent}{self.suffix}"


PRECISIONS = {
    "double": Precision("double", 53, "", "DBL", np.float64),
    "float": Precision("float", 24, "f", "FLT", np.float32),
}


def gamma(terms: NDArray[np.int_], unit: float) -> Matrix:
    """Relative error of a sum of so many products in any order, rounded up."""
    share = (terms + _MARGIN_TERMS) * unit
    return np.asarray(share / (1.0 - share) * (1.0 + 8.0 * UNIT))


def outward(rows: Matrix, sign: float, target: Precision) -> Matrix:
    """Rows [s, sign e] of bounds as rows of the target, (k, 2 middle).

    sign: -1 of lower bounds, 1 of upper ones. Those of binary64 are the rows themselves, which
    cover any order of their products.
    """
    if target.dtype is np.float64:
        return rows
    signed, error = np.hsplit(rows, 2)
    near, error = target.nearest(signed), sign * error
    terms = 2 * np.count_nonzero((signed != 0.0) | (error != 0.0), axis=1)
    share = gamma(terms, target.unit)[:, None]
    # binary64 itself may be off by a gamma of its own: the bounds enclose those as well
    needed = error + np.abs(signed - near) + (share + gamma(terms, UNIT)[:, None]) * np.abs(near)
    needed = np.where((signed == 0.0) & (error == 0.0), 0.0, raised(needed, 4) / (1.0 - 2 * share))
    size = np.abs(near).sum(axis=1) + needed.sum(axis=1)
    lost = target.tiny * (2.0 * terms + 2.0 * size)
    needed[:, -1] = np.where(terms > 0, needed[:, -1] + lost, 0.0)
    return np.hstack([near, sign * target.above(np.where(needed > 0, raised(needed, 4), 0.0))])


def covered(rows: Matrix, sign: float, target: Precision) -> float:
    """Smallest part of its errors that a row covers: at least 1 where all rounding is inside.

    rows: of the target, as `outward` gives them.
    """
    near, error = np.hsplit(rows, 2)
    error = sign * error
    terms = np.count_nonzero(near, axis=1) + np.count_nonzero(error, axis=1)
    rounding = gamma(terms, target.unit)[:, None] * (np.abs(near) + error)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(rounding > 0, error / rounding, np.inf)
    return float(shares.min(initial=np.inf))
