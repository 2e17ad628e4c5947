"""Steps of any length from series: states in fifty digits, widths of kernels of their own."""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Iterator
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from flint import arb, arb_mat, ctx, fmpq

from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Plant
from obsdesign.runtime import Sample
from obsdesign.runtime.clocks.time_stamps import length_error
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.runtime.interval.step_kernels import StepKernels
from obsdesign.runtime.step_cache import shared_length, shared_lengths
from tests.runtime.interval.test_observer import KernelsWithoutMargin
from tests.runtime.interval.test_samples import sampled_observer
from tests.systems.interval_runs import observer_for

# first stamp, and time constants of the plants: seconds, seconds since 1970, nanoseconds since then
CLOCKS = [(0.0, 1.0), (1.7e9, 1.0), (1.7e18, 1e9)]
ROWS = 12


def plant(rng: np.random.Generator, unit: float = 1.0, **output: Any) -> Plant:
    """1 to 8 states with time constants around `unit`, oscillating, some entries zero."""
    n = int(rng.integers(1, 9))
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.7) - rng.uniform(0, 2) * np.eye(n)
    p = int(rng.integers(1, 3))
    return Plant(
        Flow(A / unit, B=rng.normal(size=(n, 1)) / unit,
             lower=-rng.uniform(0, 1, n) / unit, upper=rng.uniform(0, 1, n) / unit),
        None, Output(rng.normal(size=(p, n)), noise_bound=rng.uniform(0.1, 1.0, p), **output),
    )  # fmt: skip


def in_coordinates(observer: IntervalObserver, rng: np.random.Generator) -> IntervalObserver:
    S = np.eye(observer.n) + 0.2 * rng.normal(size=(observer.n, observer.n))
    data = observer.gains.to_document() | {"form": "coordinates", "S": S}
    return IntervalObserver.from_gains(data)


def observer_of(rng: np.random.Generator, unit: float, mode: str) -> tuple[Plant, IntervalObserver]:
    """A plant and an observer with gains without any sense."""
    output = {"measured": mode} | ({"period": 0.1 * unit} if mode == "periodic" else {})
    own = plant(rng, unit, **output)
    L = 0.3 * rng.normal(size=(own.n, own.p))
    made = (sampled_observer if mode == "periodic" else observer_for)(
        own, L if mode == "periodic" else L / unit, 0 * L
    )
    return own, in_coordinates(made, rng) if rng.random() < 0.3 else made


def stamps(rng: np.random.Generator, start: float, unit: float) -> Iterator[float]:
    """Steps from an ulp to many time constants."""
    t = start
    for _ in range(ROWS):
        ulps = float(rng.integers(1, 2000)) * math.ulp(t)
        step = ulps if rng.random() < 0.2 else unit * math.exp(rng.uniform(-6, 2.5))
        t = max(t + step, math.nextafter(t, math.inf))
        yield t


def flown(own: Plant, x: arb_mat, drive: np.ndarray, h: Fraction) -> arb_mat:
    """x(h) of x' = A x + drive."""
    n = own.n
    N = arb_mat([[*map(float, row), float(b)] for row, b in zip(own.flow.A, drive, strict=True)]
                + [[0] * (n + 1)])  # fmt: skip
    whole = (N * arb(fmpq(h.numerator, h.denominator))).exp()
    end = whole * arb_mat([[x[i, 0]] for i in range(n)] + [[1]])
    return arb_mat([[end[i, 0]] for i in range(n)])


def pushed(own: Plant, rng: np.random.Generator, x: arb_mat, u: np.ndarray, h: Fraction) -> arb_mat:
    """The state after a step, pushed from the corners of b, another one in each half."""
    for _ in range(2):
        upper = rng.random(own.n) < 0.5
        b = np.where(upper, own.flow.upper, own.flow.lower)
        # b as its bounds are stored; B u may be rounded inside them
        x = flown(own, x, b * (1 - 1e-12) + own.flow.B @ u, h / 2)
    return x


def contained(own: Plant, observer: IntervalObserver, rng: np.random.Generator,
              clock: tuple[float, float]) -> tuple[bool, int]:  # fmt: skip
    """Are the exact states of a record inside their bounds? How many steps had series?"""
    start, unit = clock
    first = rng.normal(size=own.n)
    x = arb_mat([[float(v)] for v in first])
    state = observer.init(start, lower=first - 0.1, upper=first + 0.1)
    instant, u, inside, of_cells = Fraction(start), np.zeros(1), True, 0
    state, _ = observer.step(state, Sample(start, u=u))
    for t in stamps(rng, start, unit):
        error = Fraction(float(rng.uniform(-0.5, 0.5))) * Fraction(math.ulp(t))
        true = max(Fraction(t) + error, instant)
        x = pushed(own, rng, x, u, true - instant)
        instant = true
        mid = np.array([float(x[i, 0].mid()) for i in range(own.n)])
        noise = rng.choice([-0.999, 0.999], own.p) * own.output.noise_bound
        y = None if rng.random() < 0.2 else own.output.C @ mid + noise
        kernels = observer.kernels
        assert kernels.cells is not None
        length = shared_length(t - state.t, t)[0]
        of_cells += kernels.cells.spot(length, t) is not None
        u = rng.normal(size=1)
        state, estimate = observer.step(state, Sample(t, y, u))
        assert "void" not in estimate.status
        for i in range(own.n):
            low, high = arb(float(estimate.lower[i])), arb(float(estimate.upper[i]))
            inside &= bool(low <= x[i, 0]) and bool(x[i, 0] <= high)
    return inside, of_cells


@pytest.mark.parametrize("mode", ["continuous", "periodic"])
@pytest.mark.parametrize("clock", CLOCKS)
def test_bounds_contain_states_in_fifty_digits(mode: str, clock: tuple[float, float]) -> None:
    old, ctx.prec = ctx.prec, 170
    try:
        of_cells = 0
        for seed in range(4):
            rng = np.random.default_rng([seed, len(mode)])
            own, observer = observer_of(rng, clock[1], mode)
            inside, some = contained(own, observer, rng, clock)
            assert inside
            of_cells += some
        assert of_cells > ROWS
    finally:
        ctx.prec = old


# --- rounding ---------------------------------------------------------------------------------


class WithoutMargin(IntervalObserver):
    @cached_property
    def kernels(self) -> StepKernels:
        return KernelsWithoutMargin(self.gains)


@pytest.mark.parametrize("twin", [IntervalObserver, WithoutMargin])
def test_states_known_exactly_stay_inside_by_margins_alone(twin: type[IntervalObserver]) -> None:
    """No disturbance, no width: what is left are roundings of series and of products."""
    old, ctx.prec = ctx.prec, 170
    try:
        rng, inside = np.random.default_rng(3), True
        for n in (2, 5, 8):
            A = rng.normal(size=(n, n)) - 1.5 * np.sqrt(n) * np.eye(n)
            own = Plant(Flow(A), None, Output(np.eye(1, n), noise_bound=0.0))
            observer = twin(observer_for(own, np.zeros((n, 1)), np.zeros((n, 1))).gains)
            x, t = rng.normal(size=n), 0.0
            exact = arb_mat([[float(v)] for v in x])
            state = observer.init(t, lower=x, upper=x)
            for _ in range(20):
                since, t = t, t + float(rng.uniform(0.01, 1.0))
                exact = flown(own, exact, np.zeros(n), Fraction(t) - Fraction(since))
                state, row = observer.step(state, Sample(t))
                assert np.all(row.upper - row.lower < 1e-9 * np.abs(x).max())
                for i in range(n):
                    low, high = arb(float(row.lower[i])), arb(float(row.upper[i]))
                    inside &= bool(low <= exact[i, 0]) and bool(exact[i, 0] <= high)
        assert inside == (twin is IntervalObserver)
    finally:
        ctx.prec = old


# --- laws -------------------------------------------------------------------------------------


def ends(kernel: Kernel, box: np.ndarray, y: np.ndarray, u: np.ndarray) -> np.ndarray:
    """[lower; -upper] of x."""
    v = kernel.vector(box, y[0], y[1], u)
    return kernel.ends(kernel.product(v))[0]


@pytest.mark.parametrize("mode", ["continuous", "periodic"])
@pytest.mark.parametrize("start", [0.0, 100.0, 1.7e9])
def test_bounds_are_those_of_kernels_of_their_own(mode: str, start: float) -> None:
    """No wider by 1e-9 of the width, or by half of what the error of the stamps adds to it."""
    compared = 0
    for seed in range(8):
        rng = np.random.default_rng([seed, len(mode)])
        own, observer = observer_of(rng, 1.0, mode)
        kernels, n = observer.kernels, own.n
        assert kernels.cells is not None
        h = math.exp(rng.uniform(-6, 1))
        size = start + h
        h, half = shared_length(size - start, size)
        if kernels.cells.spot(h, size) is None:
            continue
        exactly = kernels.built(h, 0.0)
        ours, theirs = kernels.for_step(h, size), kernels.built(h, half + length_error(h, size))
        for name in ("none", "sampled") if mode == "periodic" else ("none", "start", "end", "both"):
            centre, radius = rng.normal(size=n), np.exp(rng.uniform(-5, 1, n))
            box = np.concatenate([centre - radius, -centre - radius])
            y = rng.normal(size=(2, own.p))
            got, expected, without = (
                ends(k[name], box, y, np.ones(1)) for k in (ours, theirs, exactly)
            )
            scale = 1e-9 * (radius.max() + np.abs(centre).max()) * max(np.abs(expected).max(), 1.0)
            assert np.all(got >= expected - scale - 0.5 * (without - expected))
            assert np.all(got <= without + 1e-12 * np.abs(without).max())
            compared += 1
    assert compared > 8


@pytest.mark.parametrize("mode", ["continuous", "periodic"])
def test_bounds_hold_for_every_length_that_the_stamps_allow(mode: str) -> None:
    compared = 0
    for seed in range(6):
        rng = np.random.default_rng([seed, len(mode)])
        own, observer = observer_of(rng, 1.0, mode)
        kernels, n, size = observer.kernels, own.n, 1.7e9
        assert kernels.cells is not None
        h, half = shared_length(math.exp(rng.uniform(-3, 0)), size)
        if kernels.cells.spot(h, size) is None:
            continue
        centre = rng.normal(size=n)
        box = np.concatenate([centre - 1e-3, -centre - 1e-3])
        y = np.array([own.output.C @ centre] * 2)
        error = half + length_error(h, size)
        for name in ("none", "sampled") if mode == "periodic" else ("none", "start", "end", "both"):
            got = ends(kernels.for_step(h, size)[name], box, y, np.ones(1))
            for length in (h - error, h, h + error):
                others = ends(kernels.built(length, 0.0)[name], box, y, np.ones(1))
                assert np.all(got <= others + 1e-11 * np.abs(others).max())
            compared += 1
    assert compared > 6


def irregular(rng: np.random.Generator, count: int) -> list[Sample]:
    times = np.cumsum(rng.uniform(0.01, 0.4, count)).tolist()
    return [Sample(t, v) for t, v in zip(times, rng.uniform(-0.05, 0.05, (count, 1)), strict=True)]


def at_rest() -> IntervalObserver:
    """Of three states at rest, an oscillation among them."""
    A = np.array([[-0.5, 3.0, 0.0], [-3.0, -0.5, 1.0], [0.0, 0.0, -1.0]])
    own = Plant(
        Flow(A, lower=[-0.1] * 3, upper=[0.1] * 3), None, Output([[1.0, 0, 0]], noise_bound=0.1)
    )
    return observer_for(own, [[1.0], [0.5], [0.0]], np.zeros((3, 1)))


def rows(observer: IntervalObserver, samples: list[Sample]) -> list[np.ndarray]:
    state, bounds = observer.init(0.0, lower=-np.ones(3), upper=np.ones(3)), []
    for sample in samples:
        state, row = observer.step(state, sample)
        assert row.status == "ok"
        bounds.append(np.concatenate([row.lower, row.upper]))
    return bounds


def test_bounds_do_not_depend_on_what_came_before() -> None:
    """So that a stream that is resumed, or shares its observer, gives the same numbers."""
    rng, warm = np.random.default_rng(7), at_rest()
    samples = irregular(rng, 60)
    rows(warm, irregular(rng, 60))
    twice = [each for sample in samples for each in (sample, sample._replace(t=sample.t + 1e-3))]
    for record in (samples, twice[:60]):
        assert np.array_equal(rows(warm, record), rows(at_rest(), record))


def test_the_short_way_gives_the_numbers_of_the_general_one() -> None:
    samples, short, general = irregular(np.random.default_rng(8), 40), at_rest(), at_rest()
    state = general.init(0.0, lower=-np.ones(3), upper=np.ones(3))
    taken = 0
    for sample, bounds in zip(samples, rows(short, samples), strict=True):
        taken += state.is_usual and short._usual(state, sample) is not None
        state, row = general.step(state._replace(is_usual=False), sample)
        assert np.array_equal(bounds, np.concatenate([row.lower, row.upper]))
    assert taken == 39


def test_a_record_at_once_has_the_bounds_of_its_rows() -> None:
    samples = [Sample(0.0, np.zeros(1)), *irregular(np.random.default_rng(9), 80)]
    start = samples[-1].t
    samples += [Sample(start + 0.125 * k, np.zeros(1)) for k in range(1, 41)]
    samples += [
        each._replace(t=each.t + start + 6.0) for each in irregular(np.random.default_rng(4), 30)
    ]
    t, y = np.array([each.t for each in samples]), np.array([each.y for each in samples])
    batch = at_rest().run_batch(t, y, lower=-np.ones(3), upper=np.ones(3))
    got = np.hstack([batch.lower, batch.upper])
    assert np.array_equal(got, rows(at_rest(), samples))


@pytest.mark.parametrize("start", [0.0, 3.0, 1.7e9])
def test_lengths_of_a_record_are_those_of_its_steps(start: float) -> None:
    times = np.array(list(stamps(np.random.default_rng(6), start, 1.0)))
    steps = np.diff(times, prepend=start)
    lengths, _ = shared_lengths(steps, times)
    each = [shared_length(h, t)[0] for h, t in zip(steps.tolist(), times.tolist(), strict=True)]
    assert lengths.tolist() == each


def test_threads_may_share_an_observer() -> None:
    samples = [irregular(np.random.default_rng(seed), 150) for seed in range(4)]
    observer, got = at_rest(), [list[np.ndarray]() for _ in samples]
    expected = [rows(at_rest(), each) for each in samples]
    rows(observer, samples[0])
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        threads = [threading.Thread(target=lambda k=k: got[k].extend(rows(observer, samples[k])))
                   for k in range(4)]  # fmt: skip
        for each in threads:
            each.start()
        for each in threads:
            each.join()
    finally:
        sys.setswitchinterval(interval)
    assert np.array_equal(got, expected)
