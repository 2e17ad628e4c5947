"""Integrals of |e^(Fs) E|: above the integral, and close to it."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

from lmi.arithmetic.balls import exact, inverse, rational, to_float
from lmi.bounds.absolute_integral import absolute_integrals
from lmi.bounds.peak_gain import decaying_integrals, peak_gains


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


@pytest.mark.parametrize("damping", [0.03, 0.01, 0.001, 1e-4, 1e-6])
@pytest.mark.parametrize("fast", [[], [-0.7, -30.0]], ids=["alone", "beside fast states"])
def test_little_damping_costs_nothing(damping: float, fast: list[float]) -> None:
    """The integral of |e^(-ds) sin(ws)| / w, d^2 + w^2 = 1, is coth(pi d / 2w)."""
    F = np.diag([0.0, 0.0, *fast])
    F[:2, :2] = [[0, 1], [-1, -2 * damping]]
    F[2:, :2] = 0.5
    column = np.eye(len(F))[:, 1:2]
    bound = absolute_integrals(exact(F), exact(column))
    assert bound is not None
    integral = 1 / np.tanh(np.pi * damping / 2 / np.sqrt(1 - damping**2))
    assert 1 < bound[0, 0] / integral < 1.001
    # the twin does not decay
    F[1, 1] = 0
    assert absolute_integrals(exact(F), exact(column)) is None


def of_pairs(damping: float, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Oscillators of frequencies that differ, in mixed states: F, E and the integral."""
    values = (-damping + 1j) * np.array([1.0, np.sqrt(2.0), np.pi])[: len(slopes)]
    D = np.zeros((2 * len(values), 2 * len(values)))
    for k, value in enumerate(values):
        place = slice(2 * k, 2 * k + 2)
        D[place, place] = [[value.real, value.imag], [-value.imag, value.real]]
    mixing = np.eye(len(D)) + np.diag(np.repeat(slopes, 2)[1:], 1)
    F, E = mixing @ D @ np.linalg.inv(mixing), np.ones((len(D), 1))
    poles, vectors = np.linalg.eig(F)
    weights = vectors * np.linalg.solve(vectors, E)[:, 0]
    length = 8 / damping / 4e5
    times = (np.arange(400_000) + 0.5) * length
    total = np.zeros(len(F))
    for times_of_block in np.array_split(times, 40):
        course = (weights @ np.exp(np.multiply.outer(poles, times_of_block))).real
        total += np.abs(course).sum(axis=1) * length
    return F, E, total[:, None]


@pytest.mark.parametrize("slopes", [[1.0, 1.0], [1.0, 20.0], [1.0, 1.0, 1.0]])
def test_several_pairs_with_little_damping_cost_a_third_at_most(slopes: list[float]) -> None:
    """A sum of envelopes would be 2.5 to 3 times the integral."""
    F, E, integral = of_pairs(1e-3, np.array(slopes))
    bound = absolute_integrals(exact(F), exact(E))
    assert bound is not None
    ratio = bound / integral
    assert (ratio > 1 - 1e-3).all()
    assert (ratio < 1.33).all()


@pytest.mark.parametrize("share", [0.0, 1e-3])
def test_a_state_that_nothing_drives_leaves_others_close(share: float) -> None:
    """Without an input its course is zero, and says nothing of how long cells may be."""
    F = np.array([[-0.6, 0, -0.26, 0], [0, -0.0126, 0, 0], [24.0, 0, -33.8, -47.1],
                  [0, -0.114, 0.606, -0.41]])  # fmt: skip
    E = np.array([[0.3], [share], [-0.7], [-0.08]])
    bound = absolute_integrals(exact(F), exact(E))
    assert bound is not None
    integral = graded(F, E)
    assert (bound >= integral * (1 - 1e-4)).all()
    assert (bound <= integral * 1.01).all()


def test_subspaces_that_are_close_are_taken_apart() -> None:
    """A lightly damped pair that a fast state drives strongly."""
    F = np.array([[0.0, 12.4, 100.0], [-12.4, -2e-3, 120.0], [0.0, 0.0, -6.0]])
    E = np.array([[0.1], [0.2], [1.0]])
    bound = absolute_integrals(exact(F), exact(E))
    assert bound is not None
    poles, vectors = np.linalg.eig(F)
    weights = vectors * np.linalg.solve(vectors, E)[:, 0]
    length = 2e-3
    times = np.array_split((np.arange(4_000_000) + 0.5) * length, 400)
    courses = ((weights @ np.exp(np.multiply.outer(poles, each))).real for each in times)
    integral = sum(np.abs(course).sum(axis=1) * length for course in courses)
    assert bound[:, 0] == pytest.approx(integral, rel=0.005)


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


def exchange(seed: int, leak: Fraction) -> np.ndarray:
    """Compartments that exchange what they hold, one of which loses it: symmetric, exact."""
    rng = np.random.default_rng(seed)
    rates = np.triu(rng.integers(1, 9, (3, 3)), 1)
    flow = exact((rates + rates.T).astype(float))
    flow -= np.diag(flow.sum(axis=1))
    flow[0, 0] -= rational(leak)
    return flow


@pytest.mark.parametrize("power", [10, 40, 52, 58, 60, 63, 70])
def test_a_decay_below_the_rounding_of_its_estimate(power: int) -> None:
    """Integrals are -F^-1 E, exactly; an estimate of the slowest rate may have any sign."""
    for seed in range(4):
        F = exchange(seed, Fraction(1, 2**power))
        E = exact(np.eye(3)[:, :1])
        back = inverse(F)
        assert back is not None
        bound = absolute_integrals(F, E)
        assert bound is not None
        truth = to_float(-back @ E)
        assert (bound >= truth).all()
        assert (bound <= 1.01 * truth).all()


@pytest.mark.parametrize("rate", [0.0, -1e-3, math.nan, math.inf])
def test_squares_need_a_rate_of_decay(rate: float) -> None:
    F, C = exact(-np.eye(2)), exact(np.eye(2))
    assert decaying_integrals(F, C, rate) is None
    assert decaying_integrals(F, C, 0.5) is not None
