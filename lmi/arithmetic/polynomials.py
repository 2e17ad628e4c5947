"""Polynomials as lists of coefficients, constant term first: of exact numbers, or of balls."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from typing import TypeVar

from lmi.arithmetic.balls import Ball, Rational, rational

Coefficient = TypeVar("Coefficient", Ball, Rational)


def times(p: Sequence[Coefficient], q: Sequence[Coefficient]) -> list[Coefficient]:
    """Product of two polynomials."""
    result = [0 * p[0] for _ in range(len(p) + len(q) - 1)]
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            result[i + j] = result[i + j] + a * b
    return result


def product(factors: Iterable[Sequence[Rational]]) -> list[Rational]:
    """Product of exact polynomials; 1 where there are none."""
    return reduce(times, map(list, factors), [rational(1.0)])


def divided(
    p: Sequence[Rational], monic: Sequence[Rational]
) -> tuple[list[Rational], list[Rational]]:
    """Exact quotient and remainder of p by a monic polynomial.

    monic: of degree d, at most len(p) - 1, its last coefficient 1; the remainder has d
    coefficients.
    """
    remainder, degree = list(p), len(monic) - 1
    quotient = [rational(0.0)] * (len(p) - degree)
    for shift in reversed(range(len(quotient))):
        quotient[shift] = factor = remainder[shift + degree]
        for i, c in enumerate(monic):
            remainder[i + shift] = remainder[i + shift] - factor * c
    return quotient, remainder[:degree]
