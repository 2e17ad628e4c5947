"""Functions of one variable on a short range, enclosed in balls by their mean value form.

A `Path` is a matrix function X of s, |s - m| <= r, known by X(m), by balls around all its values,
and by balls around its derivative. Products and sums of paths are paths, and so are absolute
values, which are Lipschitz: where an entry may vanish, their derivative is within that of the entry
with either sign (G. Lebourg, C. R. Acad. Sci. Paris 281 (1975)). So X(s) is within X(m) plus r
times a ball, up to a term of second order in r.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.balls import (
    Ball,
    Balls,
    Exact,
    Rational,
    around_zero,
    ball,
    exact,
    exp_around,
    exp_times,
    number,
)
from lmi.arithmetic.exponential import FLOW_PIECES


@dataclass(frozen=True)
class Time:
    """A time that is affine in s: its exact middle, its largest distance from there, its rate."""

    middle: Rational
    reach: float
    rate: Rational

    def over(self, pieces: int) -> Time:
        """A share of it; pieces: a power of two."""
        return Time(self.middle / pieces, self.reach / pieces, self.rate / pieces)


@dataclass(frozen=True)
class Path:
    """Ball matrices: the value in the middle, the values, and the derivatives on the range."""

    middle: Balls
    values: Balls
    slopes: Balls

    def __add__(self, other: Path) -> Path:
        return Path(
            self.middle + other.middle, self.values + other.values, self.slopes + other.slopes
        )

    def __mul__(self, other: Path) -> Path:
        return Path(
            self.middle * other.middle,
            self.values * other.values,
            self.slopes * other.values + self.values * other.slopes,
        )

    def absolute(self) -> Path:
        """Entry by entry."""
        either_sign = around_zero(number(1.0))
        signed = [
            slope if value > 0 else -slope if value < 0 else slope * either_sign
            for value, slope in zip(self.values.entries(), self.slopes.entries(), strict=True)
        ]
        shape = (self.middle.nrows(), self.middle.ncols())
        return Path(
            _each(self.middle, abs), _each(self.values, abs), type(self.middle)(*shape, signed)
        )

    def upper(self, reach: float) -> list[Ball]:
        """Balls whose upper ends are above every entry on the range; reach: its half length."""
        pairs = zip(self.middle.entries(), self.slopes.entries(), strict=True)
        return [x + around_zero(slope) * number(reach) for x, slope in pairs]


def constant(X: Exact) -> Path:
    """An exact matrix, or vector, as a path."""
    whole = ball(X[:, None] if X.ndim == 1 else X)
    return Path(whole, whole, ball(0 * (X[:, None] if X.ndim == 1 else X)))


def exponential(A: Exact, time: Time) -> Path:
    """e^(A t) for an exact A."""
    middle = exp_times(A, time.middle)
    values = middle * exp_around(A, time.reach)
    return Path(middle, values, ball(A * time.rate) * values)


def absolute_flow(left: Exact, A: Exact, b: Exact, time: Time) -> tuple[Path, Path]:
    """(|X e^(A t)|, bound of int_0^t |X e^(A s)| ds b), X = left: see `absolute_flow`.

    A (n, n), b (n,) >= 0, exact; in the same pieces as there.
    """
    n, piece = len(A), time.over(FLOW_PIECES)
    metzler = np.full((n + 1, n + 1), A[0, 0] * 0, dtype=object)
    metzler[:n, :n] = np.where(np.eye(n, dtype=bool), A, np.abs(A))
    metzler[:n, n] = b
    step, start = exponential(A, piece), constant(exact(np.eye(n + 1)[:, n:]))
    pushed = constant(exact(np.eye(n, n + 1))) * exponential(metzler, piece) * start
    flow = constant(left)
    size = flow.absolute()
    total = size * pushed
    for _ in range(FLOW_PIECES - 1):
        flow = flow * step
        total = total + flow.absolute() * pushed
    return (flow * step).absolute(), total


def _each(X: Balls, function: Callable[[Ball], Ball]) -> Balls:
    return type(X)(X.nrows(), X.ncols(), [function(x) for x in X.entries()])
