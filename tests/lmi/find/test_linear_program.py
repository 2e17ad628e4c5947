"""HiGHS behind one door: the same optimum as another route to it, and no answer where none is."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from lmi.find.linear_program import minimise


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6), m=st.integers(1, 8))
def test_the_optimum_is_that_of_scipy(seed: int, n: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((m, n)) * (rng.random((m, n)) < 0.7)
    upper, cost = rng.standard_normal(m), rng.standard_normal(n)
    low, high = np.full(n, -2.0), np.full(n, 3.0)
    sides = np.full(m, -np.inf), upper
    x = minimise(cost, A, sides, (low, high))
    other = linprog(cost, A_ub=A, b_ub=upper, bounds=list(zip(low, high, strict=True)))
    assert (x is None) == (other.status != 0)
    if x is not None:
        assert math.isclose(cost @ x, other.fun, rel_tol=1e-7, abs_tol=1e-7)
        assert (A @ x <= upper + 1e-6).all()
    # the same entries one by one, in halves and in any order
    row, column = np.nonzero(np.ones_like(A))
    order = rng.permutation(2 * row.size)
    parts = tuple(np.tile(part, 2)[order] for part in (row, column, A.ravel() / 2))
    again = minimise(cost, parts, sides, (low, high))
    assert (again is None) == (x is None)
    if x is not None and again is not None:
        assert math.isclose(cost @ x, cost @ again, rel_tol=1e-7, abs_tol=1e-7)


def test_equations_are_rows_with_equal_sides() -> None:
    one = np.ones(1)
    x = minimise(np.array([1.0, 2.0]), np.ones((1, 2)), (3 * one, 3 * one),
                 (np.zeros(2), np.full(2, np.inf)))  # fmt: skip
    assert x is not None
    assert np.allclose(x, [3.0, 0.0])


def test_no_answer_where_there_is_none() -> None:
    cost, A, free = np.ones(1), np.ones((1, 1)), (np.array([-np.inf]), np.array([np.inf]))
    assert minimise(cost, A, (np.array([-np.inf]), np.zeros(1)), free) is None  # unbounded
    assert minimise(cost, A, (np.ones(1), np.zeros(1)), free) is None  # infeasible
    assert minimise(cost, np.array([[np.nan]]), (np.zeros(1), np.ones(1)), free) is None
    assert minimise(np.array([np.inf]), A, (np.zeros(1), np.ones(1)), free) is None
    assert minimise(cost, A, (np.zeros(1), np.ones(1)), free) is not None
