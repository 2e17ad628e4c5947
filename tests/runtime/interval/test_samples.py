"""Samples as events, stretches, fleets, guards: the enclosure holds, whatever happens."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from obsdesign.data.simulation import simulate
from obsdesign.equations.gains import plant_data
from obsdesign.equations.interval import splits as equations
from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Jump, Plant
from obsdesign.runtime import Sample
from obsdesign.runtime.base import rows_of
from obsdesign.runtime.columns import collect
from obsdesign.runtime.interval.fleet import Fleet
from obsdesign.runtime.interval.observer import IntervalObserver
from tests.systems.designs import designed
from tests.systems.interval_runs import (
    DISTURBANCES,
    SIMULATION_ROUNDING,
    execute,
    observer_for,
    random_observer,
    random_plant,
)

HALF_DIGIT = 5e-5  # the widths are known to four decimals


def sampled_observer(plant: Plant, L: Any, M: Any, S: Any = None) -> IntervalObserver:
    """Samples as events, minimal splits, in coordinates S."""
    data = plant_data(plant) | {"L": L, "M": M, "period": plant.output.period}
    S_inverse = None if S is None else np.linalg.inv(S)
    A = equations.in_coordinates(plant.flow.A, S, S_inverse)
    data["D0"], data["D1"] = equations.metzler_split(A)
    data |= {"form": "split" if S is None else "coordinates"} | ({} if S is None else {"S": S})
    if plant.jump is not None:
        G = equations.in_coordinates(plant.jump.G, S, S_inverse)
        data["Gp"], data["Gn"] = equations.nonnegative_split(G)
    return IntervalObserver.from_gains(data)


def random_sampled(rng: np.random.Generator) -> tuple[Plant, IntervalObserver]:
    plain = random_plant(rng)
    output = replace(plain.output, measured="periodic", period=0.05)
    plant = Plant(plain.flow, plain.jump, output)
    shape = (plant.n, plant.p)
    M = 0.5 * rng.standard_normal(shape) * (output.jump_measurement != "none")
    S = (
        rng.standard_normal((plant.n, plant.n)) + 2 * np.eye(plant.n)
        if rng.random() < 0.5
        else None
    )
    if S is not None and np.linalg.cond(S) > 100:
        S = None
    L = rng.standard_normal(shape) * rng.choice([0.0, 0.3, 1.0])
    return plant, sampled_observer(plant, L, M, S)


def sampled_run(seed: int) -> float:
    rng = np.random.default_rng(seed)
    plant, observer = random_sampled(rng)
    x = rng.standard_normal(plant.n) * rng.choice([1.0, 100.0])
    record = simulate(
        plant, until=2.0, initial=x, disturbance=str(rng.choice(DISTURBANCES)), rng=rng
    )
    return execute(observer, record, x, rng, 0.1).violation()


@settings(max_examples=16, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_samples_as_events_never_lose_the_state(seed: int) -> None:
    assert sampled_run(seed) <= SIMULATION_ROUNDING


def test_fixed_seeds_never_lose_the_state() -> None:
    assert max(sampled_run(seed) for seed in range(20)) <= SIMULATION_ROUNDING


# --- example 4.1 with extreme inputs: zero-order hold loses the state, ours do not --------------

A, C, BETA, V = np.array([[-1.0, 0], [1, -2]]), np.array([[0.0, 1]]), 0.1, 0.03


def academic(measured: str, h: float, dwell: tuple[float, float] = (5.0, 5.0)) -> IntervalObserver:
    plant = Plant(
        Flow(A, lower=[-BETA] * 2, upper=[BETA] * 2),
        Jump(np.array([[2.0, 1], [1, 3]]), lower=[-0.3] * 2, upper=[0.3] * 2, dwell_time=dwell),
        Output(C, noise_bound=[V], measured=measured, period=h),
    )
    L, M = np.array([[0.0], [1.0]]), np.array([[1.0], [2.8]])
    return sampled_observer(plant, L, M) if measured == "periodic" else observer_for(plant, L, M)


@pytest.mark.parametrize("h", [0.1, 0.05, 0.01])
@pytest.mark.parametrize("radius", [0.0, 0.1])
@pytest.mark.parametrize("push", [-1.0, 1.0])
@pytest.mark.parametrize("measured", ["periodic", "continuous"])
def test_extreme_inputs_stay_inside(h: float, radius: float, push: float, measured: str) -> None:
    drive = expm(np.block([[A, push * BETA * np.ones((2, 1))], [np.zeros((1, 3))]]) * h)
    for start in ([10.0, 10.0], [1.0, 1.0]):
        x, path = np.array(start), []
        for _ in range(round(4.9 / h)):
            path.append(x)
            x = drive[:2, :2] @ x + drive[:2, 2]
        truth = np.array(path)
        for noise in (-V, V):
            t = np.round(np.arange(len(truth)) * h, 6)
            batch = academic(measured, h).run_batch(
                t, truth[:, 1:] + noise, lower=truth[0] - radius, upper=truth[0] + radius
            )
            assert np.all(batch.lower <= truth + 1e-12)
            assert np.all(truth <= batch.upper + 1e-12)


def test_mean_widths_are_no_wider_than_the_best_sound_scheme_known() -> None:
    # samples every 0.1, jumps at 5 and 10: widths at 10-, and on average over [5, 10)
    h, t = 0.1, np.round(np.arange(101) * 0.1, 1)
    rng = np.random.default_rng(0)
    x, path = np.array([1.0, 1.0]), []
    for k in range(101):
        path.append(C @ x + V * np.sin(t[k]))
        if k in (50, 100):
            x = np.array([[2.0, 1], [1, 3]]) @ x + rng.uniform(-0.3, 0.3, 2)
        x = expm(A * h) @ x
    y = np.array(path)
    jumps = np.isin(t, (5.0, 10.0))
    best = {"periodic": ((0.2058, 0.0859), (0.3624, 0.1008)),
            "continuous": ((0.2058, 0.1739), (0.3624, 0.2848))}  # fmt: skip
    for measured, (end, mean) in best.items():
        batch = academic(measured, h).run_batch(
            t, y, jump=jumps & (t < 10), lower=[0.9, 0.9], upper=[1.1, 1.1]
        )
        assert set(batch.status) == {"ok"}
        width = batch.upper - batch.lower
        assert np.all(width[-1] <= np.array(end) + HALF_DIGIT)
        assert np.all(width[51:].mean(axis=0) <= np.array(mean) + HALF_DIGIT)


# --- the strip, stretches, streams --------------------------------------------------------------


def test_a_measurement_cuts_the_bounds() -> None:
    plant = Plant(Flow(-np.eye(2)), None, Output(np.array([[1.0, 2.0]]), noise_bound=[0.1],
                  measured="periodic", period=0.1))  # fmt: skip
    observer = sampled_observer(plant, np.zeros((2, 1)), np.zeros((2, 1)))
    state = observer.init(0.0, lower=[-1, -1], upper=[1, 1])
    _, estimate = observer.step(state, Sample(0.0, y=[2.5]))
    # x1 + 2 x2 in [2.4, 2.6], x1 <= 1, x2 <= 1: x1 >= 0.4, x2 >= 0.7
    np.testing.assert_allclose(estimate.lower, [0.4, 0.7], atol=1e-12)
    np.testing.assert_allclose(estimate.upper, [1.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_a_record_at_once_agrees_with_the_stream(seed: int) -> None:
    rng = np.random.default_rng(seed)
    if seed % 2:
        plant, observer = random_sampled(rng)
    else:
        plant = random_plant(rng)
        observer = random_observer(plant, rng)
    x = rng.standard_normal(plant.n)
    record = simulate(
        plant, until=40.0, step=0.05, initial=x, disturbance="random", dwell=19.0, rng=rng
    )
    y = record.block("y").copy()
    y[100:103] = np.nan
    data = (
        record.t,
        y,
        record.block("u"),
        np.nan_to_num(record.block("w")),
        record.columns["jump"],
    )
    box = {"lower": x - 1, "upper": x + 1}
    batch = observer.run_batch(*data, **box)
    state = observer.init(0.0, **box)
    for k, sample in enumerate(rows_of(*data)):
        state, estimate = observer.step(state, sample)
        assert estimate.status == batch.status[k]
        assert np.array_equal(estimate.lower, batch.lower[k])
        assert np.array_equal(estimate.upper, batch.upper[k])


def test_a_stretch_contains_the_exact_state_of_no_width() -> None:
    from flint import arb, arb_mat, ctx

    plant = Plant(Flow(np.array([[-0.3, 0.2], [0.1, -0.2]])), None,
                  Output(np.array([[1.0, 0.0]]), noise_bound=0.0, measured="periodic", period=0.125))  # fmt: skip
    observer = sampled_observer(plant, np.array([[0.0], [0.0]]), np.zeros((2, 1)))
    rows, h = 200, 0.125
    old, ctx.prec = ctx.prec, 300
    try:
        flow = arb_mat([[arb(float(a)) * arb(h) for a in row] for row in plant.flow.A]).exp()
        state, path = arb_mat([[arb(1)], [arb(-2)]]), []
        for _ in range(rows):
            path.append(state)
            state = flow * state
        y = np.array([[float(x[0, 0])] for x in path])
        loose = Plant(plant.flow, None, replace(plant.output, noise_bound=[1e-12]))
        observer = sampled_observer(loose, np.zeros((2, 1)), np.zeros((2, 1)))
        batch = observer.run_batch(np.arange(rows) * h, y, lower=[1, -2], upper=[1, -2])
        for k, x in enumerate(path):
            for i in range(2):
                assert bool(arb(float(batch.lower[k, i])) <= x[i, 0])
                assert bool(x[i, 0] <= arb(float(batch.upper[k, i])))
        assert (batch.upper - batch.lower).max() < 1e-11
    finally:
        ctx.prec = old


@pytest.mark.parametrize("measured", ["periodic", "continuous"])
@pytest.mark.parametrize("with_S", [False, True])
def test_a_fleet_is_its_plants(measured: str, with_S: bool) -> None:
    observer = academic(measured, 0.1)
    if with_S:
        body = {"flow": {"A": A.tolist(), "disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}},
                "output": {"C": [[0, 1]], "noise_bound": [0.03], "measured": measured, "period": 0.1},
                "observer": {"kind": "interval", "gains": {"L": [[0], [0.5]], "S": [[0, 2], [1, 1]]}}}  # fmt: skip
        design = designed(body)
        observer = IntervalObserver.from_gains(design.gains)
    plants, rng = 9, np.random.default_rng(3)
    fleet, centre = Fleet((observer,) * plants), rng.standard_normal((2, plants))
    state = fleet.init(0.0, lower=centre - 0.5, upper=centre + 0.5)
    single = [observer.init(0.0, lower=c - 0.5, upper=c + 0.5) for c in centre.T]
    x = centre.copy()
    for k in range(1, 30):
        t = round(0.1 * k, 1)
        x = expm(A * 0.1) @ x
        y = C @ x
        state, together = fleet.step(state, t, y)
        assert not together.single
        for i in range(plants):
            single[i], alone = observer.step(single[i], Sample(t, y=y[:, i]))
            np.testing.assert_allclose(together.lower[:, i], alone.lower, rtol=0, atol=1e-12)
            np.testing.assert_allclose(together.upper[:, i], alone.upper, rtol=0, atol=1e-12)
            assert np.all(together.lower[:, i] <= x[:, i])
            assert np.all(x[:, i] <= together.upper[:, i])
    _, far = fleet.step(state, 3.0, y + 50)
    assert all("y1 outside its bounds" in far.plant(i).status for i in range(plants))
    with pytest.raises(ValueError, match="time must increase"):
        fleet.step(state, 1.0, y)


def own_rows(plants: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """(t, y, jump): times of their own, rows and samples that are missing, and jumps."""
    offset = np.where(np.arange(plants) % 3 == 0, 0.013, 0.0)
    t = np.round(0.1 * np.arange(1, 80)[:, None] + offset, 3)
    t[rng.random(t.shape) < 0.02] = np.nan
    y = rng.uniform(-0.02, 0.02, t.shape)
    y[rng.random(t.shape) < 0.03] = np.nan
    return t, y, rng.random(t.shape) < 0.02


@pytest.mark.parametrize("measured", ["periodic", "continuous"])
def test_plants_of_a_fleet_have_their_own_designs_times_jumps_and_gaps(measured: str) -> None:
    one = academic(measured, 0.1, dwell=(0.01, 50.0))
    other = IntervalObserver.from_gains(one.gains.to_document() | {"L": 0.8 * one.gains.L})
    plants, ordinary = 30, 0
    observers = (one, other, one) * 10
    fleet = Fleet(observers)
    box = {"lower": [-3, -3], "upper": [3, 3]}
    state, single = fleet.init(0.0, **box), [each.init(0.0, **box) for each in observers]
    for t, y, jump in zip(*own_rows(plants, np.random.default_rng(7)), strict=True):
        state, together = fleet.step(state, t, y[None], jump=jump)
        ordinary += plants - len(together.single)
        for i in np.flatnonzero(~np.isnan(t)):
            sample = Sample(t[i], y[i : i + 1], jump=bool(jump[i]))
            single[i], alone = observers[i].step(single[i], sample)
            estimate, room = (
                together.plant(i),
                1e-9 * (1 + np.abs(alone.upper) + np.abs(alone.lower)),
            )
            assert (estimate.t, estimate.status) == (alone.t, alone.status)
            assert estimate.events == alone.events
            assert np.all(estimate.lower <= alone.lower + room)
            assert np.all(alone.upper <= estimate.upper + room)
        assert np.isnan(together.lower[:, np.isnan(t)]).all()
    assert ordinary > 0.5 * plants * 79


def test_steps_of_their_own_are_those_of_the_observer_bit_for_bit() -> None:
    observers = (academic("continuous", 0.1), academic("periodic", 0.1))
    fleet, box = Fleet(observers), {"lower": [-3, -3], "upper": [3, 3]}
    state, single = fleet.init(0.0, **box), [each.init(0.0, **box) for each in observers]
    for t, y, jump in zip(*own_rows(2, np.random.default_rng(1)), strict=True):
        state, together = fleet.step(state, t, y[None], jump=jump)
        for i in np.flatnonzero(~np.isnan(t)):
            sample = Sample(t[i], y[i : i + 1], jump=bool(jump[i]))
            single[i], alone = observers[i].step(single[i], sample)
            np.testing.assert_equal(tuple(together.plant(i)), tuple(alone))


def test_a_refuted_plant_of_a_fleet_is_reset_alone() -> None:
    observer = academic("periodic", 0.1)
    fleet = Fleet((observer,) * 9)
    state = fleet.init(0.0, lower=[0, 0], upper=[1, 1])
    state, _ = fleet.step(state, 0.0, [0.5])
    y = np.full((1, 9), 0.5)
    y[0, 4] = 50.0
    state, bad = fleet.step(state, 0.1, y)
    assert {i: each.status for i, each in bad.single.items()} == {4: "y1 outside its bounds"}
    state, after = fleet.step(state, 0.2, [0.4])
    assert "void since time 0.1" in after.plant(4).status
    state = fleet.reset(state, 4, lower=[0, 0], upper=[1, 1])
    state, fresh = fleet.step(state, 0.3, [0.4])
    assert [fresh.plant(i).status for i in range(9)] == ["ok"] * 9
    assert list(fresh.single) == [4]
    assert not fleet.step(state, 0.4, [0.4])[1].single


def test_known_inputs_of_a_fleet() -> None:
    plant = Plant(
        Flow(A, B=np.array([[1.0], [0.5]])), None,
        Output(C, noise_bound=[V], measured="periodic", period=0.1),
    )  # fmt: skip
    observer = sampled_observer(plant, np.array([[0.0], [0.5]]), np.zeros((2, 1)))
    fleet, rng = Fleet((observer,) * 9), np.random.default_rng(2)
    box = {"lower": [-3, -3], "upper": [3, 3]}
    state, single = fleet.init(0.0, **box), [observer.init(0.0, **box) for _ in range(9)]
    for k in range(20):
        y, u = rng.uniform(-0.01, 0.01, (2, 1, 9))
        states_u = k == 0 or k % 3 > 0
        state, together = fleet.step(state, round(0.1 * k, 1), y, u=u if states_u else None)
        assert not together.single or k == 0
        for i in range(9):
            sample = Sample(round(0.1 * k, 1), y[:, i], u[:, i] if states_u else None)
            single[i], alone = observer.step(single[i], sample)
            assert np.all(together.lower[:, i] <= alone.lower + 1e-12)
            assert np.all(alone.upper <= together.upper[:, i] + 1e-12)


def test_fleets_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one observer"):
        Fleet(())
    plant = Plant(Flow(-np.eye(1)), None, Output(np.eye(1), noise_bound=[0.1]))
    other = observer_for(plant, np.zeros((1, 1)), np.zeros((1, 1)))
    with pytest.raises(ValueError, match="same numbers of states"):
        Fleet((other, academic("continuous", 0.1)))
    fleet = Fleet((other,) * 3)
    with pytest.raises(ValueError, match=r"must have shape \(1,\) or \(1, 3\); got \(2,\)"):
        fleet.init(0.0, lower=[1, 2], upper=[1, 2])


def test_two_designs_for_one_plant_share_the_intersection() -> None:
    one, two = academic("continuous", 0.1), academic("periodic", 0.1)
    record = simulate(
        Plant(Flow(A, lower=[-BETA] * 2, upper=[BETA] * 2),
              Jump(np.array([[2.0, 1], [1, 3]]), lower=[-0.3] * 2, upper=[0.3] * 2, dwell_time=(5, 5)),
              Output(C, noise_bound=[V], measured="periodic", period=0.1)),
        until=12.0, initial=[1.0, 1.0], disturbance="extreme", rng=np.random.default_rng(2),
    )  # fmt: skip
    data = (record.t, record.block("y"), None, None, record.columns["jump"])
    box = {"lower": [0, 0], "upper": [2, 2]}
    fleet = Fleet((one, two))
    state, both = fleet.init(0.0, **box), []
    for sample in rows_of(*data):
        state, bounds = fleet.step(state, sample.t, sample.y, jump=sample.jump)
        both.append(fleet.intersection(bounds))
    batch = collect(both)
    singles = [one.run_batch(*data, **box), two.run_batch(*data, **box)]
    np.testing.assert_allclose(batch.lower, np.maximum(*(s.lower for s in singles)), atol=1e-12)
    np.testing.assert_allclose(batch.upper, np.minimum(*(s.upper for s in singles)), atol=1e-12)
    x = record.block("x")
    assert np.all(batch.lower <= x)
    assert np.all(x <= batch.upper)
    assert set(batch.status) == {"ok"}


def test_an_intersection_is_for_one_plant() -> None:
    other = academic("continuous", 0.1)
    gains = other.gains.to_document() | {"noise_bound": np.array([0.5])}
    fleet = Fleet((other, IntervalObserver.from_gains(gains)))
    _, bounds = fleet.step(fleet.init(0.0, lower=[0, 0], upper=[1, 1]), 0.0, [0.5])
    with pytest.raises(ValueError, match="for one plant") as error:
        fleet.intersection(bounds)
    assert str(error.value) == "observers must be for one plant; noise_bound differs."


# --- guard, reset, events -----------------------------------------------------------------------


def test_refuted_bounds_stay_void_until_they_are_reset() -> None:
    observer = academic("periodic", 0.1)
    state = observer.init(0.0, lower=[0, 0], upper=[1, 1])
    state, good = observer.step(state, Sample(0.0, y=[0.5]))
    state, bad = observer.step(state, Sample(0.1, y=[50.0]))
    state, after = observer.step(state, Sample(0.2, y=[0.4]))
    assert good.status == "ok"
    assert bad.status == "y1 outside its bounds"
    assert after.status.endswith("void since time 0.1 (y1 outside its bounds)")
    state = observer.reset(state, lower=[0, 0], upper=[60, 60])
    state, fresh = observer.step(state, Sample(0.3, y=np.array([0.4])))
    assert fresh.status == "ok"
    assert observer.reset(state, lower=[0, 0], upper=[1, 1]).guard == state.guard
    with pytest.raises(ValueError, match="lower 2 exceeds upper 1"):
        observer.reset(state, lower=[0, 2], upper=[1, 1])


def test_bounds_that_cross_are_named() -> None:
    plant = Plant(Flow(-np.eye(2)), None,
                  Output(np.array([[1.0, 1.0], [1.0, -1.0]]), noise_bound=[0.0, 0.0],
                         measured="periodic", period=0.1))  # fmt: skip
    observer = sampled_observer(plant, np.zeros((2, 2)), np.zeros((2, 2)))
    state = observer.init(0.0, lower=[-1, -1], upper=[1, 1])
    # each measurement alone is possible, both together are not: x = (2, 0)
    state, estimate = observer.step(state, Sample(0.0, y=[2.0, 2.0]))
    assert estimate.status == "bounds crossed"
    _, later = observer.step(state, Sample(0.1, y=[0.0, 0.0]))
    assert "void since time 0 (bounds crossed)" in later.status


def test_missing_and_late_samples_are_named_and_keep_the_enclosure() -> None:
    observer = academic("periodic", 0.1)
    state = observer.init(0.0, lower=[1, 1], upper=[1, 1])
    rows = [Sample(0.0, y=[1.0]), Sample(0.1), Sample(0.2, y=[0.8])]
    said = [e.status for e in observer.run(state, rows)]
    assert said == ["ok", "missing sample", "time 0.2 since the last sample exceeds 0.1"]


def test_events_tell_what_happened() -> None:
    observer = academic("continuous", 0.1, dwell=(1.0, 5.0))
    state = observer.init(0.0, lower=[0, 0], upper=[1, 1])
    rows = [Sample(0.0, y=[0.5]), Sample(0.1, y=[0.5], jump=True), Sample(0.6, y=None, jump=True)]
    events = [e.events for e in observer.run(state, rows)]
    assert events == [
        (), ((0.1, "jump"),),
        ((0.6, "jump"), (0.6, "dwell time 0.5 below 1"), (0.6, "missing sample")),
    ]  # fmt: skip


def test_more_jumps_than_samples() -> None:
    observer = academic("periodic", 10.0, dwell=(0.01, 1.0))
    state = observer.init(0.0, lower=[1, 1], upper=[1, 1])
    x, G = np.array([1.0, 1.0]), np.array([[2.0, 1], [1, 3]])
    for k in range(1, 20):
        x = G @ (expm(A * 0.1) @ x)
        state, estimate = observer.step(state, Sample(round(0.1 * k, 1), jump=True))
        assert np.all(estimate.lower <= x)
        assert np.all(x <= estimate.upper)


def test_time_running_backwards_is_refused() -> None:
    observer = academic("periodic", 0.1)
    state = observer.init(0.0, lower=[1, 1], upper=[1, 1])
    for t in (0.0, 0.1, 0.2, 0.3):
        state, _ = observer.step(state, Sample(t, y=np.array([1.0])))
    with pytest.raises(ValueError, match=r"time must increase; got 0\.2 after 0\.3"):
        observer.step(state, Sample(0.2, y=np.array([1.0])))
    with pytest.raises(ValueError, match="time must be finite"):
        observer.step(state, Sample(math.nan, y=np.array([1.0])))
