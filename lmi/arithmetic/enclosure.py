"""Matrices known up to an error: midpoint-radius arithmetic and its exponential, numpy only.

An `Enclosure` stands for every real matrix X with |X - mid| <= rad entrywise. Each operation
returns an enclosure of all results, the rounding of its own floating point included, so that a
bound computed from it is a bound for the exact matrix. It is the runtime's answer to "is this
exponential right?" where ball arithmetic (`lmi.arithmetic.balls`) is not installed.

Rounding model: a product of inner length k, summed in any order, errs by at most
k u / (1 - k u) |A||B| (N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed.,
section 3.5); midpoint-radius products as in S. M. Rump, Fast and parallel interval arithmetic,
BIT 39 (1999).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.units import balance, reachable

UNIT = 2.0**-53  # unit roundoff of binary64
TINY = 2.0**-1000  # covers every underflow: far above it, far below anything that matters
# Taylor remainder at ||X|| <= 1/2: 0.5**17 / 17! is below the unit roundoff by 2**-49.
_TAYLOR_DEGREE = 16
_FACTORIAL = float(math.factorial(_TAYLOR_DEGREE + 1))
_TAIL_DOUBLINGS = 5
_SCALED_NORM = 0.5
# part of every entry below which a remainder may be the same for all entries
_NEGLIGIBLE = 2.0**-45
_MODERATE = 16.0  # a norm that costs few squarings
_LARGEST_NORM = 2.0**46  # beyond, the squarings leave no digit that is certain


def raised(values: Matrix, terms: int) -> Matrix:
    """A bound that stays above `values` >= 0 although `terms` roundings went into them."""
    return values * (1.0 + (2 * terms + 8) * UNIT) + TINY


@dataclass(frozen=True)
class Enclosure:
    """All real arrays X with |X - mid| <= rad; `mid` and `rad` have the same shape."""

    mid: Matrix
    rad: Matrix

    @staticmethod
    def exactly(values: ArrayLike) -> Enclosure:
        """The stored numbers themselves, without any error."""
        mid = np.asarray(values, dtype=np.float64)
        return Enclosure(mid, np.zeros_like(mid))

    @property
    def magnitude(self) -> Matrix:
        """Upper bound of |X|."""
        return raised(np.abs(self.mid) + self.rad, 1)

    @property
    def upper(self) -> Matrix:
        """Upper bound of X."""
        return np.nextafter(self.mid + self.rad, np.inf)

    def __add__(self, other: Enclosure) -> Enclosure:
        mid = self.mid + other.mid
        return Enclosure(mid, raised(self.rad + other.rad + UNIT * np.abs(mid), 3))

    def __neg__(self) -> Enclosure:
        return Enclosure(-self.mid, self.rad)

    def __sub__(self, other: Enclosure) -> Enclosure:
        return self + (-other)

    def __matmul__(self, other: Enclosure) -> Enclosure:
        terms = self.mid.shape[-1]
        size, other_size = np.abs(self.mid), np.abs(other.mid)
        rounding = (terms + 2) * UNIT * (size @ other_size)
        rad = size @ other.rad + self.rad @ (other_size + other.rad) + rounding
        return Enclosure(self.mid @ other.mid, raised(rad, 2 * terms + 4))

    def scaled(self, factor: float, error: float = 0.0) -> Enclosure:
        """factor * X for every factor within `error` of the given one."""
        mid, size = self.mid * factor, np.abs(self.mid)
        rad = self.rad * (abs(factor) + error) + size * error + UNIT * np.abs(mid)
        return Enclosure(mid, np.where(size + self.rad > 0, raised(rad, 5), 0.0))


def stack(rows: list[list[Enclosure]]) -> Enclosure:
    """Block matrix of enclosures, as `numpy.block`."""
    return Enclosure(
        np.block([[block.mid for block in row] for row in rows]),
        np.block([[block.rad for block in row] for row in rows]),
    )


def powers(X: Enclosure, count: int) -> Enclosure:
    """I, X, ..., X^(count-1), (count, n, n), by doubling: few factors keep the radii small."""
    result = Enclosure.exactly(np.eye(len(X.mid))[None])
    with np.errstate(over="ignore", invalid="ignore"):
        while len(result.mid) < count:
            more = result @ X
            result = Enclosure(
                np.concatenate([result.mid, more.mid]), np.concatenate([result.rad, more.rad])
            )
            X = X @ X
    return Enclosure(result.mid[:count], result.rad[:count])


def inverse(values: Matrix) -> Enclosure:
    """Enclosure of the inverse of a square matrix, exactly as stored.

    With an approximate inverse R and E = I - R X, X^-1 = (I - E)^-1 R, so that
    |X^-1 - R| <= |E| |R| + |E|^2 (I - |E|)^-1 |R|. ValueError if X is singular, or nearly so.
    """
    n = len(values)
    try:
        R = Enclosure.exactly(np.linalg.inv(values))
    except np.linalg.LinAlgError:
        raise ValueError("a singular matrix has no inverse") from None
    E = (Enclosure.exactly(np.eye(n)) - R @ Enclosure.exactly(values)).magnitude
    norm = float(np.max(E.sum(axis=1), initial=0.0))
    if not norm < 0.5:
        raise ValueError("the matrix is too close to a singular one for its inverse to be certain")
    size = np.abs(R.mid)
    # sums of powers of norm <= 1/2
    remainder = 4.0 * norm * norm * np.max(size, axis=0, initial=0.0)
    return Enclosure(R.mid, raised(E @ size + remainder, 2 * n + 6))


def expm(matrix: Enclosure) -> Enclosure:
    """Enclosure of e^X for every X in a square enclosure; scaling, Taylor series, squaring.

    Entries that vanish for every X of this sparsity stay exactly zero. Overflow gives infinite
    or NaN radii, never a finite wrong answer.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.abs(matrix.mid) + matrix.rad
        scales, pattern = _scales(size), reachable(size > 0)
        balanced = similar(matrix, scales)
        norm = float(np.max(np.sum(balanced.magnitude, axis=0), initial=0.0))
        if not np.isfinite(norm) or norm > _LARGEST_NORM:
            return Enclosure(np.zeros_like(matrix.mid), np.full_like(matrix.rad, np.inf))
        squarings = max(0, int(np.ceil(np.log2(norm / _SCALED_NORM))) if norm > 0 else 0)
        result = _taylor(balanced.scaled(2.0**-squarings), pattern, even=bool((scales == 1).all()))
        for _ in range(squarings):
            result = result @ result
        result = similar(result, 1.0 / scales)
    return Enclosure(np.where(pattern, result.mid, 0.0), np.where(pattern, result.rad, 0.0))


def exponential_terms(start: Enclosure, step: Enclosure, reach: float) -> tuple[Matrix, Matrix]:
    """Coefficients (17, ..., n, n) of E e^{X s} in s, and a radius (..., n, n), |s| <= reach.

    E in `start`, X in `step`, of norm at most 1 / (2 reach).
    """
    term, mids = start, [start.mid]
    rad = start.rad
    for k in range(1, _TAYLOR_DEGREE + 1):
        term = (term @ step).scaled(1.0 / k, UNIT / k)
        mids.append(term.mid)
        rad = rad + reach**k * term.rad
    size = reach * step.magnitude
    largest = size.reshape(-1, *size.shape[-2:]).max(axis=0)
    norm = float(np.max(np.sum(largest, axis=0), initial=0.0))
    tail = start.magnitude @ _tail(largest, norm)
    return np.array(mids), raised(rad + tail, 4 * _TAYLOR_DEGREE + 2 * len(largest))


def _scales(size: Matrix) -> Matrix:
    """Powers of two d: units of states and inputs should not cost squarings, D X D^-1 is small.

    One where the norm is moderate: entries err in parts of themselves, in any units.
    """
    largest = float(size.max(initial=0.0))
    if not (np.isfinite(largest) and largest > _MODERATE):
        return np.ones(len(size))
    return balance(size)


def similar(matrix: Enclosure, scales: Matrix) -> Enclosure:
    """Return D X D^-1 for D = diag(scales), powers of two: exact but for underflow."""
    factors = scales[:, None] / scales[None, :]
    rad = matrix.rad * factors
    nonzero = (matrix.mid != 0) | (matrix.rad > 0)
    return Enclosure(matrix.mid * factors, np.where(nonzero, rad + TINY, rad))


def _taylor(matrix: Enclosure, pattern: NDArray[np.bool_], even: bool) -> Enclosure:
    """Series of e^X; even: one remainder may do for all entries where it is small in each."""
    identity = Enclosure.exactly(np.eye(len(matrix.mid)))
    result = identity
    for k in range(_TAYLOR_DEGREE, 0, -1):
        result = identity + (matrix @ result).scaled(1.0 / k, UNIT / k)
    size = matrix.magnitude
    norm = float(np.max(np.sum(size, axis=0), initial=0.0))
    # the tail of the series is at most twice its first term, as norm <= 1/2
    remainder: float | Matrix = 2.0 * norm ** (_TAYLOR_DEGREE + 1) / _FACTORIAL
    if not even or (remainder > _NEGLIGIBLE * np.abs(result.mid))[pattern].any():
        remainder = np.where(pattern, _tail(size, norm), 0.0)
    return Enclosure(result.mid, raised(result.rad + remainder, 4))


def _tail(size: Matrix, norm: float) -> Matrix:
    """Bound of the sum of N^k / k!, k > 16, entry by entry; N = size.

    At most N^17 / 17! times the sum of (N / 18)^j. The powers j >= 64 are bounded by the norm,
    which is at most 1/2: 2^-380 of the largest entry.
    """
    n, degree = len(size), _TAYLOR_DEGREE + 1
    first = np.linalg.matrix_power(size, degree) / _FACTORIAL
    power = size / (degree + 1)
    series = np.eye(n) + power
    for _ in range(_TAIL_DOUBLINGS):
        power = power @ power
        series = series + series @ power
    share = norm / (degree + 1)
    remainder = 2.0 * norm**degree * share ** (2 ** (_TAIL_DOUBLINGS + 1)) / _FACTORIAL
    # a product of `degree` factors, and 2^(doublings + 1) more, each with n + 2 roundings
    return raised(first @ series + remainder, (degree + 2 ** (_TAIL_DOUBLINGS + 2)) * (n + 2))
