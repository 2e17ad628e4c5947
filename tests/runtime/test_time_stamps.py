"""Time stamps up to 1.7e18 and steps from one ulp on: bounds hold, and differences alone count."""

from __future__ import annotations

import math
from collections import defaultdict
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from obsdesign.equations.gains import plant_data
from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Jump, Plant
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.clocks.time_stamps import time_tolerance, time_tolerances
from obsdesign.runtime.impulsive.observer import ImpulsiveObserver
from obsdesign.runtime.interval.clock import SampleClock
from obsdesign.runtime.luenberger.observer import LuenbergerObserver
from obsdesign.runtime.step_cache import shared_length
from tests.runtime.interval.test_samples import sampled_observer
from tests.systems.designs import designed
from tests.systems.interval_runs import observer_for
from tests.systems.time_stamps import (
    MODES,
    ORIGINS,
    Tally,
    bounds_run,
    fifty_digits,
    finite_time_run,
    luenberger_run,
)

EPOCH = 1.7e18  # nanoseconds since 1970: one ulp is 256


# --- bounds -------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("origin", ORIGINS)
def test_bounds_hold_at_every_origin_and_step(origin: float, mode: str) -> None:
    tally = Tally()
    with fifty_digits():
        for seed in range(4):
            bounds_run(seed, origin, 24, tally, mode)
    assert tally.violations == 0
    assert tally.ok > 150


def test_steps_of_sixteen_ulps_are_no_rest() -> None:
    plant = Plant(
        Flow(np.diag([-5e-6, -1e-5])), None,
        Output(np.array([[1.0, 0.0]]), noise_bound=np.array([0.1]), measured="periodic", period=4096.0),
    )  # fmt: skip
    observer = sampled_observer(plant, np.array([[0.5], [0.0]]), np.zeros((2, 1)))
    state = observer.init(EPOCH, lower=[0.95, 0.99], upper=[1.05, 1.01])
    for k in range(200):
        x = np.exp(np.array([-5e-6, -1e-5]) * 4096 * k)
        state, estimate = observer.step(state, Sample(EPOCH + 4096 * k, y=x[:1] + 0.05))
        assert estimate.status == "ok"
        assert (estimate.lower <= x).all()
        assert (x <= estimate.upper).all()
    assert estimate.upper[1] < 5e-3  # it has decayed, not stopped


@pytest.mark.parametrize("when", ["before", "after", "none"])
@pytest.mark.parametrize("rate", [-1.0, -100.0])
def test_a_jump_one_ulp_after_a_row(when: str, rate: float) -> None:
    plant = Plant(
        Flow(np.array([[rate]])), Jump(np.array([[0.5]]), dwell_time=(0.0, math.inf)),
        Output(np.ones((1, 1)), noise_bound=np.array([0.1]), jump_measurement=when),
    )  # fmt: skip
    observer = observer_for(plant, np.ones((1, 1)), np.zeros((1, 1)))
    for start in (0.0, 1.7e9):
        rows = [start, start + 1.0, math.nextafter(start + 1.0, math.inf)]
        state = observer.init(start, lower=[0.9], upper=[1.1])
        for k, t in enumerate(rows):
            x = math.exp(rate * (t - start)) * (0.5 if k == 2 else 1.0)
            before = x if when == "after" else math.exp(rate * (t - start))
            y = None if k == 2 and when == "none" else np.array([before])
            state, estimate = observer.step(state, Sample(t, y, jump=k == 2))
            assert estimate.status == "ok"
            assert estimate.lower[0] <= x <= estimate.upper[0]


def test_ordinary_bounds_are_as_narrow_as_exact_times_allow() -> None:
    # h = 1e-3 at t = 1e4: the length is known to some 1e-11, and so are the bounds of x = 1
    plant = Plant(Flow(np.array([[-1.0]])), None, Output(np.ones((1, 1)), noise_bound=np.ones(1)))
    observer = observer_for(plant, np.zeros((1, 1)), np.zeros((1, 1)))
    state = observer.init(1e4, lower=[1.0], upper=[1.0])
    for k in range(1, 100):
        state, estimate = observer.step(state, Sample(1e4 + k / 1000))
        assert estimate.upper[0] - estimate.lower[0] < 2.5e-11 * k


@pytest.mark.parametrize("origin", [0.0, 1.7e9])
@pytest.mark.parametrize("step", [0.1, 0.05, 0.02, 0.01, 0.001])
def test_equal_decimal_steps_share_one_length(origin: float, step: float) -> None:
    t = np.array([origin + round(k * step, 4) for k in range(20_000)])
    lengths = defaultdict(set)
    for before, now in zip(t[:-1].tolist(), t[1:].tolist(), strict=True):
        lengths[math.frexp(now)[1]].add(shared_length(now - before, now)[0])
    assert all(len(shared) == 1 for shared in lengths.values())


@settings(max_examples=80, deadline=None)
@given(st.floats(5e-324, 1e300), st.floats(1e-300, 1e300))
def test_no_positive_step_is_rounded_to_zero(part: float, size: float) -> None:
    h = max(min(part, size), math.ulp(size))
    length, half = shared_length(h, size)
    assert length > 0
    assert abs(Fraction(length) - Fraction(h)) <= Fraction(half)
    assert half <= 6 * math.ulp(size)


# --- guards -------------------------------------------------------------------------------------


def test_the_guard_is_as_sharp_as_stamps() -> None:
    guard = DwellGuard(4096.0, 8192.0)
    guard, _ = guard.after(EPOCH, True)
    # two halves of an ulp, 256, are all that may be missing
    assert guard.after(EPOCH + 3840, True)[1] is None
    assert guard.after(EPOCH + 3584, True)[1] == "dwell time 3584 below 4096"
    assert guard.after(EPOCH + 8448, True)[1] is None
    assert guard.after(EPOCH + 8704, False)[1] == "dwell time 8704 above 8192"


def test_decimal_dwell_times_and_periods_are_no_objection_at_any_origin() -> None:
    for origin, step in ((1.7e18, 5000), (1.7e9, 1e-4), (0.0, 0.1)):
        assert time_tolerance(step, origin + step) < 0.2 * step
        guard = DwellGuard(step, step, jitter=0.0)
        for k in range(300):
            guard, objection = guard.after(origin + k * step, True)
            assert objection is None


@given(st.lists(st.tuples(st.floats(1e-9, 1e18), st.floats(-1e19, 1e19)), min_size=1))
def test_tolerances_of_an_array_are_those_of_its_entries(pairs: list[tuple[float, float]]) -> None:
    lengths, times = np.array(pairs).T
    expected = [time_tolerance(length, t) for length, t in pairs]
    assert time_tolerances(lengths, times).tolist() == expected
    assert min(expected) > 0


@pytest.mark.parametrize("origin", [-1.7e18, 1.7e18])
@pytest.mark.parametrize("period", [4096.0, None])
def test_steps_are_regular_on_both_sides_of_zero(origin: float, period: float | None) -> None:
    clock = SampleClock(
        period=period, limit=math.inf if period else 4096.0, skips_jumps=False, before_jumps=True,
        corrects=True,
    )  # fmt: skip
    times = origin + 4096.0 * np.arange(1, 6)
    steps = np.array([4096.0, 3840.0, 4352.0, 3584.0, 4608.0])
    regular = clock.regular_steps(steps, times).tolist()
    assert regular == [True, True, True, period is None, False]


def test_a_sample_between_two_periods_is_not_one() -> None:
    body = {"flow": {"A": [[0.0, 2e-5], [-2e-5, 0.0]]}, "output": {"C": [[1, 0]], "measured": "periodic", "period": 4096},
            "observer": {"kind": "finite_time", "window": 5 * 4096, "method": "least_squares"}}  # fmt: skip
    observer: Any = from_design(designed(body))
    for early, regular in ((0, True), (256, True), (512, False), (2048, False)):
        state = observer.init(EPOCH)
        for k in range(12):
            t = EPOCH + 4096 * k - (early if k == 11 else 0)
            state, estimate = observer.step(state, Sample(t, y=[math.cos(2e-5 * 4096 * k)]))
        assert (estimate.status == "ok") == regular


# --- point kinds --------------------------------------------------------------------------------


@pytest.mark.parametrize("origin", ORIGINS)
def test_luenberger_is_the_exact_recursion(origin: float) -> None:
    with fifty_digits():
        assert max(luenberger_run(seed, origin, 40) for seed in range(6)) < 1e-11


@pytest.mark.parametrize("origin", ORIGINS)
def test_finite_time_bounds_hold_at_samples_on_the_period(origin: float) -> None:
    tally = Tally()
    with fifty_digits():
        finite_time_run(0, origin, 60, tally)
    assert tally.violations == 0
    assert tally.ok > 50


def scaled(kind: str, step: float) -> Any:
    """An observer whose plant takes about twenty steps for its time constant."""
    rate = 0.05 / step
    A = rate * np.array([[-0.3, 1.0, 0.0], [-1.0, -0.2, 0.5], [0.0, 0.3, -0.4]])
    C = np.array([[1.0, 0.0, 0.0]])
    if kind in ("luenberger", "impulsive"):
        plant = Plant(Flow(A), Jump(0.9 * np.eye(3), dwell_time=(2 * step, 40 * step)), Output(C))
        data = plant_data(plant)
        if kind == "luenberger":
            return LuenbergerObserver.from_gains(
                data | {"L": rate * np.ones((3, 1)), "M": 0.3 * C.T}
            )
        return ImpulsiveObserver.from_gains(data | {"strategy": "full", "alpha": 1.4, "window": 4})
    body: dict[str, Any] = {
        "flow": {"A": A.tolist()},
        "output": {"C": C.tolist()},
        "observer": {"kind": kind},
    }
    if kind == "unknown_input":
        body["flow"]["D"] = (rate * np.array([[1.0], [0.2], [0.0]])).tolist()
    if kind == "finite_time":
        body["output"] |= {"measured": "periodic", "period": step}
        body["observer"] |= {"window": 8 * step, "method": "least_squares"}
    if kind == "impulsive_input":
        body["flow"]["A"] = (rate * np.array([[-1.5, 0.0], [1.0, -0.3]])).tolist()
        body["jump"] = {"H": [[1], [0]], "dwell_time": [60 * step, "inf"]}
        body["output"] = {
            "C": [[0, 1]],
            "noise_std": [1e-3],
            "measured": "periodic",
            "period": step,
        }
        body["observer"] |= {"operator": "samples", "window": 20 * step}
    return from_design(designed(body))


def pulse_response(age: np.ndarray) -> np.ndarray:
    """Second state of the plant of `impulsive_input` after a pulse of weight 1, in steps."""
    fast, slow = (np.exp(-0.05 * a * np.maximum(age, 0)) for a in (1.5, 0.3))
    return (slow - fast) / 1.2 * (age > 0)


@pytest.mark.parametrize(
    "kind", ["luenberger", "impulsive", "unknown_input", "finite_time", "impulsive_input"]
)
@pytest.mark.parametrize(
    ("origin", "step"), [(1.7e9, 2.0**-10), (1.7e18, 2.0**24), (-1.7e18, 2.0**24)]
)
def test_only_differences_of_stamps_count(kind: str, origin: float, step: float) -> None:
    observer = scaled(kind, step)
    jumping = kind in ("luenberger", "impulsive")
    rng = np.random.default_rng(3)
    sizes = rng.integers(1, 4, 79) if jumping else np.ones(79)
    t = step * np.concatenate([[0], np.cumsum(sizes)])
    x = (
        pulse_response((t - 30.5 * step) / step)
        if kind == "impulsive_input"
        else 1 + np.cos(t / step)
    )
    y = x[:, None] + 1e-3 * rng.standard_normal((80, 1))
    more = {"jump": np.arange(80) % 4 == 3} if jumping else {}
    here, there = observer.run_batch(t, y, **more), observer.run_batch(origin + t, y, **more)
    tolerance = 2 * math.ulp(origin) / step  # what an event's own time may be rounded by
    assert np.allclose(
        here.x, there.x, rtol=1e-9, atol=1e-12 if kind != "impulsive_input" else tolerance
    )
    assert here.status == there.status
    assert len(here.events) == len(there.events) == (1 if kind == "impulsive_input" else 0)
    for one, other in zip(here.events, there.events, strict=True):
        assert abs(other.t - origin - one.t) <= 2 * math.ulp(origin)
