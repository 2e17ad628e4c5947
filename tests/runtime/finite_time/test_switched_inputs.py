"""Known inputs that switch between samples: the exact state stays inside the bounds."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.runtime import from_design
from tests.systems.switched_inputs import Row, random_run, run
from tests.systems.time_stamps import Tally, fifty_digits


def problem(
    A: Any, B: Any, period: float = 0.25, samples: int = 4, noise: float = 1e-3, **more: Any
) -> Any:
    output = {"C": [[0.01] * (len(A) - 1) + [1.0]], "noise_bound": [noise], "measured": "periodic"}
    return obsdesign.Problem(
        flow={"A": A, "B": B},
        output=output | {"period": period},
        observer={"kind": "finite_time", "window": samples * period} | more,
    )


def rows(
    origin: float, period: float, places: tuple[float, ...], m: int = 1, size: float = 1.0
) -> list[Row]:
    """Twelve samples; from the fifth on inputs of changing sign at these parts of a period."""
    result, u = [], size * np.arange(1.0, m + 1)
    for j in range(12):
        start = Fraction(origin) + j * Fraction(period)
        result.append(Row(start, float(start), True, None))
        for place in places if j >= 4 else ():
            t, u = float(start + Fraction(period) * Fraction(place)), -u
            result.append(Row(Fraction(t), t, False, u))
    return result


def checked(task: Any, record: list[Row], least: int) -> float:
    """Run a record; the largest width of its rows with status ok, at least `least` of them."""
    outcome, tally = obsdesign.investigate(task), Tally()
    assert outcome.verdict == "proved"
    with fifty_digits():
        width = run(task, from_design(outcome.design), record, np.random.default_rng(0), tally)
    assert tally.violations == 0
    assert tally.words["ok"] == 0
    assert tally.ok >= least
    return width


@pytest.mark.parametrize("origin", [0.0, 1e3, 1e6, 1.7e9])
def test_a_fast_mode_whose_input_switches_just_before_a_sample(origin: float) -> None:
    checked(problem([[-30.0]], [[30.0]]), rows(origin, 0.25, (0.9,)), 15)


def test_the_same_in_nanoseconds_since_1970() -> None:
    task = problem([[-30e-9]], [[30e-9]], period=0.25e9)
    checked(task, rows(1.7e18, 0.25e9, (0.9,)), 15)


@pytest.mark.parametrize("method", ["least_squares", "minimax", "exact"])
@pytest.mark.parametrize("places", [(0.9371,), (0.13, 0.57, 0.9137, 0.9937)])
def test_a_fast_and_a_slow_mode_with_two_inputs(method: str, places: tuple[float, ...]) -> None:
    more = {"gains": {"L": [[0.5], [0.1]]}} if method == "exact" else {}
    A, B = [[-20.0, 0.3], [0.0, -0.2]], [[40.0, 7.0], [0.3, 1.0]]
    task = problem(A, B, samples=3, noise=1e-9, method=method, **more)
    checked(task, rows(1.7e9, 0.25, places, m=2), 15)


def test_many_switches_in_one_period_add_up() -> None:
    # stamps that are half an ulp late or early: each makes its pulse longer
    half = Fraction(0.49 * math.ulp(1.7e9))
    record = rows(1.7e9, 0.25, tuple((i + 1) / 64 for i in range(60)))
    shifted = [
        r if r.u is None else Row(r.instant + (half if r.u[0] > 0 else -half), r.t, False, r.u)
        for r in record
    ]
    checked(problem([[0.05]], [[1.0]], noise=1e-9), shifted, 100)


def test_inputs_that_cancel_are_rounded_too() -> None:
    task = problem([[-0.1]], [[0.1, -0.3]])
    record = rows(0.0, 0.25, (0.5,))
    for row in record:
        if row.u is not None:
            row.u[:] = 1.0
    exchanged = [
        Row(r.instant, r.t, r.is_sample, None if r.u is None else np.array([3e14, 1e14]))
        for r in record
    ]
    checked(task, exchanged, 10)


def test_stamps_with_ten_digits_name_instants() -> None:
    period = 1 / 3
    record = [
        Row(r.instant, round(r.t, 10), r.is_sample, r.u) if r.is_sample else r
        for r in rows(0.0, period, (0.5, 0.9), size=1e3)
    ]
    assert any(r.t != float(r.instant) for r in record)
    checked(problem([[-30.0]], [[30.0]], period=period), record, 15)


def test_a_row_without_a_sample_is_at_its_own_time() -> None:
    task = problem([[1.0]], [[0.0]], samples=3, noise=1e-9)
    record = rows(1.7e9, 0.25, ())[:9]
    t = math.nextafter(record[-1].t, -math.inf)
    record[-1] = Row(Fraction(t), t, False, np.array([1e6]))
    assert checked(task, record, 6) > 0


def test_bounds_of_a_slow_plant_are_those_of_its_noise() -> None:
    task = problem([[0.0, 1.0], [-1.0, -0.4]], [[0.0], [1.0]], samples=8)
    width = checked(task, rows(1e3, 0.25, (0.3, 0.9)), 8)
    assert width > 0
    outcome = obsdesign.investigate(task)
    observer: Any = from_design(outcome.design)
    state = observer.init(1e3)
    for k, row in enumerate(rows(1e3, 0.25, (0.3, 0.9))):
        y, u = np.zeros(1) if row.is_sample else None, row.u if k else np.zeros(1)
        state, estimate = observer.step(state, obsdesign.runtime.Sample(row.t, y, u=u))
        if row.is_sample and estimate.status == "ok":
            half = (estimate.upper - estimate.lower) / 2
            assert np.all(half <= 1.001 * observer.gains.radius)


def test_random_plants() -> None:
    tally = Tally()
    with fifty_digits():
        assert sum(random_run(seed, tally) for seed in (15, 25)) == 2
    assert tally.violations == 0
    assert tally.ok > 50
