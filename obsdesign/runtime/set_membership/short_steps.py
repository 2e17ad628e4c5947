"""Everything that the table of a short step is made from, as power series in its length.

With W the columns of the disturbance, B those of known inputs, and pieces of length d with starts
s_i and midpoints m_i, a table (`tables`) is made from

    e^{A h},   int_0^h e^{A s} ds B,   F0 = int over a piece e^{A s} ds W,   FM = e^{A m_i} W,
    F1 = A FM,   E2 = |A^2 e^{A m_i}| e^{|A| d / 2} |W|,
    E0 = |e^{A s_i}| int_0^d e^{Mz(A) s} ds |W|

Each factor is a sum of h^k times coefficients that do not depend on h: a new length costs one
product of its powers with all of them. Up to ||A|| h = 2 the series leave out 2e-19 of a column.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import TINY, UNIT, Enclosure, raised
from lmi.arithmetic.units import reachable
from obsdesign.runtime.set_membership.model import Model
from obsdesign.runtime.set_membership.series import FlowSeries

_TERMS = 26
_EXPONENTS = np.arange(_TERMS)
# roundings of a factor of a coefficient: a difference of powers of parts of a step
_FACTOR_ROUNDINGS = 32
_SMALLEST_UNIT = 2.0**-500


class StepParts(NamedTuple):
    """What the table of a step is made from.

    Phi (n, n); forced (n, inputs + columns); columns (n, 3, pieces, width): F0, FM, F1; sizes
    (n, 2, pieces, width): E2 and E0.
    """

    Phi: Enclosure
    forced: Enclosure
    columns: Enclosure
    sizes: Matrix


class _Block(NamedTuple):
    """Coefficients X (terms, ...) of a part, and its entries that are not zero for all lengths.

    left_out (2, ...): an entry of what the sum leaves out is at most the first of them times that
    of e^{||A|| h}, plus the second times that of its integral.
    """

    X: Enclosure
    pattern: NDArray[np.bool_]
    left_out: Matrix

    @staticmethod
    def side_by_side(blocks: list[_Block]) -> _Block:
        """Blocks of (n, pieces, m) as (n, blocks, pieces, m)."""
        X, pattern, left_out = zip(*blocks, strict=True)
        mid, rad = (
            np.stack(values, axis=2) for values in zip(*((x.mid, x.rad) for x in X), strict=True)
        )
        return _Block(Enclosure(mid, rad), np.stack(pattern, axis=1), np.stack(left_out, axis=2))


class ShortSteps:
    """The series for steps of so many pieces; flow: that of the model's A."""

    def __init__(self, model: Model, flow: FlowSeries, pieces: int) -> None:
        self._model, self._flow, self._pieces = model, flow, pieces
        # powers of unit h, and their coefficients, stay in the range of floats
        self._unit = max(_SMALLEST_UNIT, math.ldexp(0.5, math.frexp(flow.norm)[1]))

    def parts(self, h: float, error: float) -> StepParts:
        """The parts of every step within `error` of h > 0; ||A|| h is at most 2."""
        mids, radii, pattern = self._table
        x = np.array([[h], [h + error]]) * self._unit
        least, most = x**_EXPONENTS
        slack = (most - least) + 8 * (_TERMS + 2) * UNIT * most + TINY
        weights = np.concatenate([most, slack, self._left_out(h + error)])
        rad = np.where(pattern, raised(weights @ radii, 4 * _TERMS), 0.0)
        Phi, forced, columns, turned, pushed = self._split(least @ mids, rad)
        pushes = pushed.magnitude[:, :, 0].transpose(1, 0, 2)
        sizes = raised(turned.magnitude @ pushes, 4 * len(rad))
        return StepParts(_only(Phi), _only(forced), columns, sizes)

    def _left_out(self, h: float) -> list[float]:
        """Bounds of all further terms of e^{||A|| h} and of its integral."""
        argument = self._flow.norm * h
        if not argument < _TERMS / 2:
            return [math.inf, math.inf]
        # at most twice the first of them
        common = 2.1 * argument ** (_TERMS - 1) / math.factorial(_TERMS)
        return [common * argument, common * h]

    def _split(self, mid: Matrix, rad: Matrix) -> list[Enclosure]:
        return [
            Enclosure(mid[part].reshape(shape), rad[part].reshape(shape))
            for part, shape in self._places
        ]

    @cached_property
    def _places(self) -> list[tuple[slice, tuple[int, ...]]]:
        """Where the sums of each block are, and their shapes."""
        shapes = [block.pattern.shape for block in self._blocks]
        ends = np.cumsum([0, *(math.prod(shape) for shape in shapes)]).tolist()
        return [(slice(*ends[k : k + 2]), shape) for k, shape in enumerate(shapes)]

    @cached_property
    def _table(self) -> tuple[Matrix, Matrix, NDArray[np.bool_]]:
        """(coefficients; their errors, sizes and what is left out; pattern) of all blocks."""
        mids, rads, left_out = (
            np.concatenate([array.reshape(len(array), -1) for array in arrays], axis=1)
            for arrays in zip(*((b.X.mid, b.X.rad, b.left_out) for b in self._blocks), strict=True)
        )
        size = np.abs(mids)
        errors = raised(rads + (_TERMS + 4) * UNIT * size, 4)
        pattern = np.concatenate([block.pattern.reshape(-1) for block in self._blocks])
        return mids, np.concatenate([errors, size, left_out]), pattern

    @cached_property
    def _blocks(self) -> list[_Block]:
        """Phi, forced, columns; factors of sizes, (n, 2, pieces, n) and (n, 2, 1, width)."""
        model, count, norm = self._model, self._pieces, self._flow.norm
        n, active, A = model.n, model.flow.active, Enclosure.exactly(model.A)
        W, unit = np.zeros((n, model.width)), np.eye(n)
        W[:, : len(active)] = model.flow.matrix[:, active]
        B, known = Enclosure.exactly(W), np.hstack([model.inputs, model.flow.matrix])
        starts, ends = np.arange(count) / count, np.arange(1, count + 1) / count
        middles, zero, d = starts + 0.5 / count, np.zeros(1), np.ones(1) / count
        e = self._terms(model.A)
        grown = self._terms(self._flow.size) @ Enclosure.exactly(np.abs(W))
        spread = self._terms(self._flow.comparison.A) @ Enclosure.exactly(np.abs(W))
        driven = e @ Enclosure.exactly(known)
        return [
            self._block(_at(e, zero + 1), unit, (1, 0)),
            self._block(self._over(driven, zero, zero + 1), known, (0, 1)),
            _Block.side_by_side([
                self._block(self._over(e @ B, starts, ends), W, (0, 1)),
                self._block(_at(e @ B, middles), W, (1, 0)),
                self._block(_at(A @ (e @ B), middles), W, (norm, 0)),
            ]),
            _Block.side_by_side([
                self._block(_at(A @ A @ e, middles), unit, (norm * norm, 0)),
                self._block(_at(e, starts), unit, (1, 0)),
            ]),
            _Block.side_by_side([
                self._block(_at(grown, 0.5 * d), W, (1, 0)),
                self._block(self._over(spread, zero, d), W, (0, 1)),
            ]),
        ]  # fmt: skip

    def _terms(self, X: Matrix) -> Enclosure:
        """(X / unit)^k / k!, (terms, n, n)."""
        scaled = Enclosure.exactly(X / self._unit)
        terms = [Enclosure.exactly(np.eye(len(X)))]
        for k in range(1, _TERMS):
            terms.append((scaled @ terms[-1]).scaled(1.0 / k, UNIT / k))
        return Enclosure(np.array([x.mid for x in terms]), np.array([x.rad for x in terms]))

    def _over(self, X: Enclosure, starts: Matrix, ends: Matrix) -> Enclosure:
        """Coefficients of the integrals of sum_k x^k X_k between these parts of a step."""
        orders = _EXPONENTS[1:, None]
        factors = (ends**orders - starts**orders) / (orders * self._unit)
        before = [np.concatenate([np.zeros_like(v[:1]), v[:-1]]) for v in (X.mid, X.rad)]
        return _weighted(Enclosure(*before), np.concatenate([np.zeros_like(factors[:1]), factors]))

    def _block(self, X: Enclosure, entering: Matrix, left_out: tuple[float, float]) -> _Block:
        """A block of the flow of `entering` (n, m); left_out: in parts of its columns' sizes."""
        reached = reachable(self._model.A != 0) @ (entering != 0)
        pattern = np.broadcast_to(reached[:, None], X.mid.shape[1:])
        columns = np.broadcast_to(np.abs(entering).sum(axis=0), pattern.shape)
        return _Block(X, pattern, np.stack([columns * part for part in left_out]))


def _at(X: Enclosure, parts: Matrix) -> Enclosure:
    """Coefficients of sum_k x^k X_k at these parts of a step: (terms, n, parts, m)."""
    return _weighted(X, parts ** _EXPONENTS[:, None])


def _weighted(X: Enclosure, factors: Matrix) -> Enclosure:
    """X (terms, n, m) times factors (terms, c), but for their roundings: (terms, n, c, m)."""
    factors = factors[:, None, :, None]
    mid = X.mid[:, :, None] * factors
    rad = X.rad[:, :, None] * factors + _FACTOR_ROUNDINGS * UNIT * np.abs(mid)
    return Enclosure(mid, np.where(rad > 0.0, raised(rad, 4), 0.0))


def _only(X: Enclosure) -> Enclosure:
    """The one piece of (n, 1, m)."""
    return Enclosure(X.mid[:, 0], X.rad[:, 0])
