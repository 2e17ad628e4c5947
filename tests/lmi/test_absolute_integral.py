"""Integrals of |e^(Fs) E|: above the integral, and close to it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from lmi.arithmetic.balls import exact
from lmi.bounds.absolute_integral import absolute_integrals
from lmi.bounds.peak_gain import peak_gains


def quadrature(F: np.ndarray, E: np.ndarray) -> np.ndarray:
    """The same by the midpoint rule, until all has decayed."""
    decay = -np.linalg.eigvals(F).real.max()
    step = 2e-3 / np.abs(F).sum(axis=1).max()
    flow, state, total = expm(F * step), expm(F * step / 2) @ E, np.zeros(E.shape)
    for _ in range(int(np.ceil(14 / decay / step))):
        total += step * np.abs(state)
        state = flow @ state
    return total


@pytest.mark.parametrize("seed", range(3))
def test_bounds_exceed_the_integral_by_little(seed: int) -> None:
    rng = np.random.default_rng(seed)
    F = rng.normal(size=(3, 3))
    F -= (np.linalg.eigvals(F).real.max() + 0.3) * np.eye(3)
    E = rng.normal(size=(3, 2))
    bound = absolute_integrals(exact(F), exact(E))
    assert bound is not None
    ratio = bound / quadrature(F, E)
    assert (ratio > 1 - 2e-6).all()
    assert (ratio < 1.01).all()


def test_an_oscillation_is_bounded_better_than_by_its_energy() -> None:
    F, E = np.array([[0, 1], [-1, -0.4]]), np.array([[0.0], [1.0]])
    bound = absolute_integrals(exact(F), exact(E))
    peaks = peak_gains(exact(F), exact(E), exact(np.eye(2)))
    assert bound is not None
    assert peaks is not None
    assert (bound < 0.9 * peaks[1]).all()
    assert bound == pytest.approx(quadrature(F, E), rel=3e-3)
    # exact without oscillations, at any stiffness
    slow = absolute_integrals(exact(np.diag([-1e-3, -1e3])), exact(np.ones((2, 1))))
    assert slow is not None
    assert slow[:, 0] == pytest.approx([1e3, 1e-3], rel=2e-3)


def graded(F: np.ndarray, E: np.ndarray) -> np.ndarray:
    """The same by the midpoint rule with steps that double as fast modes decay."""
    eigenvalues = np.linalg.eigvals(F)
    step, longest = 1e-2 / np.abs(F).sum(axis=1).max(), 2e-2 / np.abs(eigenvalues).min()
    time, total = 0.0, np.zeros(E.shape)
    while time < -16 / eigenvalues.real.max():
        state = expm(F * (time + step / 2)) @ E
        flow = expm(F * step)
        for _ in range(500):
            total += step * np.abs(state)
            state = flow @ state
        time, step = time + 500 * step, min(2 * step, longest)
    return total


@pytest.mark.parametrize(
    ("F", "E"),
    [
        ([[-42.5, 0.3], [-24.2, -0.6]], [[0.1, 0, 0.42], [0, 0.05, 0.25]]),
        ([[-1e4, 3e3], [40.0, -20.0]], [[1, 0], [1, 1]]),
        ([[-3e3, 1, 0], [1, -5, 1], [0, 1, -0.3]], np.eye(3)),
        ([[-1, 1, 0], [0, -1, 1], [0, 0, -1]], np.eye(3)[:, 2:]),
    ],
    ids=["output fed back strongly", "coupled", "three decades", "defective"],
)
def test_modes_far_apart_cost_nothing(F: list[list[float]], E: object) -> None:
    """Each cell of time is as long as what has not decayed admits."""
    columns = np.array(E, np.float64)
    bound = absolute_integrals(exact(F), exact(columns))
    assert bound is not None
    ratio = bound.sum(axis=1) / graded(np.array(F), columns).sum(axis=1)
    assert (ratio > 1 - 1e-4).all()
    assert (ratio < 1.01).all()


def last_driven(poles: list[complex]) -> tuple[np.ndarray, np.ndarray]:
    """The companion matrix of these poles, and an input to its last state."""
    n = len(poles)
    F = np.diag(np.ones(n - 1), 1)
    F[-1] = -np.poly(poles).real[:0:-1]
    return F, np.eye(n)[:, -1:]


@pytest.mark.parametrize(
    "poles",
    [[-3] * 2, [-1] * 3, [-1] * 4, [-1] * 5, [-1 + 1e-3j, -1 - 1e-3j] * 2],
    ids=["two", "three", "four", "five", "pairs"],
)
def test_equal_poles_are_bounded_as_those_that_differ(poles: list[complex]) -> None:
    F, column = last_driven(poles)
    bound = absolute_integrals(exact(F), exact(column))
    assert bound is not None
    ratio = bound / graded(F, column)
    assert (ratio > 1 - 1e-4).all()
    assert (ratio < 1.01).all()
    # the twin, another matrix by a unit in the last place
    F[-1, 0] = np.nextafter(F[-1, 0], 0)
    assert absolute_integrals(exact(F), exact(column)) == pytest.approx(bound, rel=1e-3)


@pytest.mark.parametrize(
    ("damping", "excess"), [(0.03, 0.001), (0.01, 0.08), (0.003, 0.31), (0.001, 0.47), (1e-6, 0.57)]
)
def test_little_damping_costs_at_most_the_envelope(damping: float, excess: float) -> None:
    """The integral of |e^(-ds) sin(ws)| / w, d^2 + w^2 = 1, is coth(pi d / 2w)."""
    F, column = np.array([[0, 1], [-1, -2 * damping]]), np.array([[0.0], [1.0]])
    bound = absolute_integrals(exact(F), exact(column))
    assert bound is not None
    integral = 1 / np.tanh(np.pi * damping / 2 / np.sqrt(1 - damping**2))
    assert 1 < bound[0, 0] / integral < 1.01 + excess


@pytest.mark.parametrize("angle", [0.09, 0.11])
def test_a_pair_is_bounded_alike_whether_it_is_split_or_not(angle: float) -> None:
    F, column = last_driven([-1 + 1j * angle, -1 - 1j * angle, -30])
    bound = absolute_integrals(exact(F), exact(column))
    assert bound is not None
    assert bound == pytest.approx(graded(F, column), rel=0.01)
    # the twin does not decay
    F, column = last_driven([1 + 1j * angle, 1 - 1j * angle, -30])
    assert absolute_integrals(exact(F), exact(column)) is None


@pytest.mark.parametrize(("slow", "is_bounded"), [(-1e-6, True), (0.0, False), (1e-6, False)])
def test_decay_of_the_slowest_mode_is_required(slow: float, is_bounded: bool) -> None:
    F, column = exact([[-1e3, 1e3], [0.0, slow]]), exact(np.ones((2, 1)))
    assert (absolute_integrals(F, column) is not None) == is_bounded


def test_nothing_is_bounded_that_does_not_decay() -> None:
    column = exact(np.ones((2, 1)))
    assert absolute_integrals(exact(np.diag([-1.0, 0.0])), column) is None
    assert absolute_integrals(exact([[0.0, 1.0], [-1.0, 0.0]]), column) is None
    # the twin
    assert absolute_integrals(exact(np.diag([-1.0, -1e-3])), column) is not None


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_a_fast_state_that_acts_on_no_slow_one_leaves_it_close(order: tuple[int, ...]) -> None:
    """A sensor 3000 times as fast as the wall, and a second wall behind the first one."""
    F = np.array([[-300.0, 300.0, 0.0], [0.0, -0.1, 0.0], [0.0, 0.2, -0.2]])
    E = np.array([[30.0, 0.0], [0.0, 0.01], [0.0, 0.0]])
    exactly = np.array([[0.1, 0.1], [0.0, 0.1], [0.0, 0.1]])
    bound = absolute_integrals(exact(F[np.ix_(order, order)]), exact(E[list(order)]))
    assert bound is not None
    assert (bound >= exactly[list(order)] * (1 - 1e-15)).all()
    assert bound == pytest.approx(exactly[list(order)], rel=3e-3)


def test_a_state_that_nothing_drives_must_decay_too() -> None:
    F = np.array([[-1.0, 1.0], [0.0, 0.1]])
    assert absolute_integrals(exact(F), exact([[1.0], [0.0]])) is None
    assert absolute_integrals(exact(F.T), exact([[1.0], [0.0]])) is None
    F[1, 1] = -0.1
    assert absolute_integrals(exact(F), exact([[1.0], [0.0]])) == pytest.approx(
        np.array([[1.0], [0.0]])
    )
