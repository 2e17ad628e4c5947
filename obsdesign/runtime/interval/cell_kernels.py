"""Kernels of steps of any length: series in the length, one for each cell of lengths.

All entries of a kernel are series in the length of its step (`cell_rows`): for a length that was
never met one product of their coefficients with powers of its place in the cell gives the kernel.
What series leave out, their rounding and the error of the length are in its margins, the same all
over the cell.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from functools import cache
from math import log
from typing import NamedTuple

import numpy as np
from numpy import exp

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import TINY, UNIT, raised
from obsdesign.runtime.enclosed_series import EXPONENTS, REACH, TERMS, growth, weighed
from obsdesign.runtime.interval.cell_rows import (
    Frame,
    Maps,
    candidates,
    ends,
    residual,
    stacked,
)
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.kernel_rows import measurement
from obsdesign.runtime.interval.model import Model, exactly
from obsdesign.runtime.length_cells import NEXT_TO_ZERO, from_left
from obsdesign.runtime.step_cache import cached_step

_REACHES = REACH**EXPONENTS
# part of an entry that series may lose by being short
_NEGLIGIBLE = 2.0**-45
# smaller coefficients are rounding or underflow, and slow to multiply with
_SMALLEST = 1e-200
# errors of lengths for which margins are kept
_REACHES_KEPT = 4


class Blank(NamedTuple):
    """The half of a kernel that depends on the place x: `weights.dot(coefficients, half)`.

    weights: x^exponents, with what `complete` adds to them if there is any.
    """

    exponents: Matrix
    complete: Callable[[Matrix], Matrix] | None
    coefficients: Matrix
    half: Matrix


class CellKernel:
    """The kernels of the steps of a cell by their place x in it, 0 <= x <= 1: s = 2 x - 1."""

    def __init__(self, model: Model, C: Matrix, maps: Maps) -> None:
        n, p = model.L.mid.shape
        step, self._kinks, self._checks = maps.boxes[0], maps.kinks, 2 * p
        columns = step.X.mid.shape[-1]
        y_end, own = measurement(model, columns), Frame(None, model.C)
        frames = [Frame(None, exactly(C))] if model.S is None else [Frame(model.S, exactly(C)), own]
        of_bounds = [candidates(model, frame, maps, y_end) for frame in frames]
        self._layout = (n, p, *(len(blocks) for blocks in [*of_bounds, []][:2]))
        below, above = ends(maps, [*maps.strips, step][0], residual(model, own, y_end))
        pairs = [pair for blocks in of_bounds for pair in blocks]
        rows = [above.negated(), below.negated(), *(block for pair in pairs for block in pair)]
        whole = [ends(maps, step, frame.of_states(columns)) for frame in frames]
        self._of_reach: OrderedDict[float, tuple[Matrix, Matrix]] = OrderedDict()
        self._count = sum(len(each.rad) for each in rows)
        self._rows = stacked([*rows, *(block for pair in whole for block in pair)])
        self._blank = np.zeros(2 * (n + columns))
        self._blank[n + columns - 1] = 1.0
        self._summed()

    def _summed(self) -> None:
        """The coefficients that are summed, of powers of x, and what they lose."""
        rows, values = self._rows.mid, self._kinks.values
        entries, shape = rows[0].size, rows[0].shape
        mids = np.hstack([rows[:TERMS].reshape(TERMS, -1), values.mid])
        short, lost, spread = shortened(mids)
        groups = np.where(np.abs(rows[TERMS:]) < _SMALLEST, 0.0, rows[TERMS:])
        omitted = weighed(self._sums(values.size), np.abs(rows[TERMS:] - groups))
        self._lost = lost[:entries].reshape(shape) + omitted, lost[entries:]
        self._spread = spread[:entries].reshape(shape), spread[entries:]
        self._powers, self._groups = EXPONENTS[: len(short)], len(groups)
        summed = np.concatenate([short[:, :entries].reshape(-1, *shape), groups])
        # the row that adds up all others is between the checks and the bounds
        kernel = np.insert(summed[:, : self._count], self._checks, 0.0, axis=1)
        self._coefficients, self._of_whole = map(_flat, (kernel, summed[:, self._count :]))
        self._of_kinks = np.ascontiguousarray(short[:, entries:])

    def kernel(self, x: float, reach: float) -> Kernel:
        """The kernel at x; reach: how far true places are from it."""
        rows, whole = cached_step(self._of_reach, reach, self._margins, _REACHES_KEPT)
        powers = exp(self._powers * log(x or NEXT_TO_ZERO))  # errors are small beside one
        rows, weights = rows.copy(), self._with_sums(powers)
        weights.dot(self._coefficients, rows[: len(rows) // 2].reshape(-1))
        own = weights.dot(self._of_whole).reshape(len(whole), -1)
        return self._kernel(rows, np.concatenate([own, whole]))

    def blank(self, reach: float) -> tuple[Kernel, Blank]:
        """A kernel with entries as large as those of any, and what makes it that of a place."""
        rows, whole = self._margins(reach)
        half = rows[: len(rows) // 2].reshape(-1)
        half[:] = np.abs(self._coefficients).sum(axis=0)
        complete = self._with_sums if self._groups else None
        blank = Blank(self._powers, complete, self._coefficients, half)
        return self._kernel(rows, np.concatenate([whole, whole])), blank

    def _with_sums(self, powers: Matrix) -> Matrix:
        """What coefficients are multiplied with: powers, and sums of absolute values."""
        return np.concatenate([powers, self._sums(np.abs(powers.dot(self._of_kinks)))])

    def _sums(self, values: Matrix) -> Matrix:
        """Of the absolute values of each group."""
        groups = len(self._kinks.R)
        return np.asarray(np.bincount(self._kinks.group, values, groups), dtype=np.float64)

    def _margins(self, reach: float) -> tuple[Matrix, Matrix]:
        """A kernel without its entries that depend on x, transposed, and margins of `whole`."""
        size, error = self._size_and_error(reach)
        total = raised(2.0 * (size + error).sum(axis=0), 2 * len(error))
        inward = np.arange(self._count) < self._checks
        margins = np.where(inward[:, None], error[: self._count], -error[: self._count])
        margins = np.insert(margins, self._checks, total, axis=0)
        kernels = np.zeros((2 * margins.shape[1], len(margins)))
        kernels[margins.shape[1] :] = margins.T
        return kernels, -error[self._count :].T

    def _size_and_error(self, reach: float) -> tuple[Matrix, Matrix]:
        """Bounds of the entries of rows, and of their errors with the rounding of a product."""
        values, (lost, lost_values), (spread, of_values) = (
            self._kinks.values,
            self._lost,
            self._spread,
        )
        rounding = (2 * (len(self._powers) + len(of_values)) + 24) * UNIT
        changes = values.rad + lost_values + weighed(growth(reach), np.abs(values.mid))
        changes = raised(changes + rounding * of_values, 2 * TERMS)
        entries, terms = np.abs(self._rows.mid), 4 * self._rows.mid.shape[-1] + 8
        of_groups = [self._sums(each) for each in (values.size, changes)]
        size = weighed(np.concatenate([_REACHES, of_groups[0]]), entries)
        error = weighed(np.concatenate([growth(reach), of_groups[1]]), entries)
        error = error + self._rows.rad + lost + rounding * (spread + size) + terms * UNIT * size
        error = raised(error, 2 * (len(entries) + len(changes)))
        error[:, -1] += TINY
        return size, error

    def _kernel(self, rows: Matrix, whole: Matrix) -> Kernel:
        n, p, outer, inner = self._layout
        return Kernel(rows.T, n, p, outer, inner, whole.T, self._blank, len(rows) // 2)


def _flat(summed: Matrix) -> Matrix:
    """Coefficients as they are summed, (weights, middle rows)."""
    return np.ascontiguousarray(summed.swapaxes(1, 2)).reshape(len(summed), -1)


def shortened(mid: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Fewer coefficients of polynomials (TERMS, k) in s, as those of powers of x.

    |s| <= 1, x = (s + 1) / 2. Then bounds of what they lose (k,), and of the sum of their
    magnitudes (k,). Chebyshev polynomials of the highest degrees are left out as long as that is
    negligible.
    """
    size, lost, chebyshev = weighed(_REACHES, np.abs(mid)), np.zeros(mid.shape[1]), _chebyshev()
    degree = TERMS - 1
    while degree > 0:
        share = mid[degree] * 2.0 ** (1 - degree)
        more = lost + np.abs(share)
        if (more > _NEGLIGIBLE * size + _SMALLEST).any():
            break
        lost, mid, degree = more, mid - chebyshev[degree][:, None] * share, degree - 1
    spread = raised(weighed(3.0**EXPONENTS, np.abs(mid)), 2 * TERMS)
    short = from_left(mid[: degree + 1])
    tiny = np.abs(short) < _SMALLEST
    lost = lost + TERMS * _SMALLEST * tiny.any(axis=0) + 2 * TERMS * UNIT * spread
    return np.where(tiny, 0.0, short), raised(lost, 2 * TERMS), spread


@cache
def _chebyshev() -> Matrix:
    """Coefficients of powers in the Chebyshev polynomials, (TERMS, TERMS)."""
    rows = np.eye(TERMS)
    for k in range(2, TERMS):
        rows[k] = 2.0 * np.roll(rows[k - 1], 1) - rows[k - 2]
    return rows
