"""Poles that a problem states, as an exact polynomial, and how near a matrix comes to them.

Eigenvalues are compared by coefficients of polynomials: single ones of a chain may move far where
no coefficient does.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.balls import (
    Exact,
    Rational,
    characteristic_polynomial,
    nearest_float,
    rational,
    to_float,
)
from obsdesign.problem.options import Pole

# relative distance of coefficients of polynomials that counts as none
TOLERANCE = 1e-5
# a pole at 0 counts as this part of the largest one
_SIZE_OF_ZERO = 2.0**-20


@dataclass(frozen=True)
class Gap:
    """Worst coefficient of a characteristic polynomial against that of stated poles.

    relative: its distance, in parts of the same coefficient of the product of s + |pole|; degree:
    its power of s; is_rounding: every coefficient is within `TOLERANCE`, or within what the
    rounding of gains to binary64 may change.
    """

    relative: float
    degree: int
    is_rounding: bool


def with_conjugates(poles: Sequence[Pole]) -> NDArray[np.complex128]:
    """Numbers or pairs [real, imaginary] as complex numbers; one of a pair stands for both.

    Two are a pair where they are conjugate exactly: a distance would need a unit of time.
    """
    values = [complex(*p) if isinstance(p, Sequence) else complex(p) for p in poles]
    counts = Counter(values)
    pairs = [
        value
        for upper in dict.fromkeys(complex(v.real, abs(v.imag)) for v in values if v.imag)
        for value in [upper, upper.conjugate()] * max(counts[upper], counts[upper.conjugate()])
    ]
    return np.array([v for v in values if not v.imag] + pairs, dtype=np.complex128)


def real_factors(poles: Sequence[Pole]) -> list[list[Rational]]:
    """Monic factors of the polynomial of the poles, one per real pole and per pair; exact.

    Coefficients, constant term first.
    """
    values = with_conjugates(poles).tolist()
    linear = [[-rational(v.real), rational(1.0)] for v in values if not v.imag]
    pairs = [
        [rational(v.real) ** 2 + rational(v.imag) ** 2, -2 * rational(v.real), rational(1.0)]
        for v in values
        if v.imag > 0
    ]
    return linear + pairs


def gap(F: Exact, poles: Sequence[Pole], changes: Iterable[Exact] = ()) -> Gap:
    """How far F (n, n) is from having the poles among its eigenvalues, decided exactly.

    The remainder of det(s I - F) after division by the polynomial of the poles; n poles at most.
    changes: (n, n) each, what the rounding of one gain adds to F.
    """
    values = with_conjugates(poles)
    pace = float(np.abs(values).max(initial=0.0))
    # poles at 0 alone state no unit of time in which a distance could count as none
    tolerance = rational(TOLERANCE if pace else 0.0)
    largest = pace or float(np.abs(to_float(F)).max()) or 1.0
    sizes = [float(abs(v)) or _SIZE_OF_ZERO * largest for v in values.tolist()]
    stated = product(real_factors(poles))
    quotient, remainder = _divided(characteristic_polynomial(F), stated)
    whole = product([[rational(size), rational(1.0)] for size in sizes])
    least = rational(_SIZE_OF_ZERO) * max(abs(c) for c in quotient)
    scale = product([whole, [abs(c) or least for c in quotient]])
    room = [0 * c for c in remainder]
    for change in changes:
        _, other = _divided(characteristic_polynomial(F + change), stated)
        room = [r + abs(b - a) for r, a, b in zip(room, remainder, other, strict=True)]
    parts = [(abs(c) / s, r / s) for c, r, s in zip(remainder, room, scale, strict=False)]
    degree = max(range(len(parts)), key=lambda k: parts[k][0])
    is_rounding = all(part <= tolerance + space for part, space in parts)
    return Gap(nearest_float(parts[degree][0]), degree, is_rounding)


def product(factors: Iterable[Sequence[Rational]]) -> list[Rational]:
    """The product of polynomials, constant terms first."""
    return reduce(_times, map(list, factors), [rational(1.0)])


def complex_text(value: complex) -> str:
    """Text of a mode, with its conjugate."""
    return f"{value.real:.6g}" + (f" +- {abs(value.imag):.6g}i" if value.imag else "")


def _times(p: list[Rational], q: list[Rational]) -> list[Rational]:
    result = [rational(0.0)] * (len(p) + len(q) - 1)
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            result[i + j] = result[i + j] + a * b
    return result


def _divided(p: list[Rational], monic: list[Rational]) -> tuple[list[Rational], list[Rational]]:
    """Quotient and remainder; the latter with as many coefficients as the divisor's degree."""
    rest, degree = list(p), len(monic) - 1
    quotient = [rational(0.0)] * (len(p) - degree)
    for shift in reversed(range(len(quotient))):
        quotient[shift] = factor = rest[shift + degree]
        for i, c in enumerate(monic):
            rest[i + shift] = rest[i + shift] - factor * c
    return quotient, rest[:degree]
