"""Noise in windows and filters: covariances written out, sums one by one."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from obsdesign.equations.impulsive_input import deviations
from obsdesign.equations.impulsive_input.features import window_taps
from obsdesign.runtime.impulsive_input import whitening
from obsdesign.runtime.impulsive_input.event import Event
from obsdesign.runtime.impulsive_input.history import History, short_dwell
from obsdesign.runtime.impulsive_input.initial import impulse_sizes, initial_sizes
from obsdesign.runtime.impulsive_input.integral import covariance, noise_level, recursions
from obsdesign.runtime.impulsive_input.integral.engine import IntegralEngine
from obsdesign.runtime.impulsive_input.integral.search import NoisyRows, Rule, Search, smoothed
from obsdesign.runtime.impulsive_input.samples.engine import _event
from obsdesign.runtime.impulsive_input.samples.filter import triangular
from obsdesign.runtime.impulsive_input.samples.open_rows import OpenRows
from obsdesign.runtime.impulsive_input.samples.steady_input import Steady

TAPS = window_taps(np.array([-2.0, -0.5, 1.0]), np.linspace(0, 1.5, 16))


def spread(p: int = 2) -> np.ndarray:
    return np.random.default_rng(0).uniform(0.5, 2.0, (16, p))


def covariance_of(taps: np.ndarray, s: np.ndarray) -> np.ndarray:
    blocks = [taps.T @ np.diag(column**2) @ taps for column in s.T]
    return np.kron(np.diag([1.0, 0.0]), blocks[0]) + np.kron(np.diag([0.0, 1.0]), blocks[1])


@pytest.mark.parametrize("freedom", [1, 2, 10, 300])
def test_the_chi_squared_limit_is_its_quantile(freedom: int) -> None:
    assert whitening.chi_squared_limit(freedom) == pytest.approx(chi2.ppf(0.999, freedom), rel=0.04)
    assert whitening.chi_squared_limit(0) == math.inf


def test_whitened_features_have_unit_covariance() -> None:
    s, error = spread(), np.random.default_rng(1).standard_normal((16, 2))
    white = whitening.whitening(TAPS, s)
    R, T = white.features(error), white.T
    N = covariance_of(TAPS, s)
    plain = np.tensordot(error, whitening.raw_taps(TAPS, 2), 2)
    np.testing.assert_allclose(R, T @ plain, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(T @ N @ T.T, np.eye(6), atol=1e-9)
    # the taps are those of features of unit noise to the last digits, however small T divides by
    for taps in (TAPS, np.hstack([TAPS, TAPS[:, :1] + 1e-9 * TAPS[:, 1:2]])):
        sources = (whitening.whitening(taps, s).taps * s[:, :, None]).reshape(s.size, -1)
        np.testing.assert_allclose(sources.T @ sources, np.eye(len(sources.T)), atol=1e-14)
    # features that are the same twice count once
    double = np.hstack([TAPS, TAPS[:, :1]])
    assert len(whitening.whitening(double, s).T) == 6


def test_deviations_of_the_noise() -> None:
    gains: Any = SimpleNamespace(
        noise_std=np.array([0.3, 0.0]), noise_cv=np.array([0.4, 0.1]), noisy=True
    )
    y, level = np.array([[1.0, 0.0], [-2.0, -2.0]]), np.array([5.0, 4.0])
    values = whitening.noise_deviation(gains, y, level, y[0])
    np.testing.assert_allclose(values, [[0.5, 0.1 * 4e-3], [math.hypot(0.3, 0.8), 0.2]], rtol=1e-12)
    nothing = whitening.noise_deviation(gains, np.zeros((1, 2)), np.zeros(2), np.zeros(2))
    assert nothing.tolist() == [[0.3, 0.0]]  # a unit of y is no deviation
    # rounding counts, and an output that shows nothing is no more exact than the others
    fine: Any = SimpleNamespace(noise_std=np.array([1e-12]), noise_cv=np.zeros(1), noisy=True)
    assert whitening.noise_deviation(fine, *3 * [np.ones(1)]) == pytest.approx(1e-7)
    exact: Any = SimpleNamespace(noise_std=np.zeros(1), noise_cv=np.zeros(1), noisy=False)
    assert whitening.noise_deviation(exact, *3 * [np.ones(1)]) == 0
    assert whitening.usual_size(np.array([[1.0], [-2.0], [1e30], [1.0], [2.0]])) == 2
    assert whitening.noise_level(np.array([0.0, 4.0])).tolist() == [4e-3, 4.0]


def test_roots_of_covariances() -> None:
    rng = np.random.default_rng(3)
    V, X = rng.standard_normal((4, 3)), rng.standard_normal((3, 3))
    P = X @ X.T
    units = np.array([1e-9, 1.0, 1e9])
    F = deviations.square_root(P * units * units[:, None])
    np.testing.assert_allclose(F @ F.T / units / units[:, None], P, rtol=1e-9, atol=1e-9)
    assert (deviations.square_root(np.zeros((2, 2))) == 0).all()
    L = triangular(V)
    np.testing.assert_allclose(L @ L.T, V @ V.T, atol=1e-12)
    wide = triangular(V.T)
    np.testing.assert_allclose(wide @ wide.T, V.T @ V, atol=1e-12)
    assert (np.triu(wide, 1) == 0).all()
    assert (np.diag(wide) >= 0).all()


@pytest.mark.parametrize("count", [0, 1, 2, 7, 16])
def test_a_covariance_grows_from_sample_to_sample(count: int) -> None:
    """e+ = E e - older v - newer v+ one by one; P is without the noise of the row's own sample."""
    rng = np.random.default_rng(4)
    E, newer, older = (rng.standard_normal(shape) / 2 for shape in ((2, 2), (2, 1), (2, 1)))
    maps, lengths = SimpleNamespace(error=E, newer=newer, older=older), list[float]()
    run: Any = SimpleNamespace(step_maps=lambda h: lengths.append(h) or maps)
    times, s, P = 0.1 * np.arange(30, 37), np.full((7, 1), 0.5), np.array([[2.0, 0.3], [0.3, 1.0]])
    # coefficients of P's root and of every sample in the error, the last sample's own excluded
    sources = np.hstack([np.linalg.cholesky(P), np.zeros((2, count))])
    for k in range(count):
        sources[:, 2 + k] -= 0.5 * newer[:, 0]
        sources = E @ sources
        sources[:, 2 + k] -= 0.5 * older[:, 0]
    values = covariance.propagated(run, P, 0.1 * count, times, s)
    np.testing.assert_allclose(values, sources @ sources.T, rtol=1e-12)
    assert lengths == pytest.approx([0.1] * min(count, 1))


@pytest.mark.parametrize("rows", [1, 2, 5, 16, 17])
def test_recursions_by_doubling_are_those_one_by_one(rows: int) -> None:
    rng = np.random.default_rng(rows)
    flow, forced, start = (
        0.8 * rng.standard_normal((2, 2)),
        rng.standard_normal((rows, 2)),
        rng.standard_normal(2),
    )
    expected, x = [], start
    for j in range(rows):
        x = flow @ x + forced[j]
        expected.append(x)
    np.testing.assert_allclose(
        recursions.accumulated(flow, forced, start), expected, rtol=1e-9, atol=1e-9
    )
    stacked = rng.standard_normal((rows, 3, 2))
    sums, last = [], np.zeros((3, 2))
    for j in range(rows):
        last = stacked[j] + last @ flow.T
        sums.append(last)
    np.testing.assert_allclose(recursions.doubled(flow, stacked.copy()), sums, rtol=1e-9, atol=1e-9)


def test_running_integrals_of_lines() -> None:
    rng, lams = np.random.default_rng(0), np.array([-2.0, -0.3])
    t = np.array([1.0, 1.2, 1.4, 1.6, 1.9, 2.2])
    runs = [(0, 3, 0.2), (3, 5, 0.3)]
    error, start = rng.standard_normal((6, 1)), rng.standard_normal((1, 2))

    def integral(end: float) -> np.ndarray:
        total = start[0] * np.exp(lams * (end - 1.0))
        grid = np.linspace(1.0, end, 20_001)
        middle, h = (grid[1:] + grid[:-1]) / 2, grid[1] - grid[0]
        values = np.interp(middle, t, error[:, 0])
        return np.asarray(
            total + (np.exp(lams * (end - middle)[:, None]) * values[:, None]).sum(axis=0) * h
        )

    later = recursions.running_integrals(runs, error, lams, start)
    for j, end in enumerate(t[1:]):
        np.testing.assert_allclose(later[j, 0], integral(end), rtol=1e-6, atol=1e-8)
    whole = np.concatenate([start[None], later])
    times = np.array([1.0, 1.1, 1.2, 1.75, 2.2])
    between = recursions.integrals_at(t, error, whole, lams, times)
    for value, end in zip(between, times, strict=True):
        np.testing.assert_allclose(value[0], integral(end), rtol=1e-6, atol=1e-8)
    # within a millionth of a cell a time is that of the row
    near = recursions.integrals_at(t, error, whole, lams, np.array([1.2 + 1e-7, 1.4 - 1e-7]))
    assert (near == whole[[1, 2]]).all()
    beside = recursions.integrals_at(t, error, whole, lams, np.array([1.2 + 6e-7, 1.4 - 6e-7]))
    assert (beside != whole[[1, 2]]).all()


def test_the_best_steady_input() -> None:
    at: Any = SimpleNamespace(x=np.zeros(2))
    plain = Steady.begin(at)
    assert plain.cost(False) == 0.0
    assert Steady(at, np.zeros(2), squares=9.0, products=4.0, slopes=2.0).cost(True) == 1.0
    assert Steady(at, np.zeros(2), squares=9.0, products=-4.0, slopes=2.0).cost(False) == 1.0
    assert Steady(at, np.zeros(2), squares=9.0, products=-4.0, slopes=2.0).cost(True) == 9.0
    assert Steady(at, np.zeros(2), squares=9.0, products=4.0, slopes=0.0).cost(False) == 9.0


def test_dwell_times_that_are_certainly_too_short() -> None:
    assert short_dwell(1.0, 2.0, 1.0) == ""
    assert short_dwell(1.0, 1.99, 1.0) == "dwell time 0.99 below 1"
    # three deviations of both, together
    assert short_dwell(1.0, 1.5, 1.0, 0.1, 0.14) == ""
    assert short_dwell(1.0, 1.5, 1.0, 0.1, 0.13) == "dwell time 0.5 below 1"
    assert short_dwell(-math.inf, 1.5, 1.0) == ""


def test_an_event_is_judged_by_its_residuals_and_its_dwell_time() -> None:
    event = Event(t=2.0, weights=np.ones(1), t_std=0.1, weights_std=np.array([0.2]))
    fine = History(t=0.0).judged(event, 1.0, cost=5.0, freedom=5)
    assert fine.doubts == ()
    assert fine.t_std == 0.1
    wide = History(t=0.0).judged(event, 1.0, cost=500.0, freedom=5)
    assert wide.t_std > 0.5
    np.testing.assert_allclose(wide.weights_std, 2 * wide.t_std)
    assert wide.doubts == ()  # of its own window alone
    late = History(t=1.5, t_std=0.0).judged(event, 1.0, cost=5.0, freedom=5)
    assert late.doubts == ("dwell time 0.5 below 1",)
    unknown = Event(t=2.0, weights=np.ones(1), t_std=None, weights_std=None)
    assert History(t=1.5).judged(unknown, 1.0, cost=5.0, freedom=5).doubts == late.doubts
    assert History(t=1.0 + 1e-9).judged(unknown, 1.0, cost=5.0, freedom=5).doubts == ()


# an impulse leaves (sin, 3 cos) of half a turn in the window, and y = x1
AGES = np.linspace(0, math.pi, 65)
STATES = np.column_stack([np.sin(AGES), 3 * np.cos(AGES)])[:, :, None]
FIRST = np.array([[1.0, 0.0]])


@pytest.mark.parametrize(
    ("x", "y", "size"),
    [
        ([0, 0], [6], 6),
        ([4, 0], [6], 2),
        ([-4, 0], [6], 10),
        ([0, 0], [0, 6], 6),
        ([0, 0], [6, 8], 8),
    ],
)
def test_a_first_guess_is_as_wide_as_states_that_explain_the_range_of_y(
    x: list[float], y: list[float], size: float
) -> None:
    """x1'' = -x1, y = x1, of half a turn in the window."""
    A = np.array([[0.0, 1.0], [-1.0, 0.0]])
    plant: Any = SimpleNamespace(A=A, C=FIRST, H=np.array([[0.0], [1.0]]))
    rows: Any = OpenRows(
        SimpleNamespace(C=FIRST, window=math.pi),  # type: ignore[arg-type]
        SimpleNamespace(plant=plant, states=lambda ages: np.zeros((len(ages), 2))),  # type: ignore[arg-type]
    )
    samples = [SimpleNamespace(y=np.array([each]), spread=np.array([0.01])) for each in y]
    guess = rows._guess(np.array(x), [*samples, SimpleNamespace(y=None, spread=np.array([0.01]))])
    np.testing.assert_allclose(guess, size + 0.01, rtol=1e-9)
    guess = rows._guess(np.array(x), [SimpleNamespace(y=None, spread=np.array([0.01]))])
    np.testing.assert_allclose(guess, 0.5, rtol=1e-9)


def test_states_that_no_impulse_reaches_may_be_as_large_as_y_shows_them() -> None:
    """A bias of the sensor, a constant feed; zero of what no output shows."""
    A = np.zeros((4, 4))
    A[0, 2] = 0.5  # a feed of x1
    C = np.array([[1.0, 1.0, 0.0, 0.0]])
    plant: Any = SimpleNamespace(A=A, C=C, H=np.eye(4)[:, :1])
    sizes = initial_sizes(plant, 2.0, np.array([3.0]))
    np.testing.assert_allclose(sizes, [3.0, 3.0, 3.0, 0.0], rtol=1e-12)
    assert (initial_sizes(plant, 2.0, np.zeros(1)) == 0).all()


def test_sizes_of_impulses_have_the_units_of_states_and_outputs() -> None:
    sizes = impulse_sizes(FIRST, STATES, np.array([6.0]))
    for unit in (2.0**-40, 2.0**40):
        units = np.array([1.0, unit])
        C = np.array([[1.0, 1e-16 / unit]])
        scaled = impulse_sizes(C, STATES * units[:, None], np.array([6.0]))
        np.testing.assert_array_equal(scaled, sizes * units)
    # of an output that shows an impulse by rounding alone no weight follows
    alike = np.stack([STATES[:, 0], STATES[:, 0] * (1 + 1e-12)], axis=1)
    both = impulse_sizes(np.array([[1.0, 0.0], [1.0, -1.0]]), alike, np.array([6.0, 6.0]))
    assert both == pytest.approx([6.0, 6.0])
    assert (impulse_sizes(FIRST, STATES, np.zeros(1)) == 0).all()


TWENTY = np.arange(20.0)


def rows_with(sigma: float, times: np.ndarray = TWENTY) -> NoisyRows:
    return NoisyRows(times, np.full(len(times), sigma), np.zeros(len(times)))


def test_a_threshold_fires_at_the_first_value_above_it() -> None:
    rule, times = Rule(floor=0.0, share=0.0, threshold=2.0), rows_with(0.0)
    search, fired = rule.advance(Search(), [1.0, 2.0, 2.5, 9.0], 0, times, 5.0)
    assert fired
    assert (search.position, search.top, search.highest, search.armed) == (3, 2, 2.5, True)
    # rows that were looked at are not looked at again
    search, fired = rule.advance(Search(position=3), [9.0, 1.0, 3.0], 2, times, 5.0)
    assert fired
    assert search.top == 4
    search, fired = rule.advance(Search(), [1.0, 2.0], 0, times, 5.0)
    assert not fired
    assert search.position == 2


def test_a_peak_fires_when_it_was_left_behind() -> None:
    rule, noise = Rule(floor=1.0, share=0.1), rows_with(0.1)
    values = [0.0, 0.5, 2.0, 4.0, 3.9, 3.6, 3.4, 0.0]
    search, fired = rule.advance(Search(), values, 0, noise, 9.0)
    assert fired
    assert (search.top, search.highest, search.position) == (3, 4.0, 7)  # 3.4 < 4 - .4 - .1
    # what never falls is final when it has left the window
    search, fired = rule.advance(Search(), [0.0, 2.0, 2.0, 2.0, 2.0, 2.0], 0, noise, 3.0)
    assert fired
    assert (search.top, search.position) == (1, 6)
    # below the floor nothing fires
    _, fired = rule.advance(Search(), [0.0, 0.9, 0.0, 0.9, 0.0], 0, noise, 9.0)
    assert not fired
    # nor below six deviations of the noise at the maximum
    for sigma, fires in ((0.6, True), (0.7, False)):
        sigmas = np.where(np.arange(20) == 3, sigma, 0.1)
        _, fired = rule.advance(
            Search(), values, 0, NoisyRows(noise.times, sigmas, np.zeros(20)), 9.0
        )
        assert fired == fires


def test_one_kernel_is_whitened_too() -> None:
    s, error = spread(), np.random.default_rng(1).standard_normal((16, 2))
    white = whitening.whitening(TAPS[:, :1], s)
    R, T = white.features(error), white.T
    N = covariance_of(TAPS[:, :1], s)
    np.testing.assert_allclose(T @ N @ T.T, np.eye(2), atol=1e-9)
    assert R.shape == (2,)


@pytest.mark.parametrize("step", [0.5, 2.0])
def test_an_onset_in_one_cell_of_a_grid_may_be_anywhere_in_it(step: float) -> None:
    """The deviation of a uniform distribution over one step."""
    fit: Any = SimpleNamespace(
        probability=np.array([0.0, 1.0, 0.0]), grid=SimpleNamespace(onsets=step * np.arange(3.0)),
        weights=np.array([0.0, 7.0, 0.0]), precision=np.array([1.0, 4.0, 1.0]), cost=0.0,
    )  # fmt: skip
    event = _event(fit, 5)
    assert (event.t, event.weights.tolist()) == (step, [7.0])
    assert event.t_std == pytest.approx(step / 12**0.5)
    assert event.weights_std.tolist() == pytest.approx([0.5])


def test_a_row_that_all_but_ends_a_window_is_its_last_one() -> None:
    """Decimal stamps: .1 + .2 is a little more than .3."""
    gains = SimpleNamespace(noise_std=np.zeros(1), noise_cv=np.zeros(1), noisy=False)
    run = SimpleNamespace(tau=0.2, gains=gains, residual=lambda track, a, b: track.y[a:b])
    own: Any = SimpleNamespace(run=run, evaluator=SimpleNamespace(taps=lambda times: times))
    for t, last in (
        ([0.0, 0.1, 0.2, 0.3, 0.4], 3), ([0.0, 0.1, 0.2, 0.3 - 1e-4, 0.4], 4),
        ([0.0, 0.1, 0.2, 0.3 + 1e-4, 0.4], 3),
    ):  # fmt: skip
        track: Any = SimpleNamespace(t=np.array(t), y=np.ones((5, 1)))
        window = IntegralEngine._window(own, track, 1)
        assert window.t.tolist() == t[1 : last + 1]


@pytest.mark.parametrize("begin", [0.0, 100.0, -100.0])
def test_a_maximum_is_final_after_a_drop_or_a_whole_window(begin: float) -> None:
    rule, tau, times = Rule(floor=0.1, share=0.5), 2.05, begin + 0.1 * np.arange(40)
    rows = rows_with(0.0, times)
    flat = [0.0, 1.0, *([0.9] * 38)]
    search, fired = rule.advance(Search(), flat, 0, rows, tau)
    assert fired
    assert (search.top, search.position) == (1, 23)  # the first row more than tau behind the top
    early, fired = rule.advance(Search(), flat[:22], 0, rows, tau)
    assert (early.top, fired) == (1, False)
    dropped, fired = rule.advance(Search(), [0.0, 1.0, 0.9, 0.4], 0, rows, tau)
    assert (dropped.top, dropped.position, fired) == (1, 4, True)


@pytest.mark.parametrize("first", range(10))
def test_a_moving_average_is_given_as_soon_as_its_rows_are_there(first: int) -> None:
    times, values = 0.5 * np.arange(20.0), np.random.default_rng(6).standard_normal(10)
    means = smoothed(times, values, first, 1.0)
    expected = [values[max(k - 2, 0) : k + 3].mean() for k in range(first, 8)]
    np.testing.assert_allclose(means, expected, rtol=1e-12)
    assert (smoothed(times, values, first, 0.0) == values[first:]).all()


def test_sums_of_windows_forget_an_outlier() -> None:
    values = np.random.default_rng(7).uniform(0.5, 1.5, (40, 2))
    values[3] = 1e60
    counts = np.array([5, 1, 16, 7, 9, 13, 30, 0])
    sums = noise_level.sums_from(values, counts)
    for k, count in enumerate(counts):
        np.testing.assert_allclose(sums[k], values[k : k + count].sum(axis=0), rtol=1e-14)
    later = noise_level.sums_from(values[4:], counts[4:])
    assert (later == sums[4:]).all()  # bit for bit, however a record is cut
