"""One step as one matrix-vector product: box, bounds, checks and rounding in one matrix.

A kernel multiplies v = [r; m; y0; y1; u; 1; |m|; |y0|; |y1|; |u|; 1] (r, m: radius and centre in
the observer's coordinates; y0, y1: measurements at start and end; u: input, or w at a jump) and
gives

    r+, m+              the box after the step
    reach -+ (y1 - C m) both nonnegative unless no state of the predicted box can give y1
    a number            finite only if everything else is: above the sum of its absolute values
    lower, -upper       of x, several sound candidates (`cuts`): the largest of each holds
    lower, -upper       of z, likewise, where x = S z

Rounding: |float(a'v) - a'v| <= gamma |a|'|v|. The margin on the radius side, or on the outer side
of a bound, covers it, the error of the enclosed maps, its own rounding, and two roundings of r and
of m, which come from the ends of the box of the step before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.base import MODERATE
from obsdesign.runtime.boxes import BoundsFault


class Result(NamedTuple):
    """What a step or a jump leaves: box [r; m] in z and bounds of x, cut with all candidates.

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
    gives, the first of each those of the box alone (inner: 0 where z is x); blank: v of nothing;
    middle: where its absolute values begin; halves (2n, 2n): gives [r; m] from [lower; -upper],
    each rounded once.
    """

    rows: Matrix
    n: int
    p: int
    candidates: int
    inner: int
    blank: Matrix
    middle: int
    halves: Matrix

    @property
    def moderate(self) -> bool:
        """Does a product with moderate numbers stay far from overflow?"""
        return bool(np.abs(self.rows).max() < MODERATE)

    @property
    def width(self) -> int:
        """Length of v."""
        return int(self.rows.shape[1])

    @property
    def is_cut(self) -> bool:
        """Are there several bounds, so that the box comes from the narrowest of them?"""
        return self.candidates > 1

    @property
    def blocks(self) -> tuple[list[slice], list[slice]]:
        """Where a result has the candidates for the bounds of x, and of z."""
        first, n2 = 2 * self.n + 2 * self.p + 1, 2 * self.n
        slices = [slice(first + k * n2, first + (k + 1) * n2)
                  for k in range(self.candidates + self.inner)]  # fmt: skip
        return slices[: self.candidates], slices[self.candidates :]

    def in_parts(self) -> KernelParts:
        """The matrix, and where its parts are."""
        n, p, middle = self.n, self.p, self.middle
        (first, *others), inner = self.blocks
        return KernelParts(
            self.rows, self.blank, self.halves,
            slice(2 * n), slice(2 * n + p, 2 * n + 2 * p), slice(n, middle), slice(middle, None),
            slice(2 * n, first.start), first, tuple(others), tuple(inner),
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

    def ends(self, out: Matrix) -> tuple[Matrix, Matrix]:
        """[lower; -upper] of x and of z from a result, or from results in rows: (..., 2n) each."""
        own, inner = (largest([out[..., block] for block in blocks]) for blocks in self.blocks)
        return own, inner if self.inner else own

    def result(self, out: Matrix) -> Result:
        """Box and bounds. Overflow leaves the only sound bounds: infinite ones.

        The box that is carried on is the cut one: maps of boxes are monotone, |X| <= R, so that
        the box and the bounds of every later step are inside those without the cut.
        """
        n, size = self.n, float(out[2 * self.n + 2 * self.p])
        if not math.isfinite(size):
            nothing = np.full(n, np.inf)
            box = np.concatenate([nothing, np.zeros(n)])
            return Result(box, -nothing, nothing, size, BoundsFault.OVERFLOWED)
        ends, inner = self.ends(out)
        if not self.is_cut:
            return Result(out[: 2 * n], ends[:n], -ends[n:], size, None)
        box = self.halves.dot(inner)
        if (ends[:n] <= -ends[n:]).all() and box[:n].min() >= 0:
            return Result(box, ends[:n], -ends[n:], size, None)
        whole = out[self.blocks[0][0]]
        return Result(out[: 2 * n], whole[:n], -whole[n:], size, BoundsFault.CROSSED)

    def implausible(self, out: Matrix) -> list[str]:
        """Measurements that no state inside the bounds can give: they refute the bounds."""
        n, p = self.n, self.p
        room = out[2 * n : 2 * n + 2 * p].tolist()
        if min(room) >= 0:
            return []
        return [f"y{i + 1} outside its bounds" for i in range(p) if min(room[i], room[p + i]) < 0]


class KernelParts(NamedTuple):
    """A kernel with slices of v and of a result.

    box, y_end, known, sizes: of v,
    the entries that also enter by absolute value and these values; checks, first, others, inner:
    of a result, the last three the candidates for the bounds of x, and those of z.
    """

    rows: Matrix
    blank: Matrix
    halves: Matrix
    box: slice
    y_end: slice
    known: slice
    sizes: slice
    checks: slice
    first: slice
    others: tuple[slice, ...]
    inner: tuple[slice, ...]


def largest(blocks: list[Matrix]) -> Matrix:
    """The largest entries of blocks of one shape; nothing where there are none."""
    if len(blocks) < 2:
        return blocks[0] if blocks else np.zeros(0)
    ends = np.maximum(blocks[0], blocks[1])
    for block in blocks[2:]:
        np.maximum(ends, block, out=ends)
    return ends
