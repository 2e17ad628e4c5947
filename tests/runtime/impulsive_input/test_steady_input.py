"""Few samples: what a window says, against the whole covariance; steady outputs; fine records."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.exponential import expm, flow_integrals
from obsdesign.runtime.base import rows_of
from obsdesign.runtime.impulsive_input.samples.filter import Filtered, Row
from obsdesign.runtime.impulsive_input.samples.steady_input import STEADY, Steady
from tests.systems.impulsive_input import CHAIN, events_of, observer_of, record

EXAMPLES = Path(__file__).parents[3] / "examples"
PULSES = [(54.3, 1.0), (131.5, 2.0), (212.0, 1.2), (263.3, 1.4), (379.0, 2.6)]


def hormone(body: dict[str, Any], t: Any, train: Any, seed: int) -> np.ndarray:
    drift = np.array(body["flow"]["disturbance"]["lower"])
    x = record(body["flow"]["A"], body["jump"]["H"], train, t, [0.3, 1.4], drift)
    return x[:, 1:] * (1 + 0.05 * np.random.default_rng(seed).standard_normal((len(t), 1)))


def window_of(observer: Any, seed: int, gap: bool) -> tuple[Any, Filtered, list[Row]]:
    """The model of an observer, a filter to begin at, and irregular rows after it."""
    rng = np.random.default_rng(seed)
    t = 7.0 + np.cumsum(rng.uniform(2, 12, 7))
    rows = [Row(float(a), rng.uniform(1, 3, 1), np.zeros(0), rng.uniform(0.1, 0.3, 1)) for a in t]
    if gap:
        rows[2] = Row(rows[2].t, None, np.zeros(0), rows[2].spread)
    M = rng.standard_normal((2, 2))
    first = Filtered.without_sample(
        Row(7.0, None, np.zeros(0), np.ones(1)), rng.uniform(0, 2, 2), M
    )
    return observer.engine.model, first, rows


def residuals(model: Any, first: Filtered, rows: list[Row]) -> tuple[Any, Any, Any, list[Row]]:
    """(residuals of the plant run from the start, their whole covariance, C e^{A t}, rows seen)."""
    measured, plant = [row for row in rows if row.y is not None], model.plant
    ages = [row.t - first.row.t for row in measured]
    observed = np.vstack([plant.C @ expm(plant.A * age) for age in ages])
    forced = [plant.C @ flow_integrals(plant.A, age)[1] @ plant.drift for age in ages]
    e = np.concatenate([row.y for row in measured]) - observed @ first.x - np.concatenate(forced)
    S = (
        np.diag(np.concatenate([row.spread**2 for row in measured]))
        + observed @ first.P @ observed.T
    )
    return e, S, observed, measured


@pytest.mark.parametrize(("seed", "gap"), [(1, False), (2, True), (3, False), (4, True)])
def test_two_sums_of_a_cell_hold_the_likelihood_of_the_whole_window(
    observer: Any, seed: int, gap: bool
) -> None:
    model, first, rows = window_of(observer, seed, gap)
    cells = model.window(first, rows, np.inf)
    onsets = np.linspace(first.row.t, rows[4].t, 37)
    fit = model.posterior(cells, model.grid_at(cells, onsets))
    e, S, observed, measured = residuals(model, first, rows)
    A, C, H = model.plant.A, model.plant.C, model.plant.H
    ages = np.array([row.t for row in measured])[None, :] - onsets[:, None]
    h = ((C @ expm(A * np.maximum(ages, 0)[:, :, None, None]) @ H)[..., 0, 0]) * (ages >= 0)
    num, den = h @ np.linalg.solve(S, e), np.einsum("gk,gk->g", h, np.linalg.solve(S, h.T).T)
    ratio = np.maximum(num, 0) ** 2 / np.where(den > 0, den, 1)
    np.testing.assert_allclose(fit.ratio, ratio, rtol=1e-8, atol=1e-10)
    assert fit.cost == pytest.approx(e @ np.linalg.solve(S, e) - ratio.max(), rel=1e-9)
    # the state after it: conditional mean and covariance of x at the end, over the posterior
    p, g, last = fit.probability, fit.weights, rows[-1].t
    means, at = model.collapsed(fit, cells, first, rows)
    flow = expm(A * (last - first.row.t))
    gain = np.linalg.solve(S, observed @ first.P).T
    free = flow @ first.x + flow_integrals(A, last - first.row.t)[1] @ model.plant.drift
    jumps = (expm(A * (last - onsets)[:, None, None]) @ H)[..., 0].T
    each = free[:, None] + flow @ gain @ (e[:, None] - h.T * g) + jumps * g
    np.testing.assert_allclose(at.x, each @ p, rtol=1e-8)
    np.testing.assert_allclose(means[-1], at.x)
    np.testing.assert_allclose(means[0], first.x + gain @ (e - h.T @ (p * g)), rtol=1e-8)
    onto, away = jumps - flow @ gain @ h.T, each - (each @ p)[:, None]
    P = flow @ (first.P - gain @ observed @ first.P) @ flow.T + (onto * p / fit.precision) @ onto.T
    np.testing.assert_allclose(at.P, P + (away * p) @ away.T, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("seed", [5, 6])
def test_the_best_steady_input_is_that_of_least_squares(observer: Any, seed: int) -> None:
    model, first, rows = window_of(observer, seed, seed == 6)
    e, S, _, measured = residuals(model, first, rows)
    A, C, H = model.plant.A, model.plant.C, model.plant.H
    r = np.concatenate(
        [C @ flow_integrals(A, row.t - first.row.t)[1] @ H[:, 0] for row in measured]
    )
    w = (r @ np.linalg.solve(S, e)) / (r @ np.linalg.solve(S, r))
    steady = Steady.begin(first)
    for row in rows:
        steady = steady.after(model.plant, row, 0.5)
    assert steady.rival == pytest.approx(0.5 * len(rows))
    left = (e - r * w) @ np.linalg.solve(S, e - r * w)
    assert steady.cost(nonnegative=False) == pytest.approx(left, rel=1e-8)
    assert steady.cost(nonnegative=True) == pytest.approx(
        left if w > 0 else e @ np.linalg.solve(S, e), rel=1e-8
    )


@pytest.mark.parametrize("level", [1.5, 2.0, 3.0, 10.0])
@pytest.mark.parametrize("seed", [None, 1])
def test_a_constant_output_says_that_it_may_be_steady(
    observer: Any, level: float, seed: int | None
) -> None:
    t, y = 10.0 * np.arange(48), np.full((48, 1), level)
    if seed is not None:
        y *= 1 + 0.05 * np.random.default_rng(seed).standard_normal(y.shape)
    rows = list(observer.run(observer.init(0.0), rows_of(t, y)))
    events = events_of(rows)
    assert events  # above the basal level something is secreted
    assert all(STEADY in event.status for event in events)
    for event in events[:-1]:
        near = [row.status for row in rows if event.t <= row.t < event.t + 20]
        assert all(STEADY in status for status in near)


@pytest.mark.parametrize("level", [0.5, 1.0])
def test_a_constant_output_at_the_basal_level_or_below_holds_no_impulse(
    observer: Any, level: float
) -> None:
    batch = observer.run_batch(10.0 * np.arange(48), np.full((48, 1), level))
    assert not batch.events


def test_pulses_stand_for_themselves_and_a_steady_end_does_not(
    body: dict[str, Any], observer: Any
) -> None:
    t = 10.0 * np.arange(96)
    y = hormone(body, t, PULSES, seed=4)
    y[48:] = 3.0
    events = observer.run_batch(t, y).events
    early = [event for event in events if event.t < 440]
    assert len(early) == len(PULSES)
    for event, (onset, _) in zip(early, PULSES, strict=True):
        assert event.t == pytest.approx(onset, abs=15)
    assert all(event.status == "ok" for event in early)
    assert all(STEADY in event.status for event in events if event.t > 600)


@pytest.mark.parametrize("period", [5.0, 1.0, 0.25])
def test_rows_finer_than_the_period_only_make_it_more_certain(
    body: dict[str, Any], observer: Any, period: float
) -> None:
    t = period * np.arange(round(300 / period) + 1)
    events = observer.run_batch(t, hormone(body, t, PULSES[:4], seed=7)).events
    assert len(events) == 4
    for event, (onset, weight) in zip(events, PULSES, strict=False):
        assert event.t == pytest.approx(onset, abs=4 * event.t_std)
        assert event.weights[0] == pytest.approx(weight, abs=4 * event.weights_std[0])
        assert event.t_std < 0.9 * period**0.5  # coarse samples: 2.9 of 10


def test_rows_without_samples_between_change_nothing(body: dict[str, Any], observer: Any) -> None:
    t = 10.0 * np.arange(31)
    y = hormone(body, t, PULSES[:4], seed=9)
    fine = 2.5 * np.arange(121)
    among = np.full((121, 1), np.nan)
    among[::4] = y
    coarse, finer = observer.run_batch(t, y).events, observer.run_batch(fine, among).events
    assert len(coarse) == len(finer) == 4
    for a, b in zip(coarse, finer, strict=True):
        assert b.t == pytest.approx(a.t, abs=0.5 * a.t_std)
        assert b.weights[0] == pytest.approx(a.weights[0], abs=0.5 * a.weights_std[0])


@pytest.mark.parametrize(("std", "weighting"), [(0.0, "plain"), (3.0, "plain"), (3.0, "gls")])
@pytest.mark.parametrize("level", [50.0, 500.0])
def test_a_constant_output_fits_no_impulse_of_the_integral_operator(
    std: float, weighting: str, level: float
) -> None:
    body = copy.deepcopy(CHAIN)
    body["output"] |= {"period": 0.1, "noise_std": [std]}
    body["observer"] |= {"weighting": weighting, "exponents": [-0.65 - 0.05 * k for k in range(6)]}
    observer, t = observer_of(body), 0.1 * np.arange(2000)
    y = level + std * np.random.default_rng(0).standard_normal((len(t), 1))
    batch = observer.run_batch(t, y)
    late = [event for event in batch.events if event.t > 20]  # before: the state is unknown
    assert all("does not fit one impulse" in event.status for event in late)
    assert bool(batch.events)
    # what never passes its maximum does not keep rows open for ever
    open_rows = [t for t, status in zip(batch.t, batch.status, strict=True) if "unres" in status]
    assert min(open_rows) > t[-1] - 2.5 * 20


def test_an_output_that_stays_zero_keeps_no_rows_open() -> None:
    observer, t = observer_of(CHAIN), 0.05 * np.arange(1000)
    batch = observer.run_batch(t, np.zeros((len(t), 1)))
    assert not batch.events
    assert list(batch.status[:598]) == ["ok"] * 598
