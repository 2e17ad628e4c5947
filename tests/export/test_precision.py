"""Rows of bounds in another precision are outside those that they come from."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from obsdesign.export.precision import PRECISIONS, covered, outward

FLOAT, DOUBLE = PRECISIONS["float"], PRECISIONS["double"]


def row_of(rng: np.random.Generator, middle: int, *, sign: float) -> Any:
    """A row [s, sign e] with zeros, of many magnitudes."""
    signed = rng.normal(size=middle) * 10.0 ** rng.integers(-3, 3, middle)
    signed[rng.random(middle) < 0.3] = 0.0
    error = np.abs(signed) * 2.0**-50
    error[-1] += 1e-300
    return np.concatenate([signed, sign * error])[None]


def exactly(row: Any, v: Any) -> Fraction:
    pairs = zip(row.tolist(), np.concatenate([v, np.abs(v)]).tolist(), strict=True)
    return sum((Fraction(a) * Fraction(b) for a, b in pairs), Fraction(0))


def in_float(row: Any, v: Any, order: Any, *, flushes: bool) -> Fraction:
    """The sum on a target, its products in some order; flushes: subnormal numbers are zero."""
    tiny = np.finfo(np.float32).tiny
    total = np.float32(0.0)
    terms = np.concatenate([v, np.abs(v)]).astype(np.float32)
    for k in order:
        term = np.float32(row[k]) * terms[k]
        if flushes and abs(term) < tiny:
            term = np.float32(0.0)
        total = np.float32(total + term)
        if flushes and abs(total) < tiny:
            total = np.float32(0.0)
    return Fraction(float(total))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("scale", [1.0, 1e-38, 1e30])
def test_sums_in_any_order_stay_outside(sign: float, scale: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(60):
        middle = int(rng.integers(2, 12))
        row = row_of(rng, middle, sign=sign)
        target = outward(row, sign, FLOAT)[0]
        v = (scale * rng.normal(size=middle)).astype(np.float32).astype(np.float64)
        v[-1] = 1.0
        truth = exactly(row[0], v)
        order = rng.permutation(2 * middle)
        for flushes in (False, True):
            result = in_float(target, v, order, flushes=flushes)
            assert result <= truth if sign < 0 else result >= truth
    assert covered(outward(row, sign, FLOAT), sign, FLOAT) >= 1.0


def test_rows_that_are_only_rounded_cover_nothing() -> None:
    """The twin: nearest numbers without any margin."""
    rng = np.random.default_rng(2)
    row = row_of(rng, 6, sign=-1.0)
    assert covered(FLOAT.nearest(row), -1.0, FLOAT) < 1.0
    wrong = 0
    for _ in range(100):
        v = np.append(rng.normal(size=5), 1.0).astype(np.float32).astype(np.float64)
        wrong += in_float(FLOAT.nearest(row)[0], v, range(12), flushes=False) > exactly(row[0], v)
    assert wrong > 10


def test_double_is_what_it_was() -> None:
    row = row_of(np.random.default_rng(3), 5, sign=-1.0)
    assert outward(row, -1.0, DOUBLE) is row


def test_numbers_above_are_above_and_normal() -> None:
    values = np.array([0.0, 1e-60, 0.1, 1.0, 3.0e38])
    above = FLOAT.above(values)
    assert (above >= values).all()
    assert above[0] == 0.0
    assert 1e-27 < above[1] < 1e-25
    assert (above.astype(np.float32) == above).all()


@pytest.mark.parametrize("value", [0.0, 0.05, -1.0 / 3.0, 1e-30, 123456.75])
def test_literals_are_exact(value: float) -> None:
    for target in PRECISIONS.values():
        number = float(target.dtype(value))
        text = target.literal(value).removesuffix("f")
        assert (float.fromhex(text) if "x" in text else float(text)) == number
