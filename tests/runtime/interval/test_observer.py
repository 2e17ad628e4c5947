"""Interval observer at run time: enclosure under every disturbance, rounding, odd streams."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property

import numpy as np
import pytest
from flint import arb, arb_mat, ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.exponential import expm
from obsdesign.data.simulation import simulate
from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Jump, Plant
from obsdesign.runtime import Sample
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.maps import step_maps
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.runtime.interval.step_kernels import KernelsOfStep, StepKernels
from tests.systems.interval_runs import (
    SIMULATION_ROUNDING,
    observer_for,
    random_observer,
    random_plant,
    random_run,
)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_state_never_leaves_its_bounds(seed: int) -> None:
    assert random_run(seed).violation() <= SIMULATION_ROUNDING


def test_fixed_seeds_never_leave_their_bounds() -> None:
    assert max(random_run(seed).violation() for seed in range(40)) <= SIMULATION_ROUNDING


def test_the_twin_a_slope_taken_for_zero_is_caught() -> None:
    # without the slope terms the scheme is a zero-order hold of the output: it must be seen
    plant = Plant(
        Flow(np.array([[0.0, 1.0], [-4.0, -0.1]])),
        None,
        Output(np.array([[1.0, 0.0]]), noise_bound=0.0),
    )
    observer = observer_for(plant, np.array([[1.0], [2.0]]), np.zeros((2, 1)))
    state = observer.init(0.0, lower=[1, 0], upper=[1, 0])
    state, _ = observer.step(state, Sample(0.0, y=[1.0]))
    held = state._replace(y=np.array([0.0]))  # a y that x(0) did not give
    _, estimate = observer.step(held, Sample(0.1, y=[1.0]))
    x = np.array([math.cos(0.2), -2 * math.sin(0.2)])
    assert not (np.all(estimate.lower <= x) and np.all(x <= estimate.upper))


# --- rounding ---------------------------------------------------------------------------------


def exact_states(
    A: np.ndarray, G: np.ndarray, x: list[float], h: float, jumps: set[int], rows: int
):
    """x after each row in 400-bit arithmetic, for a plant without disturbance."""
    old, ctx.prec = ctx.prec, 400
    try:
        flow = arb_mat([[arb(float(a)) * arb(h) for a in row] for row in A]).exp()
        jump = arb_mat([[arb(float(g)) for g in row] for row in G])
        state, path = arb_mat([[arb(float(v))] for v in x]), []
        for k in range(rows):
            if k:
                state = flow * state
            before = state
            if k in jumps:
                state = jump * state
            path.append((before, state))
        return path
    finally:
        ctx.prec = old


def rounding_case(observer_of) -> bool:
    """Is the exact state inside bounds of almost no width, all the way?"""
    rng = np.random.default_rng(5)
    n, h, rows, jumps = 3, 0.125, 200, {40, 80, 120, 160}  # h is a binary number: times are exact
    A = rng.standard_normal((n, n)) - 3.5 * np.eye(n)
    G, C = 3 * np.eye(n) + 0.3 * rng.standard_normal((n, n)), np.eye(1, n)
    plant = Plant(Flow(A), Jump(G, dwell_time=(1.0, 10.0)), Output(C, noise_bound=0.0))
    observer = observer_of(observer_for(plant, np.zeros((n, 1)), np.zeros((n, 1))))
    x = [1.0, -2.0, 0.5]
    state = observer.init(0.0, lower=x, upper=x)
    inside = True
    for k, (_, exact) in enumerate(exact_states(A, G, x, h, jumps, rows)):
        state, estimate = observer.step(state, Sample(k * h, jump=k in jumps))
        for i in range(n):
            low, high = arb(float(estimate.lower[i])), arb(float(estimate.upper[i]))
            inside = inside and bool(low <= exact[i, 0]) and bool(exact[i, 0] <= high)
        assert np.all(estimate.upper - estimate.lower < 1e-9)
    return inside


class KernelsWithoutMargin(StepKernels):
    """The same matrices, but nothing added for rounding."""

    def _of_length(self, h: float, h_error: float, size: float) -> KernelsOfStep:
        whole = super()._of_length(h, h_error, size)
        return KernelsOfStep(whole.box_map, lambda name: without_margin(whole[name]))


def without_margin(kernel: Kernel) -> Kernel:
    rows = kernel.rows.copy()
    rows[:, kernel.middle :] = 0.0
    return dataclasses.replace(kernel, rows=rows)


class KernelsOfTheirOwnWithoutMargin(KernelsWithoutMargin):
    """Likewise, with a kernel for each length instead of those of its cell."""

    cells = None


class WithoutMargin(IntervalObserver):
    @cached_property
    def kernels(self) -> StepKernels:
        return KernelsWithoutMargin(self.gains)


class OfTheirOwnWithoutMargin(IntervalObserver):
    @cached_property
    def kernels(self) -> StepKernels:
        return KernelsOfTheirOwnWithoutMargin(self.gains)


def test_bounds_of_no_width_contain_the_exact_state() -> None:
    assert rounding_case(lambda observer: observer)


@pytest.mark.parametrize("twin", [WithoutMargin, OfTheirOwnWithoutMargin])
def test_the_twin_without_margin_loses_it(twin: type[IntervalObserver]) -> None:
    assert not rounding_case(lambda observer: twin(observer.gains))


# --- laws -------------------------------------------------------------------------------------


def test_stream_batch_and_loop_agree() -> None:
    rng = np.random.default_rng(3)
    plant = random_plant(rng, n=3)
    observer = random_observer(plant, rng)
    t = np.round(np.arange(60) * 0.05, 2)
    layout = observer.reads
    y, u = rng.standard_normal((60, layout["y"])), rng.standard_normal((60, layout["u"]))
    w, jump = rng.standard_normal((60, layout["w"])), np.arange(60) % 7 == 6
    y[10:13] = np.nan
    box = {"lower": [-1, -1, -1], "upper": [1, 2, 3]}
    batch = observer.run_batch(t, y, u, w, jump, **box)
    samples = [Sample(*row) for row in zip(t.tolist(), y, u, w, jump.tolist(), strict=True)]
    stream = list(observer.run(observer.init(0.0, **box), iter(samples)))
    state, loop = observer.init(0.0, **box), []
    for sample in samples:
        state, estimate = observer.step(state, sample)
        loop.append(estimate)
    for k in range(60):
        for name in ("lower", "upper"):
            expected = getattr(batch, name)[k]
            assert np.array_equal(getattr(stream[k], name), expected)
            assert np.array_equal(getattr(loop[k], name), expected)
        assert stream[k].status == loop[k].status == batch.status[k]


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_larger_box_gives_larger_bounds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    plant = random_plant(rng)
    observer = random_observer(plant, rng)
    n = observer.n
    centre, slim = rng.standard_normal(n), rng.uniform(0, 1, n)
    wide = slim + rng.uniform(0, 1, n)
    record = simulate(plant, until=1.5, step=0.1, initial=centre, disturbance="random", rng=rng)
    w, jump = np.nan_to_num(record.block("w")), record.columns["jump"]
    data = (record.t, record.block("y"), record.block("u"), w, jump)
    small = observer.run_batch(*data, lower=centre - slim, upper=centre + slim)
    large = observer.run_batch(*data, lower=centre - wide, upper=centre + wide)
    room = 1e-9 * (1 + np.abs(large.upper) + np.abs(large.lower))
    assert np.all(large.lower <= small.lower + room)
    assert np.all(small.upper <= large.upper + room)


def test_steps_without_samples_are_between_one_and_their_limit() -> None:
    # |e^(A h)| <= |e^(A h/8)|^8 <= e^(Mz(A) h), and likewise for what the disturbance adds
    rng = np.random.default_rng(8)
    plant = random_plant(rng, n=4)
    observer = random_observer(plant, rng)
    start = observer.init(0.0, lower=-np.ones(4), upper=np.ones(4))
    start, _ = observer.step(start, Sample(0.0))
    state = start
    for k in range(1, 9):
        state, many = observer.step(state, Sample(k / 8))
    _, single = observer.step(start, Sample(1.0))
    A, n = plant.flow.A, 4
    Z = np.zeros((n + 1, n + 1))
    Z[:n, :n] = np.where(np.eye(n, dtype=bool), A, np.abs(A))
    Z[:n, n] = (plant.flow.upper - plant.flow.lower) / 2
    limit = expm(Z)[:n] @ np.append(np.ones(n), 1.0)
    radius = [(row.upper - row.lower) / 2 for row in (single, many)]
    assert np.all(radius[0] < radius[1])
    assert np.all(radius[1] <= limit * (1 + 1e-9))
    assert np.all(many.lower <= single.lower)
    assert np.all(single.upper <= many.upper)


def test_short_steps_tend_to_the_observer_of_the_paper() -> None:
    # q' = W q + |L| V + b_rad with y continuous: the slope terms vanish like h
    A, C, L = np.array([[-1.0, 0], [1, -2]]), np.array([[0.0, 1]]), np.array([[0.0], [1.0]])
    plant = Plant(Flow(A, lower=[-0.1] * 2, upper=[0.1] * 2), None, Output(C, noise_bound=[0.03]))
    observer = observer_for(plant, L, np.zeros((2, 1)))
    limit = np.linalg.solve(-(A - L @ C), np.array([0.1, 0.13]))
    excess = []
    for h in (0.1, 0.05, 0.025):
        step = step_maps(observer.kernels.model, h, 0.0, is_periodic=False)["start"]
        excess.append(np.linalg.solve(np.eye(2) - step.R, step.g) - limit)
        t = np.round(np.arange(round(40 / h)) * h, 6)
        batch = observer.run_batch(t, np.zeros((len(t), 1)), lower=[-1, -1], upper=[1, 1])
        width = batch.upper[-1] - batch.lower[-1]
        assert np.all(width <= 2 * (limit + excess[-1]) + 1e-12)  # cut, and never wider
        assert width[1] <= 2 * 0.03 + 1e-12  # x2 is what is measured
    ratios = excess[0][1] / excess[1][1], excess[1][1] / excess[2][1]
    assert all(1.8 < ratio < 2.2 for ratio in ratios), ratios


# --- odd streams ------------------------------------------------------------------------------


def academic(**jump) -> IntervalObserver:
    plant = Plant(
        Flow(np.array([[-1.0, 0], [1, -2]]), lower=[-0.1] * 2, upper=[0.1] * 2),
        Jump(np.array([[2.0, 1], [1, 3]]), **({"dwell_time": (0.7, 2.0)} | jump)),
        Output(np.array([[0.0, 1]]), noise_bound=[0.03]),
    )
    return observer_for(plant, np.array([[0.0], [1.0]]), np.array([[1.0], [2.8]]))


def statuses(observer: IntervalObserver, samples: list[Sample], upper: float = 10.0) -> list[str]:
    state = observer.init(0.0, lower=[-upper] * 2, upper=[upper] * 2)
    return [estimate.status for estimate in observer.run(state, samples)]


def test_statuses_say_why_the_guarantee_does_not_hold() -> None:
    rows = [
        Sample(0.0, y=[0.0]),
        Sample(0.3, y=[0.0], jump=True),  # the time to the first jump is not a dwell time
        Sample(0.8, y=[0.0], jump=True),
        Sample(1.5, y=None),
        Sample(1.6, y=[0.0], jump=True),
        Sample(3.6, y=[0.0], jump=True),  # exactly the longest
        Sample(5.7, y=[0.0]),
        Sample(5.8, y=None, jump=True),
    ]
    assert statuses(academic(), rows) == [
        "ok",
        "ok",
        "dwell time 0.5 below 0.7",
        "missing sample",
        "ok",
        "ok",
        "dwell time 2.1 above 2",
        "dwell time 2.2 above 2; missing sample",
    ]


def test_decimal_dwell_times_are_compared_with_tolerance() -> None:
    times = [round(0.1 + 0.7 * k, 1) for k in range(40)]
    rows = [Sample(t, y=[0.0], jump=True) for t in times]
    assert set(statuses(academic(dwell_time=(0.7, 0.7)), rows)) == {"ok"}
    rows = [Sample(0.1 + (0.7 - 1e-6) * k, y=[0.0], jump=True) for k in range(3)]
    assert statuses(academic(), rows)[1:] == ["dwell time 0.699999 below 0.7"] * 2


def test_a_measurement_that_no_state_can_give_is_named() -> None:
    rows = [Sample(0.0, y=[1.03]), Sample(0.1, y=[50.0])]
    assert statuses(academic(), rows, upper=1.0) == ["ok", "y1 outside its bounds"]


def test_a_jump_without_measurement_uses_the_plant_alone() -> None:
    observer = academic()
    state = observer.init(0.0, lower=[1, 1], upper=[1, 1])
    _, estimate = observer.step(state, Sample(0.0, y=None, jump=True))
    np.testing.assert_allclose(estimate.lower, [3, 4], rtol=1e-12)
    np.testing.assert_allclose(estimate.upper, [3, 4], rtol=1e-12)


@pytest.mark.parametrize(
    ("sample", "message"),
    [
        (Sample(-0.1, y=[0.0]), "time must increase; got -0.1 after 0.0."),
        (Sample(0.0, y=[0.0, 1.0]), "y must have 1 entries; got 2."),
    ],
)
def test_bad_samples_are_refused(sample: Sample, message: str) -> None:
    observer = academic()
    with pytest.raises(ValueError, match=r"entries|increase") as error:
        observer.step(observer.init(0.0, lower=[0, 0], upper=[1, 1]), sample)
    assert str(error.value) == message


def test_an_empty_initial_interval_is_refused() -> None:
    with pytest.raises(ValueError, match="initial") as error:
        academic().init(0.0, lower=[0, 2], upper=[1, 1])
    assert str(error.value) == "initial bounds of x2: lower 2 exceeds upper 1."


def test_overflow_leaves_sound_bounds_and_says_so() -> None:
    plant = Plant(Flow(np.array([[50.0]])), None, Output(np.array([[1.0]]), noise_bound=0.0))
    observer = observer_for(plant, np.zeros((1, 1)), np.zeros((1, 1)))
    state = observer.init(0.0, lower=[1.0], upper=[2.0])
    state, _ = observer.step(state, Sample(0.0))
    state, estimate = observer.step(state, Sample(100.0))
    assert (estimate.lower[0], estimate.upper[0]) == (-math.inf, math.inf)
    assert estimate.status == "bounds overflowed"
    _, estimate = observer.step(state, Sample(100.1))
    assert (estimate.lower[0], estimate.upper[0]) == (-math.inf, math.inf)
