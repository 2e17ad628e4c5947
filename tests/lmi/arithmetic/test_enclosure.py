"""`lmi.arithmetic.enclosure` encloses: checked against 300-bit ball arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, arb_mat, ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.enclosure import TINY, Enclosure, expm, powers, similar

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


@settings(max_examples=20, deadline=None)
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


@settings(max_examples=16, deadline=None)
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


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.sampled_from([1e-4, 0.1, 2.0]))
def test_radii_follow_units_that_are_powers_of_two(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 9))
    X = scale * rng.standard_normal((n, n)) * (rng.random((n, n)) < 0.6)
    X = np.triu(X) if rng.random() < 0.3 else X
    units = np.exp2(rng.integers(-60, 61, n))
    factors = units[:, None] / units
    own, scaled = expm(Enclosure.exactly(X)), expm(Enclosure.exactly(X * factors))
    assert contains(scaled, ball_expm(X * factors, 1.0))
    # the sizes of all paths from one state to another, in any units
    allowed = 1e-12 * expm(Enclosure.exactly(np.abs(X))).mid
    assert (own.rad <= allowed).all()
    assert (scaled.rad / factors <= allowed).all()


@pytest.mark.parametrize("coupling", [1e-60, 1e-30, 4.7e-13])
def test_a_small_coupling_is_known_to_its_own_digits(coupling: float) -> None:
    X = np.array([[-0.19, -2.7e-7, coupling], [-1.8e-5, -0.41, 0], [0, 0, 0]])
    result = expm(Enclosure.exactly(X))
    assert contains(result, ball_expm(X, 1.0))
    assert (result.rad <= 1e-11 * np.abs(result.mid)).all()


def test_growth_on_the_way_does_not_blunt_what_decays() -> None:
    X = np.array([[-14.0, 30.0, 20.0], [0, 40.0, 1.0], [0, 0, 44.0]])
    result = expm(Enclosure.exactly(X))
    assert contains(result, ball_expm(X, 1.0))
    assert (result.rad <= 1e-11 * np.abs(result.mid)).all()


def test_a_large_input_column_costs_nothing() -> None:
    X = np.array([[-1.0, 2e6, 1e9], [0, 0, 0], [0, 0, 0]])
    result = expm(Enclosure.exactly(X))
    assert contains(result, ball_expm(X, 1.0))
    assert result.rad[0, 2] < 1e-12 * result.mid[0, 2]


def test_powers_hold_the_exact_ones_and_stay_narrow() -> None:
    X = np.array([[0.8, 0.6], [-0.6, 0.8]])  # |X| grows like 1.4^l, X^l does not
    result = powers(Enclosure.exactly(X), 200)
    exact_X = np.array([[Fraction(x) for x in row] for row in X])
    power = np.array([[Fraction(1), Fraction(0)], [Fraction(0), Fraction(1)]])
    for mid, rad in zip(result.mid, result.rad, strict=True):
        off = np.abs(power - np.array([[Fraction(x) for x in row] for row in mid]))
        assert (off <= rad).all()
        power = power @ exact_X
    assert result.rad.max() < 1e-11
    # the twin: one factor after the other
    product = Enclosure.exactly(np.eye(2))
    for _ in range(199):
        product = product @ Enclosure(X, np.full((2, 2), 1e-17))
    assert product.rad.max() > 1.0


def test_units_add_the_smallest_number_where_underflow_may_lose_one() -> None:
    matrix = Enclosure(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [1e-200, 0.0]]))
    scaled = similar(matrix, np.array([2.0**-200, 2.0**200]))
    assert scaled.mid.tolist() == [[0.0, 2.0**-400], [0.0, 0.0]]
    # an entry that is zero for every matrix stays so
    assert scaled.rad.tolist() == [[0.0, TINY], [1e-200 * 2.0**400 + TINY, 0.0]]
