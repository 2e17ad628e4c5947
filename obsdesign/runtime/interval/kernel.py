"""One step as one matrix-vector product: bounds, checks and rounding in one matrix.

A kernel multiplies v = [e; y0; y1; u; 1; |e|; |y0|; |y1|; |u|; 1] (e = [lower; -upper], the box in
the observer's coordinates; y0, y1: measurements at start and end; u: input, or w at a jump) and
gives

    reach -+ (y1 - C m) both nonnegative unless no state of the predicted box can give y1
    a number            finite only if everything else is: above the sum of its absolute values
    lower, -upper       of x, several sound candidates (`cuts`): the largest of each holds
    lower, -upper       of z, likewise, where x = S z

so that the box of the next step is a maximum, entry by entry, and no further arithmetic.

Of a plant with parameters, v has before its second 1 the magnitudes of forms: of further products
with [e; y0; y1; u; 0; 1], whose rounding and errors the rows cover (`parametric_kernels`).

Rounding: |float(a'v) - a'v| <= gamma |a|'|v|. The margin on the outer side of a bound covers it,
the error of the enclosed maps, and its own rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, cast

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.base import MODERATE
from obsdesign.runtime.boxes import BoundsFault


class Product(Protocol):
    """A product with a vector, in `out` if it is there."""

    def __call__(self, v: Matrix, out: Matrix | None = None, /) -> Matrix:
        """The product."""


class Result(NamedTuple):
    """What a step or a jump leaves: box [lower; -upper] of z and bounds of x, cut.

    size: above all its numbers; fault: why these are not the cut ones.
    """

    box: Matrix
    lower: Matrix
    upper: Matrix
    size: float
    fault: BoundsFault | None


@dataclass(frozen=True, slots=True)
class Kernel:
    """A matrix and the layout of the vector v that it multiplies.

    rows: the matrix; n, p: states and outputs; candidates, inner: how many bounds of x and of z it
    gives (inner: 0 where z is x); whole: rows of the bounds of x and z without any cut; blank: v of
    nothing; middle: where its absolute values begin. forms (k, middle): what it multiplies before,
    None of a plant without parameters; own: how many of the candidates of x and of z, the first of
    each, do not count on known bounds of the state; None where all do not.
    """

    rows: Matrix
    n: int
    p: int
    candidates: int
    inner: int
    whole: Matrix
    blank: Matrix
    middle: int
    forms: Matrix | None = None
    own: tuple[int, int] | None = None

    @property
    def product(self) -> Product:
        """The product with v, (width,), which is filled but for the magnitudes of forms."""
        rows = cast(Product, self.rows.dot)
        if self.forms is None:
            return rows
        forms, known, drives = self.forms.dot, slice(self.middle), self._drives

        def product(v: Matrix, out: Matrix | None = None) -> Matrix:
            np.absolute(forms(v[known]), v[drives])
            return rows(v, out)

        return product

    def fill_drives(self, v: Matrix) -> None:
        """Write the magnitudes of forms into v, (width,) or (width, k); nothing without any."""
        if self.forms is not None:
            np.absolute(self.forms.dot(v[: self.middle]), v[self._drives])

    @property
    def _uses_y_start(self) -> bool:
        """Has y0 any effect on a bound, or on a form?"""
        n2, products = 2 * self.n, [self.rows] if self.forms is None else [self.rows, self.forms]
        return any(bool(each[:, n2 : n2 + self.p].any()) for each in products)

    @property
    def _drives(self) -> slice:
        """Where v has the magnitudes of forms."""
        count = 0 if self.forms is None else len(self.forms)
        return slice(self.width - 1 - count, self.width - 1)

    @property
    def moderate(self) -> bool:
        """Does a product with moderate numbers stay far from overflow?"""
        return bool(np.abs(self.rows).max() < MODERATE)

    @property
    def width(self) -> int:
        """Length of v."""
        return int(self.rows.shape[1])

    @property
    def checks(self) -> slice:
        """Where a result has the room of each output, and after it the size of all numbers."""
        return slice(2 * self.p + 1)

    @property
    def blocks(self) -> tuple[list[slice], list[slice]]:
        """Where a result has the candidates for the bounds of x, and of z."""
        first, n2 = 2 * self.p + 1, 2 * self.n
        slices = [slice(first + k * n2, first + (k + 1) * n2)
                  for k in range(self.candidates + self.inner)]  # fmt: skip
        return slices[: self.candidates], slices[self.candidates :]

    def in_parts(self, exponent: int) -> KernelParts:
        """Where its parts are; exponent: of the times of its samples (`frexp`)."""
        begins = math.ldexp(0.5, exponent)
        n2, p, middle = 2 * self.n, self.p, self.middle
        (first, *others), inner = self.blocks
        return KernelParts(
            self.blank, slice(n2), slice(n2, n2 + p), slice(n2 + p, n2 + 2 * p),
            slice(n2 + 2 * p, middle - 1), slice(middle), slice(middle, None), self.checks, first,
            tuple(others), tuple(inner),
            self._uses_y_start, n2 + p, slice(self.n), slice(self.n, None),
            begins, 2.0 * begins,
        )  # fmt: skip

    def vector(self, box: Matrix, y0: Matrix | None, y1: Matrix | None, u: Matrix) -> Matrix:
        """v for a box, measurements at the start and end of the step, and an input."""
        n2, p, middle = 2 * self.n, self.p, self.middle
        v = self.blank.copy()
        v[:n2] = box
        if y0 is not None:
            v[n2 : n2 + p] = y0
        if y1 is not None:
            v[n2 + p : n2 + 2 * p] = y1
        if u.size:
            v[n2 + 2 * p : n2 + 2 * p + len(u)] = u
        np.abs(v[:middle], v[middle:])
        return v

    def after(self, box: Matrix, y0: Matrix | None, y1: Matrix | None, u: Matrix) -> Result:
        """Box and bounds after the step; arguments as for `vector`."""
        v = self.vector(box, y0, y1, u)
        return self.result(v, self.product(v))

    def ends(self, out: Matrix) -> tuple[Matrix, Matrix]:
        """[lower; -upper] of x and of z from a result, (2n,) each."""
        outer, inner = self.blocks
        own = largest([out[block] for block in outer])
        return own, largest([out[block] for block in inner]) if inner else own

    def result(self, v: Matrix, out: Matrix) -> Result:
        """Box and bounds from v and its product. Overflow leaves the only sound bounds.

        The box that is carried on is the cut one: maps of boxes are monotone, |X| <= R, so that
        the box and the bounds of every later step are inside those without the cut.
        """
        n, size = self.n, float(out[2 * self.p])
        if not math.isfinite(size):
            nothing = np.full(2 * n, -np.inf)
            return Result(nothing, nothing[:n], -nothing[n:], size, BoundsFault.OVERFLOWED)
        ends, box = self.ends(out)
        fault = None
        if crossed(ends) or crossed(box):
            fault, whole = BoundsFault.CROSSED, self.whole.dot(v)
            own = self._own_ends(out)
            if own is None or crossed(own[0]) or crossed(own[1]):
                ends, box = whole[: 2 * n], whole[-2 * n :]
            else:
                fault, (ends, box) = BoundsFault.APART, own
        return Result(box, ends[:n], -ends[n:], size, fault)

    def _own_ends(self, out: Matrix) -> tuple[Matrix, Matrix] | None:
        """`ends` without known bounds of the state; None where none are used."""
        if self.own is None:
            return None
        outer, inner = self.blocks
        ends = largest([out[block] for block in outer[: self.own[0]]])
        return ends, largest([out[block] for block in inner[: self.own[1]]]) if inner else ends

    def implausible(self, out: Matrix) -> list[str]:
        """Measurements that no state inside the bounds can give: they refute the bounds."""
        p, room = self.p, out[: 2 * self.p].tolist()
        if min(room) >= 0:
            return []
        return [f"y{i + 1} outside its bounds" for i in range(p) if min(room[i], room[p + i]) < 0]


class KernelParts(NamedTuple):
    """Slices of v and of a result, and for which times they are.

    box, y_start, y_end, u, known, sizes: of v, the last two all that also enters by absolute value
    and these values; checks, first, others, inner: of a result, the last three the candidates for
    the bounds of x, and those of z; uses_y_start: is y_start of any effect? y_index: place of the
    first y_end; lows, highs: halves of a candidate; begins, ends: of t, ends not included.
    """

    blank: Matrix
    box: slice
    y_start: slice
    y_end: slice
    u: slice
    known: slice
    sizes: slice
    checks: slice
    first: slice
    others: tuple[slice, ...]
    inner: tuple[slice, ...]
    uses_y_start: bool
    y_index: int
    lows: slice
    highs: slice
    begins: float
    ends: float


def crossed(ends: Matrix) -> bool:
    """Is a lower bound of [lower; -upper] above its upper one?"""
    n = len(ends) // 2
    return bool((ends[:n] > -ends[n:]).any())


def largest(blocks: Sequence[Matrix], out: Matrix | None = None) -> Matrix:
    """The largest entries of blocks of one shape, in `out` if it is there."""
    ends: Matrix = np.maximum(blocks[0], blocks[-1], out=out)
    for block in blocks[1:-1]:
        np.maximum(ends, block, out=ends)
    return ends
