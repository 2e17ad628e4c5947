"""Linear programs by HiGHS: the optimum of another solver, and none where none exists."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from lmi.find.linear_program import minimise


@settings(max_examples=16, deadline=None)
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
    unit = np.ones(1)
    x = minimise(np.array([1.0, 2.0]), np.ones((1, 2)), (3 * unit, 3 * unit),
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


@pytest.mark.parametrize("limit", [1.0, -1.0])
def test_a_large_program_of_equal_parts_is_each_part(limit: float) -> None:
    """Large programs take another method; of a part that has no solution none of them has."""
    rng, parts = np.random.default_rng(0), 260
    A, cost = rng.standard_normal((20, 10)), rng.uniform(0.1, 1.0, 10)
    A[0] = 1.0
    sides = np.full(20, -np.inf), np.append(limit, A[1:] @ np.full(10, 0.05))
    box = np.zeros(10), np.ones(10)
    alone = minimise(-cost, A, sides, box)
    row, column = np.indices(A.shape).reshape(2, -1)
    entries = (
        np.concatenate([row + 20 * k for k in range(parts)]),
        np.concatenate([column + 10 * k for k in range(parts)]), np.tile(A.ravel(), parts),
    )  # fmt: skip
    all_sides, all_box = ((np.tile(x, parts), np.tile(y, parts)) for x, y in (sides, box))
    x = minimise(np.tile(-cost, parts), entries, all_sides, all_box)
    assert (x is None) == (alone is None) == (limit < 0)
    if x is not None and alone is not None:
        assert x.reshape(parts, 10) @ cost == pytest.approx(np.full(parts, alone @ cost), rel=1e-6)
