from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lmi.arithmetic.balls import (
    ball,
    certify_positive_definite,
    cholesky,
    exact,
    exp_around,
    exp_times,
    fixed_vector,
    identity,
    middle,
    norm_bound,
    number,
    pivot_columns,
    precision,
    rank_factors,
    surely_observable,
    to_float,
    upper_ends,
)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_exact_means_exact(value: float) -> None:
    rational = exact(value).item()
    assert Fraction(int(rational.p), int(rational.q)) == Fraction(value)
    assert to_float(exact([value]))[0] == value


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_only_finite_numbers_are_exact(value: float) -> None:
    with pytest.raises(ValueError, match="only finite numbers have an exact value"):
        exact([[1.0, value]])


def test_papers_formulas_run_on_exact_matrices() -> None:
    A, L, C = exact([[0.1, 0.2], [0.3, 0.4]]), exact([[0.1], [0.7]]), exact([[0.3, 3.0]])
    F = A - L @ C
    assert Fraction(int(F[0, 0].p), int(F[0, 0].q)) == Fraction(0.1) - Fraction(0.1) * Fraction(0.3)
    # the twin: floats round
    assert Fraction(0.1 - 0.1 * 0.3) != Fraction(0.1) - Fraction(0.1) * Fraction(0.3)


def test_too_large_for_a_float_is_infinite() -> None:
    big = exact([[1e308]])
    assert to_float(big * big)[0, 0] == np.inf
    assert to_float(-(big * big))[0, 0] == -np.inf


def test_positive_definite_in_three_values() -> None:
    positive = ball(exact([[2.0, -1.0], [-1.0, 2.0]]))
    singular = ball(exact([[1.0, 1.0], [1.0, 1.0]]))
    negative = ball(exact([[1.0, 2.0], [2.0, 1.0]]))
    assert certify_positive_definite(positive)
    assert not certify_positive_definite(singular)
    assert not certify_positive_definite(negative)
    # "not proved" is not "disproved": a ball that is too wide says nothing either way
    with precision(80):
        wide = exp_times(exact([[0.0]]), 1.0) - identity(1)  # zero, or nearly
    assert not certify_positive_definite(wide)
    assert not wide[0, 0] < 0


def test_positive_definite_by_one_unit_in_the_last_place() -> None:
    barely = np.array([[1.0, 1.0], [1.0, np.nextafter(1.0, 2.0)]])
    exactly = np.array([[1.0, 1.0], [1.0, 1.0]])
    beneath = np.array([[1.0, 1.0], [1.0, np.nextafter(1.0, 0.0)]])
    assert certify_positive_definite(ball(exact(barely)))
    assert not certify_positive_definite(ball(exact(exactly)))
    assert not certify_positive_definite(ball(exact(beneath)))


def test_exponential_contains_the_truth() -> None:
    with precision(80):
        E = exp_times(exact([[0.0, 1.0], [0.0, 0.0]]), 3.0)  # [[1, 3], [0, 1]] exactly
        assert E[0, 1].contains(3)
        assert not E[0, 1].contains(number(3.0000001))
        decay = exp_times(exact([[-1.0]]), 1.0)
    with precision(320):
        finer = exp_times(exact([[-1.0]]), 1.0)
    assert decay[0, 0].contains(finer[0, 0])
    np.testing.assert_allclose(middle(decay), np.exp(-1.0), rtol=1e-15)


def test_fixed_vector() -> None:
    # v with X v = 0: exactly, or not at all
    assert fixed_vector([exact([[1.0, -2.0]])]) == [2.0, 1.0]
    assert fixed_vector([exact([[1.0, -2.0]]), exact([[1.0, -2.0000001]])]) is None


def test_kernels_and_factors_of_exact_matrices() -> None:
    rng = np.random.default_rng(0)
    for n, m, rank in ((3, 4, 2), (5, 3, 1), (4, 4, 3), (2, 2, 2)):
        X = rng.integers(-4, 5, (n, rank)) @ rng.integers(-4, 5, (rank, m))
        if np.linalg.matrix_rank(X) < rank:
            continue
        H = exact(X.astype(float))
        U, V = rank_factors(H)
        assert U.shape == (n, rank)
        assert V.shape == (m, rank)
        assert (U @ V.T == H).all()
        assert (H[:, pivot_columns(H)] == U).all()
        v = fixed_vector([H])
        if rank == m:
            assert v is None
        else:
            assert any(v)
            np.testing.assert_allclose(X @ np.array(v), 0, atol=1e-12)


def test_observability_is_certified_or_left_open() -> None:
    A, C = np.array([[0.0, 1, 0], [0, 0, 1], [0, 0, 0]]), np.eye(3)[:1]
    assert surely_observable(exact(A), exact(C))
    assert surely_observable(exact(A), exact(np.vstack([C, C])))
    assert surely_observable(exact(0 * A), exact(np.eye(3)))
    # twins: the last state never shows; one output more does not help
    assert not surely_observable(exact(A.T), exact(C))
    assert not surely_observable(exact(A.T), exact(np.vstack([C, 2 * C])))
    assert not surely_observable(exact(np.eye(2)), exact([[1.0, 2.0]]))


def test_a_cholesky_factor_contains_that_of_the_floats() -> None:
    rng = np.random.default_rng(1)
    X = rng.standard_normal((4, 4))
    S = X @ X.T + np.eye(4)
    with precision(128):
        factor = cholesky(ball(exact(S)))
        assert factor is not None
        np.testing.assert_allclose(middle(factor), np.linalg.cholesky(S), rtol=1e-13, atol=1e-13)
        assert cholesky(ball(exact(S - 9 * np.linalg.norm(S) * np.eye(4)))) is None
        assert cholesky(ball(exact([[1.0, 1.0], [1.0, 1.0]]))) is None


@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_norm_bound_is_above_by_a_small_root(n: int) -> None:
    X = np.random.default_rng(n).standard_normal((n, n))
    with precision(128):
        bound = float(norm_bound(ball(exact(X))).upper())
        assert norm_bound(ball(exact(0 * X))) == 0
    truth = np.linalg.norm(X, 2)
    assert truth * (1 - 1e-14) <= bound <= truth * n ** (1 / 8) * (1 + 1e-14)
    # the eighth root of the sum of eighth powers
    assert bound == pytest.approx((np.linalg.svd(X)[1] ** 8).sum() ** (1 / 8))


def test_an_exponential_around_zero_contains_every_time() -> None:
    F = np.array([[0.0, 1.0], [-2.0, -0.3]])
    with precision(128):
        around = exp_around(exact(F), 0.1)
        for theta in (-0.1, -0.05, 0.0, 0.1):
            assert around.contains(exp_times(exact(F), theta))
        assert not around.contains(exp_times(exact(F), 0.2))
        assert not exp_around(exact(F), 0.01).contains(exp_times(exact(F), 0.05))


def test_ends_are_above_and_next_to_the_balls() -> None:
    with precision(128):
        ends = upper_ends(ball(exact([[1.0, -2.0], [0.0, 3.0]])) * number(1 / 3))
    third = np.array([[1.0, -2.0], [0.0, 3.0]]) * Fraction(1 / 3)
    for end, exact_value in zip(ends.ravel(), third.ravel(), strict=True):
        assert Fraction(end) >= exact_value
        assert Fraction(end) - exact_value <= 4 * Fraction(np.spacing(abs(end)))
    assert ends[1, 0] == 0.0
