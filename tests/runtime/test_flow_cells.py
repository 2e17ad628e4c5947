"""Maps of steps of any length against exponentials in many digits, and as a semigroup."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import exact, exp_times, middle, precision
from obsdesign.runtime.flow_cells import FlowCells

SEEDS = st.integers(0, 2**32 - 1)


def random_flow(seed: int, n: int) -> Matrix:
    """A flow with time constants around one, some entries zero."""
    rng = np.random.default_rng(seed)
    return np.asarray(rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.8))


def true_map(N: Matrix, h: float) -> Matrix:
    with precision(200):
        return middle(exp_times(exact(N), h))


@settings(max_examples=12, deadline=None)
@given(SEEDS, st.integers(1, 5), st.floats(-12, 4), st.integers(-30, 30))
def test_maps_are_those_of_many_digits(seed: int, n: int, size: float, units: int) -> None:
    """At any length, in any units of time and of states."""
    N, h = random_flow(seed, n), math.exp(size)
    scales = np.exp2(np.random.default_rng(seed).integers(-20, 21, n).astype(float))
    N = scales[:, None] * N / scales * 2.0**units
    got, true = FlowCells(N, n).at(h * 2.0**-units), true_map(N, h * 2.0**-units)
    error = np.abs(got - true) / scales[:, None] * scales
    largest = math.exp(min(np.linalg.norm(random_flow(seed, n), 2) * h, 700.0))
    assert error.max() <= 2e-14 * max(h, 1.0) * n * largest


@settings(max_examples=12, deadline=None)
@given(SEEDS, st.floats(0.01, 3.0), st.floats(0.01, 3.0))
def test_two_steps_are_the_step_of_both(seed: int, first: float, second: float) -> None:
    cells = FlowCells(random_flow(seed, 3) - 2 * np.eye(3), 3)
    both = cells.at(first + second)
    np.testing.assert_allclose(cells.at(second) @ cells.at(first), both, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("h", [0.25, 0.5, 1.0, 1.3, 7.0])
def test_neighbours_across_an_edge_of_cells_agree(h: float) -> None:
    cells = FlowCells(random_flow(3, 4), 4)
    for edge in np.linspace(h, 2 * h, 9):
        below, above = cells.at(math.nextafter(float(edge), 0.0)), cells.at(float(edge))
        np.testing.assert_allclose(below, above, rtol=1e-12, atol=1e-14)


def test_a_map_does_not_depend_on_what_came_before() -> None:
    """So that a stream that is resumed gives the same numbers."""
    N = random_flow(5, 3)
    lengths = np.random.default_rng(5).uniform(0.01, 2.0, 600).tolist()
    warm = FlowCells(N, 2)
    for h in lengths:
        warm.at(h)
    assert all(np.array_equal(warm.at(h), FlowCells(N, 2).at(h)) for h in lengths[:40])


def test_what_a_state_never_depends_on_stays_zero() -> None:
    cells = FlowCells(np.array([[-0.7, 0.0, 1.0], [1.0, -2.0, 0.0], [0.0, 0.0, 0.0]]), 2)
    for h in (0.01, 3.0, 1000.0):
        assert cells.at(h)[0, 1] == 0.0
        assert (cells.at(h)[1] != 0.0).all()


def test_long_steps_have_exponentials_of_their_own() -> None:
    N = np.array([[-1000.0, 1.0], [0.0, -1.0]])
    cells = FlowCells(N, 2)
    assert cells.longest < 3.0
    np.testing.assert_allclose(cells.at(3.0), true_map(N, 3.0), rtol=1e-12, atol=1e-300)


@pytest.mark.parametrize("unit", [2.0**-30, 2.0**30])
def test_units_of_time_share_cells_alike(unit: float) -> None:
    """Inputs beside the flow, in units of their own, do not shorten the cells."""
    A, b = random_flow(7, 3), np.ones((3, 1))
    N = np.block([[A, b], [np.zeros((1, 4))]])
    ours = np.block([[A * unit, b], [np.zeros((1, 4))]])
    assert 0.5 <= FlowCells(ours, 3).longest * unit / FlowCells(N, 3).longest <= 2.0


def test_no_flow_at_all() -> None:
    cells = FlowCells(np.zeros((2, 2)), 2)
    for h in (5e-324, 1e-310, 1e-300):
        assert np.array_equal(cells.at(h), np.eye(2))
    assert np.array_equal(cells.at(1e300), np.eye(2))
