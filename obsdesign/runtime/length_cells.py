"""Cells of lengths of steps, short enough for power series.

Lengths between two powers of two are divided into equal cells, so short that |N| |h - c| <= 1/2 of
their middle c: |N| is the norm of a flow in balanced units. Cells do not depend on the lengths
that came before.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.units import balance, reachable

# (exponent of the lengths, place among the cells of that exponent)
Place = tuple[int, int]
# of the lengths between two powers of two; with more, steps are too long for any to share a cell
MOST_CELLS = 64
# in place of 0 where powers of a place are taken by its logarithm
NEXT_TO_ZERO = 1e-300
# shorter steps, next to underflow, have no cells
_SHORTEST = 2.0**-1000


class LengthCells:
    """Cells for flows of norm `norm`; where norm * h is far above one, lengths have none.

    most: cells between two powers of two.
    """

    def __init__(self, norm: float, most: int = MOST_CELLS) -> None:
        self._norm, self._most = norm, most
        # steps up to this length share cells
        self.longest = most / max(norm, 1e-300)
        # exponent of h -> its octave [span, 2 span), and cells per unit of length there
        self._octaves: dict[int, tuple[float, float]] = {}

    def place(self, h: float) -> tuple[Place, float] | None:
        """(cell, x), 0 <= x < 1, of h = middle + (2 x - 1) half > 0; None where it has no cell."""
        exponent = math.frexp(h)[1]
        span, density = self._octaves.get(exponent) or self._octave(exponent)
        if not density:
            return None
        within = (h - span) * density  # exact, like what follows
        number = int(within)
        return (exponent, number), within - number

    def places(self, lengths: Matrix) -> tuple[list[Place | None], Matrix]:
        """The cells of lengths (k,) and x (k,), each that of `place`; x = 0 where there is none."""
        exponents = np.frexp(lengths)[1]
        span, density = np.empty((2, len(lengths)))
        for exponent in np.unique(exponents).tolist():
            own = exponents == exponent
            span[own], density[own] = self._octaves.get(exponent) or self._octave(exponent)
        within = (lengths - span) * density
        numbers = np.floor(within)
        pairs = zip(exponents.tolist(), numbers.tolist(), (density > 0.0).tolist(), strict=True)
        cells = [(exponent, int(number)) if has else None for exponent, number, has in pairs]
        return cells, within - numbers

    def ends(self, place: Place) -> tuple[float, float]:
        """(middle, half the length) of a cell; half is a power of two."""
        exponent, number = place
        span, density = self._octaves.get(exponent) or self._octave(exponent)
        half = 0.5 / density
        return span + (2 * number + 1) * half, half

    def _octave(self, exponent: int) -> tuple[float, float]:
        """(span, density); density 0 where lengths would share no cell."""
        span = math.ldexp(0.5, exponent)
        size = span * self._norm
        count = 1 << max(math.ceil(size) - 1, 0).bit_length() if size <= self._most else 0
        if span < _SHORTEST:
            count = 0
        self._octaves[exponent] = span, count / span
        return self._octaves[exponent]


def from_left(coefficients: Matrix) -> Matrix:
    """Coefficients of powers of x = (s + 1) / 2, (k, ...), from those of powers of s."""
    return np.tensordot(_from_left(len(coefficients)), coefficients, axes=(0, 0))


@cache
def _from_left(terms: int) -> Matrix:
    """Coefficients of powers of x in the powers of s, (terms, terms)."""
    rows = np.eye(terms)
    for k in range(1, terms):
        rows[k] = 2.0 * np.roll(rows[k - 1], 1) - rows[k - 1]
    return rows


def flow_units(size: Matrix) -> Matrix:
    """Powers of two d, (n,), that balance a flow N, |N| <= size, in its own unit of time."""
    return balance(size / _rate(size))


def _rate(size: Matrix) -> float:
    """Of the states that depend on each other, one over their shortest time; 1 without any."""
    units, reach = balance(size), reachable(size != 0)
    rates = (units[:, None] * size / units)[reach & reach.T]
    return float(rates.max(initial=0.0)) or 1.0
