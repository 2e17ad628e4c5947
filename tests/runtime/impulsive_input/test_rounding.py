"""Operator `samples` on records all but exact: deviations cover what rounding leaves."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from obsdesign.runtime.impulsive_input.event import onset_statistics
from obsdesign.runtime.impulsive_input.samples.engine import _event
from obsdesign.runtime.impulsive_input.samples.filter import SampledPlant
from obsdesign.runtime.impulsive_input.samples.onset import Cells, Fit, Grid, OnsetModel
from tests.systems.impulsive_input import events_of, observer_of, record, rows_from

A, H = np.array([[-0.8, 0.7], [-0.4, -1.2]]), np.array([[-0.4], [-0.6]])
C = np.array([[1.0, 0], [-0.3, 0.9], [0.2, 0.7]])
UNIT = 1e7  # of time: stamps of large numbers


def problem(unit: float) -> dict[str, Any]:
    return {
        "flow": {"A": (A / unit).tolist()},
        "jump": {"H": H.tolist(), "dwell_time": [6 * unit, math.inf]},
        "output": {"C": C.tolist(), "measured": "periodic", "period": 0.2 * unit,
                   "noise_std": [1e-16, 1e-13, 1e-10]},
        "observer": {"kind": "impulsive_input", "operator": "samples"},
    }  # fmt: skip


@pytest.mark.parametrize("unit", [1.0, UNIT])
@pytest.mark.parametrize("seed", range(2))
def test_no_deviation_is_below_rounding(unit: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = 0.2 * np.arange(300)
    train = [(7.0 * k + rng.uniform(0, 0.9), rng.uniform(0.3, 3)) for k in range(1, 8)]
    y = record(A, H, train, t, [0.5, -0.2]) @ C.T
    events = events_of(rows_from(observer_of(problem(unit)), unit * t, y))
    assert len(events) == len(train)
    for event, (onset, weight) in zip(events, train, strict=True):
        assert event.status == "ok"
        assert event.t_std > math.ulp(event.t) / 4
        assert event.weights_std[0] > 1e-12 * weight
        assert abs(event.t - unit * onset) < 5 * event.t_std
        assert abs(event.weights[0] - weight) < 5 * event.weights_std[0]
        # still as good as the rounding of outputs, 1e-7 of them, allows
        assert event.weights_std[0] < 1e-5 * weight


@pytest.mark.parametrize("weight", [1e-3, 1.0, 1e6])
def test_the_variance_of_a_weight_is_no_difference_of_squares(weight: float) -> None:
    onsets, std = np.linspace(0, 1, 5), 1e-12 * weight
    fit = Fit(
        grid=Grid(onsets, np.zeros(5, dtype=int), np.zeros((5, 1))), probability=np.full(5, 0.2),
        weights=np.full(5, weight), precision=np.full(5, std**-2), ratio=np.full(5, 1e24), cost=0.0,
    )  # fmt: skip
    assert _event(fit, 3).weights_std[0] == pytest.approx(std)


@pytest.mark.parametrize("origin", [1.7e9, 1.7e18, -1.7e18])
@pytest.mark.parametrize("count", [41, 481])
def test_the_mean_of_an_onset_is_rounded_once(origin: float, count: int) -> None:
    rng = np.random.default_rng(count)
    ulp = math.ulp(origin)
    for _ in range(20):
        ages = 4 * ulp * np.arange(count)
        p = rng.dirichlet(np.ones(count))
        t, std = onset_statistics(origin + ages, p, 4 * ulp)
        assert abs((t - origin) - p @ ages) <= ulp
        assert std == pytest.approx(onset_statistics(ages, p, 4 * ulp)[1], rel=1e-9)


@pytest.mark.parametrize("size", [1e3, 1e9, 1e11])
def test_onsets_that_leave_the_same_are_equally_likely(size: float) -> None:
    """One state: every onset of a cell explains the samples as well as another."""
    one = np.ones((1, 1))
    plant = SampledPlant(A=-one, B=np.zeros((1, 0)), C=one, H=one, drift=np.zeros(1))
    cells = Cells(
        ends=np.ones(1), propagated=one[:, :, None], information=0.7 * size**2 * one[None],
        score=0.9 * size**2 * one, costs=np.array([size**2 * 0.81 / 0.7]), grid=Grid.empty(1),
    )  # fmt: skip
    model = OnsetModel(plant, nonnegative=False)
    fit = model.posterior(cells, model.grid_at(cells, np.linspace(0.1, 0.9, 40)))
    assert fit.probability.max() < 2 / 40
    assert fit.probability.min() > 0.5 / 40
    assert abs(fit.cost) < 1  # what rounding leaves is no misfit
