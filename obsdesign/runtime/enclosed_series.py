"""Matrices as functions of the length of a step, enclosed over a cell of lengths.

A `Series` stands for all functions F of s with |F(s) - sum_k s^k mid[k]| <= rad entrywise for
|s| <= REACH; h = middle + s half are the lengths of a cell (`length_cells`). Each operation returns
an enclosure of all results, its own rounding included, as in `lmi.arithmetic.enclosure`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import (
    TINY,
    UNIT,
    Enclosure,
    expm,
    exponential_terms,
    powers,
    raised,
    similar,
)
from lmi.arithmetic.units import reachable
from obsdesign.runtime.length_cells import flow_units

TERMS = 17
# lengths a little beyond the ends of a cell are included: those of a step whose stamps are rounded
REACH = 1.0625
EXPONENTS = np.arange(float(TERMS))
_REACHES = REACH**EXPONENTS


class Cell(NamedTuple):
    """Lengths middle + s half, |s| <= 1; half is a power of two."""

    middle: float
    half: float


@dataclass(frozen=True)
class Series:
    """mid: (TERMS, ..., n, m); rad: (..., n, m)."""

    mid: Matrix
    rad: Matrix

    @staticmethod
    def constant(values: Enclosure) -> Series:
        """A matrix that does not depend on the length."""
        mid = np.zeros((TERMS, *values.mid.shape))
        mid[0] = values.mid
        return Series(mid, values.rad)

    @cached_property
    def size(self) -> Matrix:
        """Upper bound of the absolute value of the polynomial, without `rad`."""
        return raised(weighed(_REACHES, np.abs(self.mid)), 2 * TERMS)

    def __add__(self, other: Series) -> Series:
        rad = self.rad + other.rad + UNIT * (self.size + other.size)
        return Series(self.mid + other.mid, raised(rad, 4))

    def __neg__(self) -> Series:
        return Series(-self.mid, self.rad)

    def __sub__(self, other: Series) -> Series:
        return self + (-other)

    def __getitem__(self, key: tuple[slice, slice]) -> Series:
        """A part of the last axes."""
        rows, columns = key
        return Series(self.mid[..., rows, columns], self.rad[..., rows, columns])

    def left_product(self, left: Enclosure) -> Series:
        """Return the product with left, a constant."""
        terms, size, weight = self.rad.shape[-2], self.size, np.abs(left.mid)
        rad = weight @ self.rad + left.rad @ (size + self.rad)
        rad = rad + (terms + 2) * UNIT * (weight @ size)
        return Series(left.mid @ self.mid, raised(rad, 2 * terms + 6))

    def right_product(self, right: Enclosure) -> Series:
        """Return the product with right, a constant."""
        terms, size, weight = self.rad.shape[-1], self.size, np.abs(right.mid)
        rad = self.rad @ weight + (size + self.rad) @ right.rad
        rad = rad + (terms + 2) * UNIT * (size @ weight)
        return Series(self.mid @ right.mid, raised(rad, 2 * terms + 6))

    def times(self, other: Series) -> Series:
        """Products of matrices; powers of s that are left out go into the radius."""
        mid = self.mid[0] @ other.mid
        for k in range(1, TERMS):
            mid[k:] += self.mid[k] @ other.mid[: TERMS - k]
        sizes = [_column(_REACHES, each.mid) * np.abs(each.mid) for each in (self, other)]
        tails = np.cumsum(sizes[1][::-1], axis=0)  # sums of the last 1, 2, ...
        omitted = (sizes[0][1:] @ tails[: TERMS - 1]).sum(axis=0)
        size, other_size = self.size, other.size
        terms = self.rad.shape[-1] + TERMS
        rad = size @ other.rad + self.rad @ (other_size + other.rad)
        rad = rad + omitted + (terms + 2) * UNIT * (size @ other_size)
        return Series(mid, raised(rad, 3 * terms))

    def signs(self) -> Matrix:
        """Sign of each entry for |s| <= REACH, 0 of no more than `rad`, NaN where it changes."""
        flat = self.mid.reshape(TERMS, -1)
        error = self.rad.reshape(-1) + 64 * UNIT * (np.abs(_bernstein()) @ np.abs(flat)).max(axis=0)
        values = _bernstein() @ flat
        signs = np.where(values.min(axis=0) > error, 1.0, np.nan)
        signs = np.where(values.max(axis=0) < -error, -1.0, signs)
        return np.asarray(np.where(flat.any(axis=0), signs, 0.0).reshape(self.rad.shape))

    def enclosure(self, s: float, reach: float = 0.0) -> Enclosure:
        """The matrix at s, -1 <= s <= 1, and at all within reach < REACH - 1 of it."""
        if reach not in self._errors:
            error = self.rad + 2 * TERMS * UNIT * self.size
            error = error + weighed(growth(reach), np.abs(self.mid))
            self._errors[reach] = raised(error, 2 * TERMS)
        return Enclosure(weighed(s**EXPONENTS, self.mid), self._errors[reach])

    @cached_property
    def _errors(self) -> dict[float, Matrix]:
        """Radii of `enclosure` for each reach."""
        return {}


def growth(reach: float) -> Matrix:
    """Bounds of |(s + e)^k - s^k| for |s| <= 1, |e| <= reach, k < TERMS, rounded up."""
    return np.asarray(np.expm1(EXPONENTS * np.log1p(reach)) * (1.0 + 64 * UNIT))


def weighed(weights: Matrix, stack: Matrix) -> Matrix:
    """Sum of weights[k] stack[k]."""
    shape = stack.shape[1:]
    total: Matrix = weights.dot(stack.reshape(len(stack), math.prod(shape))).reshape(shape)
    return total


@dataclass(frozen=True)
class Flow:
    """x' = N x, its exponential as series for each cell. N: (n, n)."""

    N: Enclosure

    def exponential(self, cell: Cell) -> Series:
        """e^{N h} for the lengths of a cell."""
        balanced, scales = self._balanced
        start = expm(balanced.scaled(cell.middle))
        return self._of_terms(start, balanced.scaled(cell.half), scales)

    def exponentials(self, cell: Cell, pieces: int) -> Series:
        """e^{N h j / pieces}, j = 0 .. pieces - 1, (pieces, n, n); pieces: a power of two."""
        balanced, scales = self._balanced
        start = powers(expm(balanced.scaled(cell.middle / pieces)), pieces)
        step, counts = balanced.scaled(cell.half / pieces), np.arange(pieces)[:, None, None]
        rad = counts * step.rad + UNIT * counts * np.abs(step.mid)
        return self._of_terms(start, Enclosure(counts * step.mid, raised(rad, 4)), scales)

    @property
    def norm(self) -> float:
        """Norm of N in balanced units: where half is at most 1 / (2 REACH norm) there are series.

        half: of the cell.
        """
        return float(self._balanced[0].magnitude.sum(axis=0).max(initial=0.0))

    @cached_property
    def _balanced(self) -> tuple[Enclosure, Matrix]:
        """N in balanced units, and these."""
        scales = flow_units(self._size)
        return similar(self.N, scales), scales

    @cached_property
    def _pattern(self) -> NDArray[np.bool_]:
        return reachable(self._size > 0)

    @cached_property
    def _size(self) -> Matrix:
        """Upper bound of |N|, zero where N is."""
        return np.where((self.N.mid == 0) & (self.N.rad == 0), 0.0, self.N.magnitude)

    def _of_terms(self, start: Enclosure, step: Enclosure, scales: Matrix) -> Series:
        """E e^{X s}, E in start and X in step, in the units of N; zero where N leaves it zero."""
        mid, rad = exponential_terms(start, step, REACH)
        factors = np.where(self._pattern, scales / scales[:, None], 0.0)
        return Series(mid * factors, np.where(self._pattern, rad * factors + TINY, 0.0))


def _column(weights: Matrix, stack: Matrix) -> Matrix:
    """Weights for the first axis of a stack."""
    return weights.reshape(-1, *[1] * (stack.ndim - 1))


@cache
def _bernstein() -> Matrix:
    """From coefficients of powers of s to those in the Bernstein basis of |s| <= REACH.

    Row i, column k: the average of products of k of the numbers -REACH (degree - i times) and
    REACH (i times).
    """
    degree = TERMS - 1
    sums = [
        [
            sum(
                (-1) ** (k - m) * math.comb(i, m) * math.comb(degree - i, k - m)
                for m in range(k + 1)
            )
            / math.comb(degree, k)
            for k in range(TERMS)
        ]
        for i in range(TERMS)
    ]
    return np.array(sums) * _REACHES
