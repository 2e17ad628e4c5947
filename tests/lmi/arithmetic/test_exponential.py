from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.balls import exact, exp_times, middle, precision
from lmi.arithmetic.exponential import expm, exponential_grid, flow_integrals

ROUNDING = 1e-14  # a few dozen units of 2**-53 on well-conditioned cases
# scaling and squaring loses about ||A|| units of 2**-53, times a factor for the dimension
PER_NORM = 20 * 2.0**-53


def reference(A: np.ndarray) -> np.ndarray:
    with precision(4000):
        return middle(exp_times(exact(A), 1.0))


@pytest.mark.parametrize("n", [1, 2, 5, 9])
@pytest.mark.parametrize("norm", [1e-8, 0.01, 0.2, 0.9, 2.0, 5.0, 40.0, 300.0])
def test_against_balls(n: int, norm: float) -> None:
    A = np.random.default_rng(n).standard_normal((n, n))
    A *= norm / np.abs(A).sum(axis=0).max()
    known = reference(A)
    np.testing.assert_allclose(
        expm(A), known, rtol=0, atol=(ROUNDING + PER_NORM * norm) * np.abs(known).max()
    )


@pytest.mark.parametrize(
    "A",
    [
        [[1, 1e6], [0, -1]],  # large off-diagonal entries: scaling by the norm loses digits
        [[-1, 1e10], [0, -3]],
        [[0, 1e8], [-1e-8, 0]],
        [[-147, 72], [-192, 93]],  # Ward's example: hump and near-confluent eigenvalues
        [[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 0, 0, 0]],  # nilpotent
        [[-200, 0], [1000, -0.001]],
    ],
)
def test_hard_cases_against_balls(A: list[list[float]]) -> None:
    known = reference(np.array(A, dtype=float))
    np.testing.assert_allclose(expm(A), known, rtol=0, atol=1e-13 * np.abs(known).max())


def test_a_stack_is_its_members() -> None:
    rng = np.random.default_rng(3)
    sizes = np.array([1e-3, 1.0, 30.0, 700.0])[:, None, None]
    stack = sizes * (rng.standard_normal((4, 3, 3)) - 3 * np.eye(3))
    for matrix, whole in zip(stack, expm(stack), strict=True):
        np.testing.assert_allclose(whole, expm(matrix), rtol=1e-9, atol=1e-300)
        np.testing.assert_allclose(whole, scipy.linalg.expm(matrix), rtol=1e-9, atol=1e-12)


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_overflow_is_never_a_finite_number() -> None:
    assert not np.isfinite(expm([[1000.0]])).any()
    assert not np.isfinite(expm([[1e3, 0], [0, -1]])[0, 0])
    assert np.isnan(expm(1e20 * np.array([[0.0, 1], [-1, 0]]))).all()  # no digit is certain
    assert np.isnan(expm([[np.inf, 0], [0, 0]])).all()
    one_bad = expm([[[np.nan]], [[1.0]]])
    assert np.isnan(one_bad[0, 0, 0])
    assert one_bad[1, 0, 0] == pytest.approx(np.e)
    # the twin: large but harmless
    assert expm([[-1000.0]]) == 0.0


def test_only_square_matrices() -> None:
    with pytest.raises(ValueError, match=r"square matrices are required.*\(2, 3\)"):
        expm(np.zeros((2, 3)))


@settings(max_examples=12, deadline=None)
@given(st.integers(1, 6), st.integers(1, 70), st.integers(0, 10_000))
def test_a_grid_is_its_points(n: int, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    F, start, step = rng.standard_normal((n, n)), rng.uniform(0, 2), rng.uniform(0, 0.1)
    grid = exponential_grid(F, start, step, count)
    assert grid.shape == (count, n, n)
    for k in {0, count // 2, count - 1}:
        np.testing.assert_allclose(
            grid[k], expm(F * (start + k * step)), rtol=1e-10, atol=1e-10 * np.abs(grid[k]).max()
        )


@settings(max_examples=12, deadline=None)
@given(st.integers(1, 6), st.integers(1, 3), st.integers(1, 70), st.integers(0, 10_000))
def test_rows_of_a_grid_are_those_times_the_grid(n: int, r: int, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    F, left, step = rng.standard_normal((n, n)), rng.standard_normal((r, n)), rng.uniform(0, 0.1)
    rows = exponential_grid(F, 0.3, step, count, left=left)
    whole = left @ exponential_grid(F, 0.3, step, count)
    np.testing.assert_allclose(rows, whole, rtol=1e-10, atol=1e-10 * np.abs(whole).max())


def test_integrals_of_a_singular_flow() -> None:
    # double integrator: e^{As} = [[1, s], [0, 1]]
    flow, integral = flow_integrals([[0.0, 1], [0, 0]], 3.0)
    np.testing.assert_allclose(flow, [[1, 3], [0, 1]], rtol=ROUNDING)
    np.testing.assert_allclose(integral, [[3, 4.5], [0, 3]], rtol=ROUNDING)


def test_integral_law() -> None:
    # A int_0^h e^{As} ds = e^{Ah} - I
    A = np.random.default_rng(5).standard_normal((4, 4))
    flow, integral = flow_integrals(A, 0.8)
    np.testing.assert_allclose(A @ integral, flow - np.eye(4), atol=ROUNDING * 10)
