"""Maps of a flow over steps of any length, from power series about a few lengths.

e^{N h} = e^{N c} e^{N (h - c)}: lengths are divided into cells, each with its middle c and the
coefficients of its series, so that a step of a length that was never met takes one product
instead of an exponential. A cell is so short that |N| |h - c| <= 1/2 in balanced units; what 16
terms leave is below 1e-18 of |e^{N c}|. Cells do not depend on the lengths that came before.
"""

from __future__ import annotations

import math
from collections import OrderedDict

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.units import balance, reachable
from obsdesign.equations.gains import PlantGains
from obsdesign.runtime.step_cache import cached_step

# lengths whose maps are kept
_RECENT = 1024
_TERMS = 16
_POWERS = np.arange(float(_TERMS))
# of the lengths between two powers of two; with more, steps are too long for any to share a cell
_MOST_CELLS = 64


class FlowCells:
    """The first `rows` rows of e^{N h}, for any h > 0.

    N: (k, k). Where |N| h is far above one, each length has its own exponential.
    """

    def __init__(self, N: Matrix, rows: int) -> None:
        units = balance(N / _rate(N))
        self._N = units[:, None] * N / units
        # zero where N leaves the map zero at any length: rounding does not
        self._scales = np.where(reachable(N != 0)[:rows], units / units[:rows, None], 0.0)
        self._shape = self._scales.shape
        self._norm = float(np.abs(self._N).sum(axis=1).max())
        # steps up to this length share cells, and entries of their maps are below 1e100
        self.longest = _MOST_CELLS / max(self._norm, 1e-300)
        # exponent of h -> its octave [span, 2 span), and cells per unit of length there
        self._octaves: dict[int, tuple[float, float]] = {}
        self._cells: OrderedDict[tuple[int, int], Matrix] = OrderedDict()
        self._recent: dict[float, Matrix] = {}

    def at(self, h: float) -> Matrix:
        """The map of a step, (rows, k); of equal steps the same array."""
        values = self._recent.get(h)
        if values is None:
            if len(self._recent) >= _RECENT:
                self._recent.clear()
            values = self._recent[h] = self._made(h)
        return values

    def _made(self, h: float) -> Matrix:
        exponent = math.frexp(h)[1]
        span, density = self._octaves.get(exponent) or self._octave(exponent)
        if not density:
            return self._scaled(expm(self._N * h))
        within = (h - span) * density  # exact, like what follows
        place = int(within)
        key = (exponent, place)
        series = self._cells.get(key)
        if series is None:
            series = cached_step(self._cells, key, self._series)
        values: Matrix = np.power(2.0 * (within - place) - 1.0, _POWERS).dot(series)
        return values.reshape(self._shape)

    def _octave(self, exponent: int) -> tuple[float, float]:
        """(span, density); density 0 where lengths would share no cell."""
        span = math.ldexp(0.5, exponent)
        size = span * self._norm
        count = 1 << max(math.ceil(size) - 1, 0).bit_length() if size <= _MOST_CELLS else 0
        self._octaves[exponent] = span, count / span
        return self._octaves[exponent]

    def _series(self, key: tuple[int, int]) -> Matrix:
        """Coefficients of the map at middle + s half, -1 <= s < 1, (_TERMS, rows k)."""
        exponent, place = key
        span, density = self._octaves[exponent]
        half = 0.5 / density
        term, terms = expm(self._N * (span + (2 * place + 1) * half)), list[Matrix]()
        term = term[: self._shape[0]]
        for k in range(_TERMS):
            terms.append(self._scaled(term).reshape(-1))
            term = term @ self._N * (half / (k + 1))
        return np.array(terms)

    def _scaled(self, values: Matrix) -> Matrix:
        """In the units of N as it is given."""
        return np.asarray(values[: self._shape[0]] * self._scales)


def free_cells(gains: PlantGains) -> FlowCells:
    """Steps of [x; u; 1] of a plant without any measurement: x' = A x + B u + middle of b."""
    driven = driven_columns(gains)
    known = driven.shape[1]
    return FlowCells(np.block([[gains.A, driven], [np.zeros((known, gains.n + known))]]), gains.n)


def driven_columns(gains: PlantGains) -> Matrix:
    """[B, middle of b], (n, m + 1)."""
    drift = gains.flow_drift[:, None]
    return drift if gains.B is None else np.hstack([gains.B, drift])


def _rate(N: Matrix) -> float:
    """Of the states that depend on each other, one over their shortest time; 1 without any."""
    units, reach = balance(N), reachable(N != 0)
    rates = np.abs(units[:, None] * N / units)[reach & reach.T]
    return float(rates.max(initial=0.0)) or 1.0
