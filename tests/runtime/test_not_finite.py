"""Estimates that are not finite never carry `ok`, and no warning comes with them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.interval.fleet import Fleet
from tests.runtime.test_time_stamps import scaled
from tests.systems.designs import designed
from tests.systems.time_stamps import MODES, random_case

# pytest turns every warning into an error (pyproject.toml)
SIZES = (1e99, 1e154, 1e300, 1.7e308)
ROWS = 30


def finite(*values: Any) -> bool:
    return all(value is None or bool(np.isfinite(value).all()) for value in values)


def large_rows(rng: np.random.Generator, p: int, size: float) -> np.ndarray:
    y = rng.uniform(-1, 1, (ROWS, p))
    y[rng.random(ROWS) < rng.choice([0.05, 1.0])] *= size
    return y


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("kind", ["luenberger", "impulsive", "unknown_input", "finite_time"])
def test_point_estimates_that_overflow(kind: str, size: float) -> None:
    observer, rng = scaled(kind, 1.0), np.random.default_rng(5)
    for large_start in (False, True, True):
        y = large_rows(rng, 1, size)
        x = (size if large_start else 1.0) * rng.uniform(-1, 1, observer.n)
        jump = np.arange(ROWS) % 4 == 3 if kind in ("luenberger", "impulsive") else np.zeros(ROWS)
        t = np.cumsum(rng.choice([1.0, 50.0], ROWS)) if large_start else np.arange(float(ROWS))
        samples = [Sample(*row, jump=bool(j)) for *row, j in zip(t, y, jump, strict=True)]
        for estimate in observer.run(observer.init(t[0], x=x), samples):
            assert finite(estimate.x, estimate.lower, estimate.upper) or estimate.status != "ok"
        batch = observer.run_batch(t, y, x=x, **({"jump": jump} if jump.any() else {}))
        for k in range(ROWS):
            assert finite(batch.x[k]) or batch.status[k] != "ok"


def test_infinite_bounds_of_finite_data_are_not_ok() -> None:
    body = {"flow": {"A": [[0.0, 1.0], [-1.0, 0.0]]}, "output": {"C": [[1, 0]], "measured": "periodic", "period": 0.1, "noise_bound": [0.1]},
            "observer": {"kind": "finite_time", "window": 0.5}}  # fmt: skip
    observer: Any = from_design(designed(body))
    for size in (1.0, *SIZES):
        state = observer.init(0.0)
        for k in range(12):
            y = [size * (-1.0) ** k]
            state, estimate = observer.step(state, Sample(round(0.1 * k, 1), y=y))
            bounded = finite(estimate.x, estimate.lower, estimate.upper)
            assert bounded or estimate.status != "ok"
        assert (estimate.status == "ok") == (size < 1.7e308)


def test_an_unstable_plant_overflows_with_a_status() -> None:
    observer = scaled("luenberger", 1.0)
    state, words = observer.init(0.0, x=[1.0, 0.0, 0.0]), []
    for k in range(3):
        state, estimate = observer.step(
            state, Sample(float(k), y=[1e308 if k else 1.0], jump=k > 0)
        )
        words.append((finite(estimate.x), "not finite" in estimate.status))
    big = observer.init(0.0, x=[np.inf, 0.0, 0.0])
    _, estimate = observer.step(big, Sample(1.0, y=[1.0]))
    assert "estimate is not finite" in estimate.status
    assert all(fine != said for fine, said in words)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("mode", MODES)
def test_bounds_that_overflow(mode: str, size: float) -> None:
    rng = np.random.default_rng(2)
    for _ in range(6):
        plant, observers = random_case(rng, mode, 1.0)
        observer, pair = observers[0], Fleet(tuple(observers))
        y = large_rows(rng, plant.p, size)
        jump, t = rng.random(ROWS) < rng.choice([0.0, 0.2]), np.arange(float(ROWS))
        high = np.full(plant.n, min(size, 1e308) if rng.random() < 0.5 else 1.0)
        box = {"lower": -high, "upper": high}
        state, states = observer.init(0.0, **box), pair.init(0.0, **box)
        for row in zip(t.tolist(), y, jump.tolist(), strict=True):
            state, estimate = observer.step(state, Sample(row[0], row[1], jump=row[2]))
            states, both = pair.step(states, row[0], row[1], jump=row[2])
            for each in (estimate, pair.intersection(both)):
                assert finite(each.lower, each.upper) or each.status != "ok"
        batch = observer.run_batch(t, y, jump=jump, **box)
        for k in range(ROWS):
            assert finite(batch.lower[k], batch.upper[k]) or batch.status[k] != "ok"
        fleet = Fleet((observer,) * 9)
        state = fleet.init(0.0, **box)
        for k in range(1, ROWS):
            state, many = fleet.step(state, t[k], y[k])
            for each in map(many.plant, range(9)):
                assert finite(each.lower, each.upper) or each.status != "ok"


def test_bounds_between_numbers_near_the_largest_are_not_ok() -> None:
    # centre and radius are finite, their sum is not
    _, observers = random_case(np.random.default_rng(0), "continuous", 1.0)
    n = observers[0].n
    state = observers[0].init(0.0, lower=[0.2e308] * n, upper=[1.7e308] * n)
    for k in range(3):
        state, estimate = observers[0].step(state, Sample(float(k)))
        assert finite(estimate.lower, estimate.upper) or "overflowed" in estimate.status
