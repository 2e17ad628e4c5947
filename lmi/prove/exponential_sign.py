"""Proved signs of f(s) = row e^{F s} z, and of products of such f, over an interval.

Over boxes of a small width such a function is its Taylor polynomial plus a remainder that is
bounded; both are balls. A polynomial is positive where its Bernstein coefficients are.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction

from lmi.arithmetic.arrays import NewEntries
from lmi.arithmetic.balls import Ball, Balls, Exact, ball, exp_times, number, to_float
from lmi.time_budget import UNLIMITED, TimeBudget

_TERMS = 24
_MOST_BOXES = 20_000
_DEPTH = 14

Polynomial = list[Ball]


@dataclass(frozen=True)
class Box:
    """Taylor polynomials on [start, start + width], in v in [0, 1]: one per row of a system."""

    start: float
    width: float
    rows: tuple[Polynomial, ...]


@dataclass
class Effort:
    """Boxes and halvings that a proof may still take: it ends by their number, not by the clock.

    So that the same file is decided alike everywhere; a total budget (`lmi.time_budget`) ends it
    too, with its evidence in `ended`.
    """

    left: int
    budget: TimeBudget = UNLIMITED
    ended: NewEntries = field(default_factory=dict)

    def spend(self) -> None:
        """One more; ValueError when there are none left."""
        self.left -= 1
        if self.left < 0:
            raise ValueError("the ages take too many boxes to cover")
        if out_of_time := self.budget.ended():
            self.ended = out_of_time
            raise ValueError("not all ages were covered")


def boxes(
    F: Exact, z: Balls, start: float, end: float, rows: list[int], *, effort: Effort | None = None
) -> Iterator[Box]:
    """Boxes that cover [start, end] for entries `rows` of e^{F s} z; F exact, z a ball column.

    At the precision in force. ValueError when there would be too many boxes.
    """
    size = float(abs(to_float(F)).sum(axis=1).max())
    count = max(1, math.ceil(size * (end - start)))  # |F| width is at most one
    if count > min(_MOST_BOXES, math.inf if effort is None else effort.left):
        raise ValueError(f"|F| times the length is {size * (end - start):.3g}, too much to cover")
    width = 2.0 ** math.ceil(math.log2((end - start) / count))  # exact in binary
    # a difference in floats may be one rounding short of the end
    count = math.ceil((Fraction(end) - Fraction(start)) / Fraction(width))
    F_ball, step = ball(F), exp_times(F, width)
    at = exp_times(F, start) * z
    norm = number(size * (1 + 1e-12))
    for k in range(count):
        low = start + k * width
        if effort is not None:
            effort.spend()
        yield Box(low, width, _taylor(F_ball, at, norm, width, rows))
        at = step * at


def _taylor(
    F: Balls, at: Balls, norm: Ball, width: float, rows: list[int]
) -> tuple[Polynomial, ...]:
    h = number(width)
    coefficients: list[Balls] = [at]
    for j in range(1, _TERMS):
        coefficients.append(F * coefficients[-1] * (h / j))
    largest = max((abs(entry[0]).upper() for entry in at.tolist()), key=float)
    reach = norm * h
    remainder = (largest * reach**_TERMS * reach.exp() / math.factorial(_TERMS)).upper()
    error = (-remainder).union(remainder)
    table = [c.tolist() for c in coefficients]
    return tuple([*(column[i][0] for column in table[:-1]), table[-1][i][0] + error] for i in rows)


def combined(*terms: tuple[Ball | int, Polynomial]) -> Polynomial:
    """Sum of factor times polynomial."""
    length = max(len(p) for _, p in terms)
    result = [0 * terms[0][1][0] for _ in range(length)]
    for factor, p in terms:
        for i, a in enumerate(p):
            result[i] = result[i] + factor * a
    return result


def positive(p: Polynomial, effort: Effort | None = None) -> bool | None:
    """True: p > 0 on [0, 1], proved. False: p < 0 somewhere, proved. None: neither."""
    return _positive(_bernstein(p), 0.0, 1.0, effort)[0]


def _bernstein(p: Polynomial) -> Polynomial:
    """b_k = sum_i binom(k, i) p_i / binom(n, i), by Pascal's triangle."""
    n = len(p) - 1
    b = [p[i] / math.comb(n, i) for i in range(n + 1)]
    for row in range(1, n + 1):
        for k in range(n, row - 1, -1):
            b[k] = b[k] + b[k - 1]
    return b


def _positive(
    b: Polynomial, low: float, width: float, effort: Effort | None
) -> tuple[bool | None, float]:
    """Verdict of `positive` on [low, low + width] and a place, p < 0 there if that is False."""
    if b[0] < 0:
        return False, low
    if b[-1] < 0:
        return False, low + width
    if all(x > 0 for x in b):
        return True, low
    if width <= 2.0**-_DEPTH:
        return None, low
    if effort is not None:
        effort.spend()
    left, right, row = [b[0]], [b[-1]], b
    while len(row) > 1:
        row = [(x + y) / 2 for x, y in itertools.pairwise(row)]
        left.append(row[0])
        right.append(row[-1])
    half = width / 2
    first = _positive(left, low, half, effort)
    if first[0] is not True:
        return first
    return _positive(right[::-1], low + half, half, effort)


def one_sign(
    cover: Iterator[Box],
    function: Callable[[Box], Polynomial],
    sign: int,
    effort: Effort | None = None,
) -> tuple[bool | None, float]:
    """(verdict of `positive` for sign x function over all boxes, a place that decided).

    Where the verdict is False the function has the other sign at that place.
    """
    place = math.nan
    for box in cover:
        b = _bernstein([sign * c for c in function(box)])
        verdict, part = _positive(b, 0.0, 1.0, effort)
        place = box.start + part * box.width
        if verdict is not True:
            return verdict, place
    return True, place


def value(F: Exact, z: Exact, s: float) -> list[Ball]:
    """Balls of all entries of e^{F s} z."""
    return [row[0] for row in (exp_times(F, s) * ball(z)).tolist()]
