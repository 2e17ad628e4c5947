"""Bounds against states in exact fractions: one plant after another, whole records, fleets."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from obsdesign.equations.gains import plant_data
from obsdesign.equations.interval import splits as equations
from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Plant
from obsdesign.runtime import Sample
from obsdesign.runtime.interval.fleet import Fleet
from obsdesign.runtime.interval.observer import IntervalObserver

PERIOD, ROWS, PLANTS = 0.125, 120, 9
PUSH, NOISE = 2.0**-40, 2.0**-42  # so small that rounding is most of the width
A, C = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0]])
S = np.array([[3.0, 1.0], [-1.0, 7.0]])
GAINS = {"periodic": [[0.75], [1.5]], "continuous": [[3.0], [2.0]]}


def observer(measured: str, *, in_coordinates: bool) -> IntervalObserver:
    """Of x1' = x2 + b1, x2' = b2: its steps are fractions."""
    plant = Plant(
        Flow(A, lower=[-PUSH] * 2, upper=[PUSH] * 2), None,
        Output(C, noise_bound=[NOISE], measured=measured, period=PERIOD),
    )  # fmt: skip
    L = np.array(GAINS[measured])
    F = A if measured == "periodic" else A - L @ C
    if in_coordinates:
        F = np.linalg.solve(S, F @ S)
    D0, D1 = equations.metzler_split(F)
    data = plant_data(plant) | {"form": "split", "L": L, "M": 0 * L, "D0": D0, "D1": D1}
    if measured == "periodic":
        data["period"] = PERIOD
    return IntervalObserver.from_gains(
        data | ({"form": "coordinates", "S": S} if in_coordinates else {})
    )


def exact_records(rng: np.random.Generator) -> tuple[list[list[list[Fraction]]], np.ndarray]:
    """States [row][plant][i] with pushes and noise at their ends, and their samples (rows, p)."""
    h, push, states, samples = Fraction(PERIOD), Fraction(PUSH), [], []
    x = [[Fraction(float(v)) for v in 1e3 * rng.standard_normal(2)] for _ in range(PLANTS)]
    for _ in range(ROWS):
        states.append([list(each) for each in x])
        noise = rng.choice([-1, 1], PLANTS)
        row = [float(each[0] + int(s) * Fraction(NOISE)) for each, s in zip(x, noise, strict=True)]
        row = [  # rounded: no further than the noise goes
            y if abs(Fraction(y) - each[0]) <= Fraction(NOISE) else float(each[0])
            for y, each in zip(row, x, strict=True)
        ]
        samples.append(row)
        for each in x:
            b1, b2 = (int(s) * push for s in rng.choice([-1, 1], 2))
            each[0] += h * each[1] + h * b1 + h * h * b2 / 2
            each[1] += h * b2
    return states, np.array(samples)


def assert_inside(lower: Any, upper: Any, x: list[Fraction]) -> None:
    for low, high, value in zip(lower.tolist(), upper.tolist(), x, strict=True):
        assert Fraction(low) <= value <= Fraction(high)


@pytest.mark.parametrize("measured", GAINS)
@pytest.mark.parametrize("in_coordinates", [False, True])
def test_bounds_contain_the_exact_state(measured: str, in_coordinates: bool) -> None:
    own = observer(measured, in_coordinates=in_coordinates)
    states, y = exact_records(np.random.default_rng(int(in_coordinates)))
    first = np.array([[float(v) for v in x] for x in states[0]])  # exactly: they are floats
    t = PERIOD * np.arange(ROWS)
    for i in range(2):
        record = own.run_batch(t, y[:, i], lower=first[i], upper=first[i])
        assert set(record.status) == {"ok"}
        for k, x in enumerate(states):
            assert_inside(record.lower[k], record.upper[k], x[i])
    fleet = Fleet((own,) * PLANTS)
    state = fleet.init(0.0, lower=first.T, upper=first.T)
    alone = [own.init(0.0, lower=x, upper=x) for x in first]
    for k, x in enumerate(states):
        state, estimate = fleet.step(state, t[k], y[k][None])
        assert len(estimate.single) == (0 if k else PLANTS)
        for i in range(PLANTS):
            assert_inside(estimate.lower[:, i], estimate.upper[:, i], x[i])
            alone[i], single = own.step(alone[i], Sample(t[k], y[k, i : i + 1]))
            assert single.status == "ok"
            assert_inside(single.lower, single.upper, x[i])
            scale = 1e-12 * max(map(abs, x[i]))
            for ends, others in (
                (estimate.lower[:, i], single.lower), (estimate.upper[:, i], single.upper)
            ):  # fmt: skip
                assert np.all(np.abs(ends - others) <= float(scale))
