"""A step of an observer as tables and a fixed list of products: what C is written from.

Every kind's step is a product of one table with v = [e; y0; y1; known; 1], e what the state
carries, y0 and y1 the measurements at start and end, known the input of a step or of a jump. Bounds
(`Program.has_bounds`) append |v|, and take the largest of several results of one entry.

    flow        by the length of the step, and by which measurements are there
    jump        by whether its measurement is there, and by the dwell time that ends with it
    still       with a sample just after a jump, where samples are events
    initial     from bounds of x to those of z, x = S z
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.errors import InputError
from obsdesign.export.precision import Precision, covered, outward
from obsdesign.export.timing import Timing

# of a step, by which of its measurements are there: at its start, at its end
FLOWS = ("none", "start", "end", "both")


@dataclass(frozen=True)
class Product:
    """A table and how its results are read.

    rows (k, width). Of bounds: `rooms` rows that are negative where y1 contradicts the box, a sum
    of all magnitudes, and blocks of `ends` rows: `outer` candidates for the bounds of x, `inner`
    for those of z; whole: places of the blocks without cuts, of x and of z. Of a point estimate:
    its rows alone.
    """

    rows: Matrix
    rooms: int = 0
    outer: int = 1
    inner: int = 0
    whole: tuple[int, int] = (0, 0)

    @property
    def terms(self) -> int:
        """Products of the longest row that are not zero."""
        return int(np.count_nonzero(self.rows, axis=1).max(initial=0))

    def in_precision(self, target: Precision) -> Product:
        """The same on a target, bounds rounded outward; InputError beyond its range."""
        rows = self._rounded(target) if self.rooms else target.nearest(self.rows)
        if not np.isfinite(rows).all():
            raise InputError(
                f"--precision {target.name}: a number of the design is beyond its range; "
                "use double, or other units."
            )
        return replace(self, rows=rows)

    def _rounded(self, target: Precision) -> Matrix:
        """Rows of bounds, and a sum of magnitudes above each of their sums."""
        upper = outward(self.rows[: self.rooms], 1.0, target)
        lower = outward(self.rows[self.rooms + 1 :], -1.0, target)
        weights = 2.0 * np.abs(np.vstack([upper, lower])).sum(axis=0)
        middle = len(weights) // 2
        weights[middle:] += weights[:middle]
        weights[:middle] = 0.0
        total = target.above(weights * (1.0 + target.unit))
        return np.vstack([upper, total, lower])

    def candidates(self, ends: int) -> tuple[list[int], list[list[int]], list[list[int]]]:
        """Rows without cuts, and of each end the distinct candidates of x and of z."""
        first = self.rooms + 1
        whole = self.whole if self.inner else self.whole[:1]
        blocks = range(self.outer + self.inner)
        of_x, of_z = (
            [self._distinct([first + k * ends + i for k in each]) for i in range(ends)]
            for each in (blocks[: self.outer], blocks[self.outer :])
        )
        plain = [first + k * ends + i for k in whole for i in range(ends)]
        return plain, of_x, of_z if self.inner else []

    def _distinct(self, places: list[int]) -> list[int]:
        texts = [self.rows[place].tobytes() for place in places]
        return [place for k, place in enumerate(places) if texts[k] not in texts[:k]]

    def margin(self, target: Precision) -> float:
        """How many times each row covers the rounding of its products, at least."""
        upper, lower = self.rows[: self.rooms], self.rows[self.rooms + 1 :]
        return min(covered(upper, 1.0, target), covered(lower, -1.0, target))


@dataclass(frozen=True)
class Rules:
    """Which rows are in time, and which measurement a jump has.

    when: before | after | none; corrects: does a measurement between jumps count? is_periodic: are
    samples events, a period apart? allows_no_second_jump: between two of them? input_bound,
    jump_input_bound: largest |u| and |w| that bounds of the error of a point estimate count on,
    None without any. window: spacings that the gain of a jump depends on, the last ones; 0 of none.
    samples: of the window that an estimate comes from, 0 without one. bridges_gaps: are estimates
    after a missing sample those of the runtime?
    """

    when: str
    corrects: bool
    is_periodic: bool = False
    allows_no_second_jump: bool = False
    input_bound: Matrix | None = None
    jump_input_bound: Matrix | None = None
    window: int = 0
    samples: int = 0
    bridges_gaps: bool = True


@dataclass(frozen=True)
class Program:
    """An observer for a target.

    n, p, m, l: numbers of states, outputs and inputs of flow and jump; ends: of what the state
    carries; products: all tables, each once; flows: of each length by `FLOWS` the places of tables,
    the first of length zero, None where nothing changes; jumps: of each dwell cell, or sequence of
    spacings, those without and with a measurement; still, initial: places, None where there are
    none. through: of each length a step and a jump at its end without a measurement, as one
    product, none without periodic samples. first, q: place of x in what a point observer carries,
    number of unknown inputs after it. full: by `FLOWS` a step with a full window of samples.
    """

    kind: str
    target: Precision
    sizes: Sizes
    products: tuple[Product, ...]
    flows: tuple[Mapping[str, int] | None, ...]
    jumps: tuple[tuple[int, int], ...]
    still: int | None
    initial: int | None
    timing: Timing
    rules: Rules
    first: int = 0
    q: int = 0
    through: tuple[int | None, ...] = ()
    full: Mapping[str, int] | None = None

    @property
    def answer(self) -> slice:
        """Where the estimate is in what is carried: bounds, or x and d."""
        count = self.sizes.ends if self.has_bounds else self.sizes.n + self.q
        return slice(self.first, self.first + count)

    @property
    def has_bounds(self) -> bool:
        """Does it answer with bounds?"""
        return self.kind == "interval"

    @property
    def refines_gaps(self) -> bool:
        """Do bounds of z cut those of x once more where a periodic sample is missing?"""
        return self.rules.is_periodic and any(product.inner for product in self.products)

    @property
    def width(self) -> int:
        """Length of v, magnitudes included."""
        return self.sizes.middle * (2 if self.has_bounds else 1)


@dataclass(frozen=True)
class Sizes:
    """Numbers of states, outputs, inputs of the flow and of the jump, and of what is carried.

    is_apart: do inputs of flow and jump have places of their own in v, as products of both need?
    """

    n: int
    p: int
    m: int
    l: int  # noqa: E741
    ends: int
    is_apart: bool = False

    @property
    def before_jump_inputs(self) -> int:
        """Known inputs before those of the jump."""
        return self.m if self.is_apart else 0

    @property
    def known(self) -> int:
        """Known inputs in v, of the flow or of the jump."""
        return max(self.m, self.before_jump_inputs + self.l)

    @property
    def middle(self) -> int:
        """Length of v without magnitudes."""
        return self.ends + 2 * self.p + self.known + 1

    def widened(
        self, rows: Matrix, inputs: int, *, has_magnitudes: bool, before: int = 0
    ) -> Matrix:
        """Rows for `inputs` known numbers as rows for all that v has, the first after `before`."""
        first, last = (
            np.zeros((len(rows), count)) for count in (before, self.known - inputs - before)
        )
        parts = np.hsplit(rows, 2) if has_magnitudes else [rows]
        blocks = (np.hsplit(part, [-inputs - 1, -1]) for part in parts)
        return np.hstack(
            [np.hstack([e, first, known, last, constant]) for e, known, constant in blocks]
        )


class Tables:
    """Products that are collected, each distinct table once."""

    def __init__(self, target: Precision) -> None:
        self._target = target
        self._places: dict[tuple[bytes, int, int, tuple[int, int]], int] = {}
        self.products: list[Product] = []

    def place(self, product: Product) -> int:
        """Where a product stands among those of the target, as its numbers."""
        own = product.in_precision(self._target)
        key = (own.rows.tobytes(), own.outer, own.inner, own.whole)
        if key not in self._places:
            self._places[key] = len(self.products)
            self.products.append(own)
        return self._places[key]

    def flow(self, of_mode: Mapping[str, Product]) -> dict[str, int]:
        """Places of the products of a step by `FLOWS`."""
        return {name: self.place(of_mode[name]) for name in FLOWS}


def flat_flows(flows: Sequence[Mapping[str, int] | None]) -> list[list[int]]:
    """Places of tables by length and by `FLOWS`; -1 where nothing changes."""
    return [[-1 if each is None else each[name] for name in FLOWS] for each in flows]
