"""One step as one matrix-vector product: box, bounds, checks and rounding in one matrix.

A kernel multiplies v = [r; m; y0; y1; u; 1; |m|; |y0|; |y1|; |u|; 1] (r, m: radius and centre in
the observer's coordinates; y0, y1: measurements at start and end; u: input, or w at a jump) and
gives

    r+, m+              the box after the step
    reach -+ (y1 - C m) both nonnegative unless no state of the predicted box can give y1
    a number            finite only if everything else is: above the sum of its absolute values
    lower, -upper       of x, several sound candidates: the largest of each holds

Rounding: |float(a'v) - a'v| <= gamma |a|'|v|. The margin on the radius side, or on the outer side
of a bound, covers it, the error of the enclosed maps, and its own rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import TINY, UNIT, Enclosure, raised
from obsdesign.runtime.base import MODERATE
from obsdesign.runtime.interval.maps import BoxMap
from obsdesign.runtime.interval.model import Model, exactly, size


@dataclass(frozen=True, slots=True)
class Kernel:
    """A matrix and the layout of the vector v that it multiplies.

    rows: the matrix; n, p: states and outputs; candidates: how many bounds of x it gives; blank: v
    of nothing; middle: where its absolute values begin.
    """

    rows: Matrix
    n: int
    p: int
    candidates: int
    blank: Matrix
    middle: int

    @property
    def moderate(self) -> bool:
        """Does a product with moderate numbers stay far from overflow?"""
        return bool(np.abs(self.rows).max() < MODERATE)

    @property
    def width(self) -> int:
        """Length of v."""
        return int(self.rows.shape[1])

    def in_parts(self) -> KernelParts:
        """The matrix, and where its parts are."""
        n, p, middle = self.n, self.p, self.middle
        first = 2 * n + 2 * p + 1
        return KernelParts(
            self.rows, self.blank,
            slice(2 * n), slice(2 * n + p, 2 * n + 2 * p), slice(n, middle), slice(middle, None),
            slice(2 * n, first), slice(first, first + 2 * n), slice(first + 2 * n, first + 4 * n),
        )  # fmt: skip

    def vector(self, box: Matrix, y0: Matrix | None, y1: Matrix | None, u: Matrix) -> Matrix:
        """v for a box [r; m], measurements at the start and end of the step, and an input."""
        n, p, middle = self.n, self.p, self.middle
        v = self.blank.copy()
        v[: 2 * n] = box
        if y0 is not None:
            v[2 * n : 2 * n + p] = y0
        if y1 is not None:
            v[2 * n + p : 2 * n + 2 * p] = y1
        if u.size:
            v[2 * n + 2 * p : middle - 1] = u
        np.abs(v[n:middle], v[middle:])
        return v

    def bounds(self, out: Matrix) -> tuple[Matrix, Matrix]:
        """(lower, upper) of x from a result."""
        n = self.n
        ends = out[2 * n + 2 * self.p + 1 :]
        if self.candidates == 2:
            ends = np.maximum(ends[: 2 * n], ends[2 * n :])
        elif self.candidates > 2:
            ends = np.maximum.reduce(ends.reshape(self.candidates, 2 * n))
        return ends[:n], -ends[n:]

    def implausible(self, out: Matrix) -> list[str]:
        """Measurements that no state inside the bounds can give: they refute the bounds."""
        n, p = self.n, self.p
        room = out[2 * n : 2 * n + 2 * p].tolist()
        if min(room) >= 0:
            return []
        return [f"y{i + 1} outside its bounds" for i in range(p) if min(room[i], room[p + i]) < 0]


class KernelParts(NamedTuple):
    """A kernel with slices of v and of a result.

    box, y_end, known, sizes: of v, the entries that also enter by absolute value and these values;
    checks, first, second: of a result, the last two the candidates for the bounds.
    """

    rows: Matrix
    blank: Matrix
    box: slice
    y_end: slice
    known: slice
    sizes: slice
    checks: slice
    first: slice
    second: slice


def path_kernel(step: BoxMap, p: int) -> Kernel:
    """The box alone, p outputs, no disturbance, no noise: the effect of rounding on a centre."""
    n, columns = len(step.g), step.X.mid.shape[1]
    rows = np.vstack([_radius_rows(replace(step, g=np.zeros(n))), _centre_rows(step)])
    return Kernel(rows, n, p, 0, _blank(n, columns), n + columns)


def kernel(
    model: Model, step: BoxMap, predicted: BoxMap, C: Matrix, *, strips: bool,
    noise: Matrix | None = None,
) -> Kernel:  # fmt: skip
    """The kernel of a step; predicted: the same step without y1.

    C: in the coordinates of the plant. strips: intersect with |C x - y1| <= V and the prediction.
    noise: (p,) radius of the noise of y1 whose parts are the last inputs before 1, beside V.
    """
    n, p = len(step.g), len(C)
    columns = step.X.mid.shape[1]
    y_end = exactly(np.zeros((p, columns)))
    y_end.mid[:, n + p : n + 2 * p] = np.eye(p)
    y_end.mid[:, -1] = -model.y_mid
    if noise is not None:
        y_end.rad[:, -p - 1 : -1] = np.diag(noise)
    blocks = [_radius_rows(step), _centre_rows(step)]
    box = _Rows(step.X, step.R, step.g)
    before = _Rows(predicted.X, predicted.R, predicted.g)
    residual = before.times(-model.C, y_end)
    residual = _Rows(residual.X, residual.R, residual.g + model.V)
    blocks += [residual.upper(), residual.upper(-1.0)]
    S = exactly(np.eye(n)) if model.S is None else model.S
    ends = [_ends(box.times(S))]
    if strips:
        ends += _strip_ends(before.times(S), C, model.V, y_end)
    total = _total(np.vstack([*blocks, *ends]), slice(n, n + columns))
    rows = np.vstack([*blocks, total, *ends])
    return Kernel(rows, n, p, len(ends), _blank(n, columns), n + columns)


def _blank(n: int, columns: int) -> Matrix:
    blank = np.zeros(n + 2 * columns)
    blank[n + columns - 1] = 1.0
    return blank


def _centre_rows(step: BoxMap) -> Matrix:
    """m+ = X v."""
    X = step.X.mid
    return np.hstack([np.zeros((len(X), len(X))), X, np.zeros_like(X)])


def _total(rows: Matrix, signed: slice) -> Matrix:
    """A row, (1, width), that gives twice the sum of |row| |v|; signed: what has a sign in v."""
    weights: Matrix = 2.0 * np.abs(rows).sum(axis=0, keepdims=True)
    weights[:, signed.stop :] += weights[:, signed]
    weights[:, signed] = 0.0
    return weights


@dataclass(frozen=True)
class _Rows:
    """Quantities within R r + g of X [m; y0; y1; u; 1]."""

    X: Enclosure
    R: Matrix
    g: Matrix

    def times(self, left: Enclosure, plus: Enclosure | None = None) -> _Rows:
        """left times these, plus a known part."""
        weight, terms = size(left), 2 * len(self.g)
        X = left @ self.X
        return _Rows(
            X if plus is None else X + plus,
            raised(weight @ self.R, terms),
            raised(weight @ self.g, terms),
        )

    def upper(self, sign: float = 1.0) -> Matrix:
        """Rows that give at least sign X v + R r + g when they are multiplied in floats."""
        X = self.X.mid
        terms = 2 * (self.R.shape[1] + 2 * X.shape[1]) + 8
        R = raised(self.R, terms)
        error = raised(self.X.rad + terms * UNIT * np.abs(X), terms)
        error[:, -1] = raised(error[:, -1] + self.g, terms) + TINY
        return np.hstack([R, sign * X, error])


def _radius_rows(step: BoxMap) -> Matrix:
    """r+ = R r + g, and the error of m+."""
    rows = _Rows(step.X, step.R, step.g).upper()
    n, columns = len(step.g), step.X.mid.shape[1]
    rows[:, n : n + columns] = 0.0
    return rows


def _ends(rows: _Rows) -> Matrix:
    """[lower; -upper] of all points within R r + g of X v, rounded outward."""
    return -np.vstack([rows.upper(-1.0), rows.upper()])


def _strip_ends(box: _Rows, C: Matrix, V: Matrix, y_end: Enclosure) -> list[Matrix]:
    """For each output: x_j from c_j x_j = y - v - sum of the other c_k x_k; else as predicted.

    With several outputs, which cost a reduction anyway, the prediction as a whole comes first.
    """
    whole = _ends(box)
    candidates = [whole] if len(C) > 1 else []
    n = len(box.g)
    for i in range(len(C)):
        ends = whole.copy()
        for j in np.flatnonzero(C[i]):
            others = C[i].copy()
            others[j] = 0.0
            measured = Enclosure(y_end.mid[i : i + 1], y_end.rad[i : i + 1])
            term = box.times(exactly(-others[None]), measured)
            scale = abs(1.0 / C[i, j])
            if not np.isfinite(scale):
                continue
            X = term.X.scaled(1.0 / C[i, j], UNIT * scale)
            R = raised(term.R * scale, 2)
            g = raised((term.g + V[i]) * scale, 4)
            pair = _ends(_Rows(X, R, g))
            if np.isfinite(pair).all():
                ends[j], ends[n + j] = pair
        candidates.append(ends)
    return candidates
