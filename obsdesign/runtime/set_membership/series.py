"""e^{A t} and its integral for any t, enclosed, from one table of A^k / k!.

A new t costs one product of coefficients with the table, and a doubling for each factor two that
||A|| t is above 1/2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT, Enclosure, raised
from lmi.arithmetic.units import reachable

_DEGREE = 16
_LARGEST_ARGUMENT = 0.5
_MOST_DOUBLINGS = 60
_EXPONENTS = np.arange(_DEGREE + 2)
_ORDERS = np.arange(1.0, _DEGREE + 2)


@dataclass(frozen=True)
class FlowSeries:
    """The table for a matrix A (n, n), exactly as stored."""

    A: Matrix

    @cached_property
    def norm(self) -> float:
        """Upper bound of the largest column sum of |A|."""
        return float(raised(np.abs(self.A).sum(axis=0), 2 * len(self.A)).max(initial=0.0))

    @cached_property
    def size(self) -> Matrix:
        """|A|."""
        return np.abs(self.A)

    def flow(self, t: float, error: float) -> tuple[Enclosure, Enclosure]:
        """(e^{A s}, int_0^s e^{A r} dr) for every s >= 0 within `error` of t >= 0."""
        halvings = self._halvings(t + error)
        if halvings > _MOST_DOUBLINGS:
            n = len(self.A)
            unknown = Enclosure(np.zeros((n, n)), np.full((n, n), np.inf))
            return unknown, unknown
        scale = 2.0**-halvings
        Phi, integral = self._near(self._table, t * scale, error * scale)
        for _ in range(halvings):
            integral = integral + Phi @ integral
            Phi = Phi @ Phi
        return Phi, integral

    def reach(self, t: float, error: float, entering: Matrix) -> Matrix:
        """Upper bound of int_0^s |e^{A r} entering| dr for every s >= 0 within `error` of t >= 0.

        Doubled from a short time, on which |e^{A r}| <= e^{Mz(A) r} (`comparison`): where the flow
        decays, the bound settles however long the time.
        """
        halvings = self._halvings(t + error)
        if halvings > _MOST_DOUBLINGS:
            return np.full(entering.shape, np.inf)
        scale, roundings = 2.0**-halvings, 4 * len(entering)
        _, spread = self.comparison.flow(t * scale, error * scale)
        total = raised(np.maximum(spread.upper, 0.0) @ np.abs(entering), roundings)
        if halvings:
            Phi, _ = self._near(self._table, t * scale, error * scale)
        for _ in range(halvings):
            total = raised(total + Phi.magnitude @ total, roundings)
            Phi = Phi @ Phi
        return total

    @cached_property
    def comparison(self) -> FlowSeries:
        """The series of Mz(A), which keeps the diagonal and takes absolute values elsewhere."""
        size = np.abs(self.A)
        np.fill_diagonal(size, np.diag(self.A))
        return FlowSeries(size)

    def growth(self, t: float) -> Matrix:
        """Upper bound of e^{|A| t}, t >= 0."""
        halvings = self._halvings(t)
        if halvings > _MOST_DOUBLINGS:
            return np.full(self.A.shape, np.inf)
        whole, _ = self._near(self._sizes, math.ldexp(t, -halvings), 0.0)
        upper = np.where(self._pattern, whole.upper, 0.0)
        for _ in range(halvings):
            upper = np.where(self._pattern, raised(upper @ upper, 2 * len(self.A)), 0.0)
        return upper

    def _halvings(self, t: float) -> int:
        argument = self.norm * t
        if not math.isfinite(argument):
            return _MOST_DOUBLINGS + 1
        return max(0, math.ceil(math.log2(max(argument, 1e-300) / _LARGEST_ARGUMENT)))

    @cached_property
    def _pattern(self) -> Matrix:
        return np.asarray(reachable(self.A != 0))

    @cached_property
    def _table(self) -> tuple[Matrix, Matrix, Matrix]:
        return _terms(self.A)

    @cached_property
    def _sizes(self) -> tuple[Matrix, Matrix, Matrix]:
        return _terms(self.size)

    def _near(
        self, table: tuple[Matrix, Matrix, Matrix], t: float, error: float
    ) -> tuple[Enclosure, Enclosure]:
        """The sums of the series for ||A|| t <= 1/2, with their remainder."""
        n, mids, size, errors = len(self.A), *table
        powers = np.array([[t], [t + error]]) ** _EXPONENTS
        # coefficients t^k of the exponential, t^(k+1) / (k+1) of its integral
        least, most = np.stack([powers[:, :-1], powers[:, 1:] / _ORDERS], axis=1)
        slack = (most - least) + 8 * (_DEGREE + 2) * UNIT * most
        # the tail of a series is at most twice its first term, as norm * t <= 1/2
        first = (self.norm * (t + error)) ** (_DEGREE + 1) / math.factorial(_DEGREE + 1)
        tail = 2.1 * first * np.array([[1.0], [t + error]])
        rad = raised(most @ errors + slack @ size, 4 * _DEGREE) + tail
        rad = np.where(self._pattern.reshape(-1), raised(rad, 4), 0.0)
        mid = (least @ mids).reshape(2, n, n)
        rad = rad.reshape(2, n, n)
        return Enclosure(mid[0], rad[0]), Enclosure(mid[1], rad[1])


def _terms(A: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """(middles, their sizes, errors) of A^k / k!, each (degree + 1, n^2).

    The errors include those of a sum of all terms.
    """
    n = len(A)
    term, X = Enclosure.exactly(np.eye(n)), Enclosure.exactly(A)
    mids, errors = [term.mid], [term.rad]
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(1, _DEGREE + 1):
            term = (X @ term).scaled(1.0 / k, UNIT / k)
            mids.append(term.mid)
            errors.append(term.rad)
        flat, size = np.reshape(mids, (_DEGREE + 1, n * n)), np.abs(mids).reshape(-1, n * n)
        summed = raised(np.reshape(errors, flat.shape) + (_DEGREE + 4) * UNIT * size, 4)
    return flat, size, summed
