"""`lmi.arithmetic.enclosure` encloses: checked against 300-bit ball arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, arb_mat, ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.enclosure import Enclosure, expm, powers

PRECISION = 300  # bits: far more than any case here loses


def ball_expm(X: np.ndarray, h: float) -> arb_mat:
    old, ctx.prec = ctx.prec, PRECISION
    try:
        return arb_mat([[arb(float(v)) * arb(h) for v in row] for row in X]).exp()
    finally:
        ctx.prec = old


def contains(enclosure: Enclosure, exact: arb_mat) -> bool:
    n = len(enclosure.mid)
    return all(
        abs(exact[i, j] - arb(float(enclosure.mid[i, j]))) <= arb(float(enclosure.rad[i, j]))
        for i in range(n)
        for j in range(n)
    )


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(-4, 1.5))
def test_exponential_is_enclosed(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    X = rng.standard_normal((n, n)) * 10.0**scale
    X = np.triu(X) if rng.random() < 0.3 else X
    assert contains(expm(Enclosure.exactly(X)), ball_expm(X, 1.0))


def test_every_factor_in_the_range_is_enclosed() -> None:
    X = np.array([[-3.0, 5.0], [1.0, -7.0]])
    wide = expm(Enclosure.exactly(X).scaled(0.5, 1e-3))
    for h in (0.499, 0.4995, 0.5, 0.501):
        assert contains(wide, ball_expm(X, h))
    # the twin: a factor outside the range is not covered
    assert not contains(wide, ball_expm(X, 0.51))


def test_the_enclosure_is_tight() -> None:
    X = np.array([[-1.0, 2.0, 0.0], [0.0, -0.5, 1.0], [0.3, 0.0, -2.0]])
    result = expm(Enclosure.exactly(X))
    assert np.all(result.rad < 1e-13 * np.abs(result.mid).max())
    assert not contains(Enclosure(result.mid, 0 * result.rad), ball_expm(X, 1.0))


def test_structural_zeros_stay_exact() -> None:
    X = np.array([[-1.0, 2.0], [0.0, -3.0]])
    result = expm(Enclosure.exactly(X))
    assert result.mid[1, 0] == 0.0
    assert result.rad[1, 0] == 0.0


@pytest.mark.parametrize("size", [1e4, 1e7, 1e300])
def test_overflow_is_never_a_finite_answer(size: float) -> None:
    result = expm(Enclosure.exactly([[size, size], [size, -size]]))
    assert not np.isfinite(result.rad).any()


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_units_neither_break_nor_blunt_the_enclosure(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7))
    X = rng.standard_normal((n, n)) * (rng.random((n, n)) < 0.7)
    units = 10.0 ** rng.uniform(-4, 4, n)
    scaled = X * units[:, None] / units[None, :]
    result = expm(Enclosure.exactly(scaled))
    assert contains(result, ball_expm(scaled, 1.0))
    size = np.abs(result.mid) * units[None, :] / units[:, None]
    radius = result.rad * units[None, :] / units[:, None]
    assert radius.max() < 1e-11 * size.max()


def test_a_large_input_column_costs_nothing() -> None:
    X = np.array([[-1.0, 2e6, 1e9], [0, 0, 0], [0, 0, 0]])
    result = expm(Enclosure.exactly(X))
    assert contains(result, ball_expm(X, 1.0))
    assert result.rad[0, 2] < 1e-12 * result.mid[0, 2]


def test_powers_hold_the_exact_ones_and_stay_narrow() -> None:
    X = np.array([[0.8, 0.6], [-0.6, 0.8]])  # |X| grows like 1.4^l, X^l does not
    found = powers(Enclosure.exactly(X), 200)
    exact_X = np.array([[Fraction(x) for x in row] for row in X])
    power = np.array([[Fraction(1), Fraction(0)], [Fraction(0), Fraction(1)]])
    for mid, rad in zip(found.mid, found.rad, strict=True):
        off = np.abs(power - np.array([[Fraction(x) for x in row] for row in mid]))
        assert (off <= rad).all()
        power = power @ exact_X
    assert found.rad.max() < 1e-11
    # the twin: one factor after the other
    one = Enclosure.exactly(np.eye(2))
    for _ in range(199):
        one = one @ Enclosure(X, np.full((2, 2), 1e-17))
    assert one.rad.max() > 1.0
