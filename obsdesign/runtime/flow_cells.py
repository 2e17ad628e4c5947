"""Maps of a flow over steps of any length, from power series about a few lengths.

e^{N h} = e^{N c} e^{N (h - c)}: a step of a length that was never met takes one product with the
coefficients of the series about the middle c of its cell (`length_cells`) instead of an
exponential. What 16 terms leave is below 1e-18 of |e^{N c}|.
"""

from __future__ import annotations

from collections import OrderedDict
from math import log

import numpy as np
from numpy import exp

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.units import reachable
from obsdesign.equations.gains import PlantGains
from obsdesign.runtime.length_cells import NEXT_TO_ZERO, LengthCells, Place, flow_units, from_left
from obsdesign.runtime.step_cache import cached_step

# lengths whose maps are kept
_RECENT = 1024
_TERMS = 16
_POWERS = np.arange(float(_TERMS))


class FlowCells:
    """The first `rows` rows of e^{N h}, for any h > 0.

    N: (k, k). Where |N| h is far above one, each length has its own exponential.
    """

    def __init__(self, N: Matrix, rows: int) -> None:
        units = flow_units(np.abs(N))
        self._N = units[:, None] * N / units
        # zero where N leaves the map zero at any length: rounding does not
        self._scales = np.where(reachable(N != 0)[:rows], units / units[:rows, None], 0.0)
        self._shape: tuple[int, int] = (rows, len(N))
        self._lengths = LengthCells(float(np.abs(self._N).sum(axis=1).max()))
        self._cells: OrderedDict[Place, Matrix] = OrderedDict()
        self._recent: dict[float, Matrix] = {}

    @property
    def longest(self) -> float:
        """Steps up to this length share cells, and entries of their maps are below 1e100."""
        return self._lengths.longest

    def at(self, h: float) -> Matrix:
        """The map of a step, (rows, k); of equal steps the same array."""
        values = self._recent.get(h)
        if values is None:
            if len(self._recent) >= _RECENT:
                self._recent.clear()
            values = self._recent[h] = self._made(h)
        return values

    @property
    def columns(self) -> int:
        """Columns of a map."""
        return self._shape[1]

    def several(self, lengths: Matrix) -> list[Matrix]:
        """The maps of several steps, each that of `at`, made together."""
        unique, order = np.unique(lengths, return_inverse=True)
        places, x = self._lengths.places(unique)
        powers = exp(
            _POWERS * np.array(list(map(log, np.where(x > 0.0, x, NEXT_TO_ZERO))))[:, None]
        )
        values = np.empty((len(unique), self._scales.size))
        maps = list(values.reshape(-1, *self._shape))
        for k, (place, own, row) in enumerate(zip(places, powers, values, strict=True)):
            if place is None:
                maps[k] = self.at(float(unique[k]))
            else:
                own.dot(self._series_of(place), row)
        return [maps[k] for k in order.tolist()]

    def _series_of(self, place: Place) -> Matrix:
        series = self._cells.get(place)
        return cached_step(self._cells, place, self._series) if series is None else series

    def _made(self, h: float) -> Matrix:
        cell = self._lengths.place(h)
        if cell is None:
            return self._scaled(expm(self._N * h))
        place, x = cell
        values: Matrix = exp(_POWERS * log(x or NEXT_TO_ZERO)).dot(self._series_of(place))
        return values.reshape(self._shape)

    def _series(self, place: Place) -> Matrix:
        """Coefficients of powers of x of the map at middle + (2 x - 1) half, (_TERMS, rows k)."""
        middle, half = self._lengths.ends(place)
        term, terms = expm(self._N * middle), list[Matrix]()
        term = term[: self._shape[0]]
        for k in range(_TERMS):
            terms.append(self._scaled(term).reshape(-1))
            term = term @ self._N * (half / (k + 1))
        return from_left(np.array(terms))

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
