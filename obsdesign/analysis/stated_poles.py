"""Poles that a problem states, as an exact polynomial, and how near a matrix comes to them.

Eigenvalues are compared by coefficients of polynomials: single ones of a chain may move far where
no coefficient does.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.balls import Exact, Rational, characteristic_polynomial, nearest_float, rational
from lmi.arithmetic.polynomials import divided, product
from obsdesign.problem.options import Pole

# relative distance of coefficients of polynomials that counts as none
TOLERANCE = 1e-5
# the same of coefficients that are 0 for the stated poles, and what rounding alone leaves
ROUNDING = 1e-12
# where rounding a gain leaves more than this, no three digits are left: the poles are not placed
LARGEST_GAP = 1e-3
# parts of the largest coefficient of the other factor that its zeros count as
_LEAST = 2.0**-20


@dataclass(frozen=True)
class Gap:
    """Worst coefficient of a characteristic polynomial against that of stated poles.

    relative: its distance, in parts of the same coefficient of the product of s + |pole|, where a
    pole at 0 counts as `size_of_zero`; degree: its power of s; is_rounding: every coefficient is
    within `TOLERANCE` (`ROUNDING` where it is 0 for the stated poles), or exceeds that by no more
    than the rounding of gains to binary64 may change.
    """

    relative: float
    degree: int
    is_rounding: bool
    size_of_zero: float


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


def gap(
    F: Exact, poles: Sequence[Pole], changes: Iterable[Exact] = (), *, flow: Exact | None = None
) -> Gap:
    """How far F (n, n) is from having the poles among its eigenvalues, decided exactly.

    The remainder of det(s I - F) after division by the polynomial of the poles; n poles at most.
    changes: (n, n) each, what the rounding of one gain adds to F; flow: the plant's (n, n), whose
    unit of time is that of poles at 0 alone.
    """
    stated = product(real_factors(poles))
    values = with_conjugates(poles).tolist()
    zero = max(map(abs, values)) or _pace(F if flow is None else flow) or _pace(F) or 1.0
    whole = product([[rational(abs(v) or zero), rational(1.0)] for v in values])
    quotient, remainder = divided(characteristic_polynomial(F), stated)
    least = rational(_LEAST) * max(abs(c) for c in quotient)
    scale = product([whole, [abs(c) or least for c in quotient]])
    room = [0 * c for c in remainder]
    for change in changes:
        _, other = divided(characteristic_polynomial(F + change), stated)
        room = [r + abs(b - a) for r, a, b in zip(room, remainder, other, strict=True)]
    parts = [abs(c) / s for c, s in zip(remainder, scale, strict=False)]
    degree = max(range(len(parts)), key=lambda k: parts[k])
    # the coefficients of lower powers than the number of poles at 0 are 0
    zeros = values.count(0)
    is_rounding = all(
        part <= rational(ROUNDING if k < zeros else TOLERANCE) + room[k] / scale[k]
        for k, part in enumerate(parts)
    )
    return Gap(nearest_float(parts[degree]), degree, is_rounding, zero)


def complex_text(value: complex) -> str:
    """Text of a mode, with its conjugate."""
    return f"{value.real:.6g}" + (f" +- {abs(value.imag):.6g}i" if value.imag else "")


def _pace(F: Exact) -> float:
    """Size of the eigenvalues of F, to a factor, from its polynomial; 0 where all are 0.

    A power of two: that of the largest coefficient, each to the power that makes it a rate.
    """
    coefficients = characteristic_polynomial(F)[:-1]
    bits = [
        math.ceil((int(c.p).bit_length() - int(c.q).bit_length()) / (len(F) - k))
        for k, c in enumerate(coefficients)
        if c
    ]
    return 2.0 ** min(max(bits), 1000) if bits else 0.0
