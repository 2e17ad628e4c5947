from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lmi.arithmetic.balls import (
    ball,
    certify_positive_definite,
    exact,
    exp_times,
    fixed_vector,
    identity,
    middle,
    number,
    precision,
    to_float,
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
