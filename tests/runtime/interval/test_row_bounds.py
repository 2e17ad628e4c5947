"""Bounds of b, c and v that change from row to row (Assumption 3 of Degue et al., NOLCOS 2016)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.exponential import expm
from obsdesign.equations.gains import plant_data
from obsdesign.equations.interval import splits
from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Jump, Plant
from obsdesign.runtime import Bounds, Sample
from obsdesign.runtime.interval.observer import IntervalObserver
from tests.systems.interval_runs import SIMULATION_ROUNDING, random_observer, random_plant

MODES = ("continuous", "periodic", "at_jumps", "coordinates")
PERIOD = 0.125  # a binary number


def observer_of(mode: str, rng: np.random.Generator) -> tuple[Plant, IntervalObserver]:
    """A random plant, and an observer with gains without any sense."""
    plant = random_plant(rng, int(rng.integers(1, 4)))
    observer = random_observer(plant, rng)
    gains = observer.gains
    if mode == "at_jumps":
        D0, D1 = splits.metzler_split(gains.A)
        gains = replace(gains, L=0 * gains.L, D0=D0, D1=D1)
    if mode == "periodic":
        D0, D1 = splits.metzler_split(gains.A)
        gains = replace(gains, period=PERIOD, L=0.3 * gains.L, D0=D0, D1=D1)
    if mode == "coordinates":
        S = np.eye(gains.n) + 0.3 * rng.standard_normal((gains.n, gains.n))
        zero = np.zeros((gains.n, gains.n))  # completed at run time
        gains = replace(gains, form="coordinates", S=S, D0=zero, D1=zero, Gp=zero, Gn=zero)
    return plant, IntervalObserver(gains)


def narrowed(rng: np.random.Generator, lower: Any, upper: Any) -> tuple[Any, Any]:
    """Bounds inside others, some of them points, some cells as declared."""
    ends = np.sort(rng.uniform(0, 1, (2, len(lower))), axis=0)
    ends[1] = np.where(rng.random(len(lower)) < 0.2, ends[0], ends[1])
    low, high = (lower + (upper - lower) * end for end in ends)
    low, high = np.clip(low, lower, upper), np.clip(high, lower, upper)
    missing = rng.random((2, len(lower))) < 0.15
    return np.where(missing[0], np.nan, low), np.where(missing[1], np.nan, high)


def corner(rng: np.random.Generator, pair: Any, lower: Any, upper: Any) -> Any:
    """A signal at ends of its bounds, or between."""
    low, high = (np.where(np.isnan(a), b, a) for a, b in zip(pair, (lower, upper), strict=True))
    part = rng.choice([0.0, 1.0, 0.5], len(low))
    return np.clip(low + part * (high - low), low, high)


@dataclass(frozen=True)
class Record:
    """Samples with bounds of their own, and the state after each."""

    samples: list[Sample]
    x: list[Any]

    def without_bounds(self) -> list[Sample]:
        return [sample._replace(bounds=None) for sample in self.samples]


def record(plant: Plant, rng: np.random.Generator, x: Any, mode: str, rows: int = 40) -> Record:
    """Signals inside bounds of each row; steps irregular, samples missing, jumps anywhere."""
    flow, jump, output, n = plant.flow, plant.jump, plant.output, plant.n
    V = np.broadcast_to(np.asarray(output.noise_bound, float), (plant.p,))
    forced = np.zeros(n)
    t, samples, states = 0.0, [], []
    declared = (flow.lower, flow.upper), (jump.lower, jump.upper), (-V, V)
    pair_b: Any = (flow.lower, flow.upper)
    for row in range(rows):
        step = PERIOD if mode == "periodic" and rng.random() < 0.7 else rng.integers(1, 16) / 64
        for _ in range(2 if row else 0):  # two values of b on the way
            b = corner(rng, pair_b, flow.lower, flow.upper)
            system = np.zeros((n + 1, n + 1))
            system[:n, :n], system[:n, n] = flow.A, b + forced
            x = (expm(system * step / 2) @ np.append(x, 1.0))[:n]
        t += step if row else 0.0
        jumps = bool(rng.random() < 0.2)
        pairs = [narrowed(rng, *ends) for ends in declared]
        own = Bounds(*(pair if rng.random() < 0.7 else None for pair in pairs))
        if rng.random() < 0.2:
            own = None
        pair_b, pair_c, pair_v = (
            ends if own is None or pair is None else pair
            for pair, ends in zip(own or Bounds(), declared, strict=True)
        )
        v = corner(rng, pair_v, -V, V)
        after = output.jump_measurement == "after"
        w = None if jump.E is None else rng.standard_normal(jump.E.shape[1])
        y = output.C @ x + v
        if jumps:
            c = corner(rng, pair_c, jump.lower, jump.upper)
            x = jump.G @ x + c + (0 if w is None else jump.E @ w)
            y = output.C @ x + v if after else y
        held = None if flow.B is None else rng.standard_normal(flow.B.shape[1])
        forced = np.zeros(n) if held is None else flow.B @ held
        lost = rng.random() < 0.15 or (mode == "at_jumps" and not jumps)
        samples.append(Sample(t, None if lost else y, held, w, jumps, own))
        states.append(x)
    return Record(samples, states)


def run(observer: IntervalObserver, samples: Any, start: Any) -> tuple[Any, Any, list[str]]:
    rows = list(observer.run(observer.init(samples[0].t, lower=start[0], upper=start[1]), samples))
    return (np.array([row.lower for row in rows]), np.array([row.upper for row in rows]),
            [row.status for row in rows])  # fmt: skip


@cache
def case(mode: str, seed: int) -> tuple[IntervalObserver, Record, tuple[Any, Any]]:
    rng = np.random.default_rng([MODES.index(mode), seed])
    plant, observer = observer_of(mode, rng)
    x = rng.standard_normal(plant.n)
    width = rng.uniform(0, 1, (2, plant.n)) * rng.choice([0.0, 1.0])
    return observer, record(plant, rng, x, mode), (x - width[0], x + width[1])


def violation(outcome: Any, x: Any) -> float:
    lower, upper, _ = outcome
    return float(np.max(np.maximum(lower - x, x - upper)) / max(np.abs(x).max(), 1.0))


@pytest.mark.parametrize("mode", MODES)
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_signals_inside_bounds_of_their_rows_stay_inside(mode: str, seed: int) -> None:
    observer, samples, start = case(mode, seed)
    assert violation(run(observer, samples.samples, start), samples.x) <= SIMULATION_ROUNDING


@pytest.mark.parametrize("mode", MODES)
def test_narrower_bounds_never_widen(mode: str) -> None:
    narrower = 0
    for seed in range(2):
        observer, samples, start = case(mode, seed)
        lower, upper, _ = run(observer, samples.samples, start)
        low, high, _ = run(observer, samples.without_bounds(), start)
        slack = 1e-9 * np.maximum(np.abs(low), np.abs(high)).max(axis=1, keepdims=True)
        assert np.all(low - slack <= lower)
        assert np.all(upper <= high + slack)
        narrower += np.sum(upper - lower < 0.999 * (high - low))
    assert narrower > 25


@pytest.mark.parametrize("mode", MODES)
def test_bounds_as_declared_change_no_bit(mode: str) -> None:
    observer, samples, start = case(mode, 3)
    boxes = observer.declared_bounds
    equal = Bounds(*((box.lower, box.upper) for box in (boxes.b, boxes.c, boxes.v)))
    same = run(observer, [sample._replace(bounds=equal) for sample in samples.samples], start)
    plain = run(observer, samples.without_bounds(), start)
    np.testing.assert_array_equal(same[0], plain[0])
    np.testing.assert_array_equal(same[1], plain[1])
    assert same[2] == plain[2]


@pytest.mark.parametrize("mode", MODES)
def test_declared_radii_in_parts_are_those_of_the_declared_kernels(mode: str) -> None:
    # one entry narrowed by a millionth: every other part is 1, so that all else must agree
    observer, samples, start = case(mode, 5)
    boxes = observer.declared_bounds
    upper = boxes.b.upper - 1e-6 * (boxes.b.upper - boxes.b.lower)
    own = [sample._replace(bounds=Bounds(b=(boxes.b.lower, upper))) for sample in samples.samples]
    lower, upper, _ = run(observer, own, start)
    low, high, _ = run(observer, samples.without_bounds(), start)
    size = np.maximum(np.abs(low), np.abs(high)).max(axis=1, keepdims=True)
    assert np.all(np.abs(lower - low) <= 1e-5 * size)
    assert np.all(np.abs(upper - high) <= 1e-5 * size)


@pytest.mark.parametrize("mode", MODES)
def test_a_batch_is_the_stream(mode: str) -> None:
    observer, samples, start = case(mode, 7)
    rows = samples.samples
    pairs = {}
    for name, box in zip("bcv", observer.declared_bounds.boxes, strict=True):
        blank = np.full((2, len(box.lower)), np.nan)
        own = [row.bounds and getattr(row.bounds, name) for row in rows]
        table = np.array([blank if pair is None else np.array(pair) for pair in own])
        pairs[name] = (table[:, 0], table[:, 1])
    nothing = np.full(observer.gains.p, np.nan)
    inputs = {
        "u": None if rows[0].u is None else [row.u for row in rows],
        "w": None if rows[0].w is None else [row.w for row in rows],
    }
    batch = observer.run_batch(
        [row.t for row in rows], [nothing if row.y is None else row.y for row in rows],
        jump=[row.jump for row in rows], bounds=Bounds(**pairs), lower=start[0], upper=start[1],
        **inputs,
    )  # fmt: skip
    lower, upper, status = run(observer, rows, start)
    np.testing.assert_array_equal(batch.lower, lower)
    np.testing.assert_array_equal(batch.upper, upper)
    assert list(batch.status) == status


def scalar(period: float | None = None) -> IntervalObserver:
    """x' = -x + b, x+ = x + c, y = x + v, |b|, |c|, |v| <= 1, no correction at jumps."""
    one = np.ones((1, 1))
    plant = Plant(
        Flow(-one, lower=-one[0], upper=one[0]),
        Jump(one, lower=-one[0], upper=one[0], dwell_time=(0.5, np.inf)),
        Output(one, noise_bound=1.0),
    )
    data = plant_data(plant) | {"form": "split", "M": 0 * one, "Gp": one, "Gn": 0 * one}
    data |= {"L": 0.5 * one, "D1": 0 * one, "period": period}
    data["D0"] = -1.5 * one if period is None else -one
    return IntervalObserver.from_gains({k: v for k, v in data.items() if v is not None})


OUTSIDE = {
    # bounds of the first of two rows, 1 apart, and the signal: x(0) = 0, jump at the second row
    "b": (Bounds(b=([-1], [-0.9])), None, lambda x, e: x + 1.0 * (1 - e)),
    "c": (None, Bounds(c=([-1], [-0.9])), lambda x, e: x + 1.0),
}


@pytest.mark.parametrize("name", OUTSIDE)
@pytest.mark.parametrize("period", [None, 1.0])
def test_a_signal_outside_the_bounds_of_its_row_leaves_the_estimate(
    name: str, period: float | None
) -> None:
    first, second, state_of = OUTSIDE[name]
    observer = scalar(period)
    rows = [Sample(0.0, bounds=first), Sample(1.0, jump=True, bounds=second)]
    x = state_of(0.0, np.exp(-1.0))
    for samples, is_inside in ((rows, False), ([r._replace(bounds=None) for r in rows], True)):
        _, upper, _ = run(observer, samples, ([0.0], [0.0]))
        if name == "b":  # the jump adds at most 1 of any sign
            assert (upper[-1, 0] >= x + 1.0) == is_inside
        else:
            assert (upper[-1, 0] >= x) == is_inside


@pytest.mark.parametrize("period", [None, 1.0])
def test_noise_outside_the_bounds_of_its_row_leaves_the_estimate(
    period: float | None,
) -> None:
    observer = scalar(period)
    still = Bounds(b=([0.0], [0.0]))
    for own, is_inside in ((still._replace(v=([0.8], [1.0])), False), (still, True)):
        rows = [Sample(k * 1.0, [-1.0 + np.exp(-k)], bounds=own) for k in range(4)]  # v = -1
        lower, upper, _ = run(observer, rows, ([-5.0], [5.0]))
        x = np.exp(-3.0)
        assert (lower[-1, 0] <= x <= upper[-1, 0]) == is_inside


def test_bounds_of_b_end_at_the_next_row() -> None:
    observer = scalar()
    point = Bounds(b=([0.0], [0.0]))
    rows = [Sample(0.0, bounds=point), Sample(1.0), Sample(2.0)]
    lower, upper, _ = run(observer, rows, ([0.0], [0.0]))
    assert upper[1, 0] - lower[1, 0] < 1e-12
    e = np.exp(-1.0)
    np.testing.assert_allclose(upper[2], 1 - e, rtol=1e-6)


REFUSED = {
    "b1_hi must be within the declared bounds [-1.0, 1.0]; got 2.0.": Bounds(b=([0], [2])),
    "b1_lo must be within the declared bounds [-1.0, 1.0]; got -inf.": Bounds(b=([-np.inf], [0])),
    "c1_lo must not exceed c1_hi; got 0.5 above 0.0.": Bounds(c=([0.5], [0])),
    "bounds of v must have 1 entries; got 2.": Bounds(v=([0, 0], [0, 0])),
}


@pytest.mark.parametrize("sentence", REFUSED)
def test_bounds_beyond_the_declared_ones_are_refused(sentence: str) -> None:
    observer = scalar()
    state = observer.init(0.0, lower=[0], upper=[0])
    with pytest.raises(ValueError) as error:
        observer.step(state, Sample(0.0, bounds=REFUSED[sentence]))
    assert str(error.value) == sentence
