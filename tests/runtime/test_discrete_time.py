"""Observers of plants in discrete time: enclosure, exact feasible sets, rows on the grid."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import obsdesign
from obsdesign.data.simulation import simulate
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Observer, Sample, rows_of
from tests.systems.discrete_time import exact_record, feasible_bounds, pulsed, turning, two_rates

KINDS = ["interval", "set_membership"]


def observer_of(body: dict[str, Any], kind: str | None = None) -> tuple[Problem, Observer]:
    own = body if kind is None else {**body, "observer": {"kind": kind}}
    problem = Problem.from_dict(own)
    return problem, from_design(obsdesign.design(problem))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "body", [two_rates(2, 5), pulsed(), turning("interval"), turning("interval", measured="periodic", period=0.3)],
    ids=["two rates", "pulsed", "turning", "every third step"],
)  # fmt: skip
def test_the_exact_state_is_inside(body: dict[str, Any], kind: str) -> None:
    """Trajectories in rational arithmetic, disturbances at corners, all times of the clocks."""
    problem, observer = observer_of(body, kind)
    rng = np.random.default_rng(3)
    n = problem.plant.n
    samples, truth = exact_record(problem, [Fraction(k, 7) for k in range(n)], 60, rng)
    state = observer.init(0.0, lower=[-1] * n, upper=[1] * n)
    inside = 0
    for sample, x in zip(samples, truth, strict=True):
        state, row = observer.step(state, sample)
        assert row.status == "ok"
        assert row.lower is not None
        assert row.upper is not None
        for low, value, high in zip(row.lower.tolist(), x, row.upper.tolist(), strict=True):
            assert Fraction(low) <= value <= Fraction(high)
            inside += 1
    assert inside == 60 * n


@pytest.mark.parametrize("rows", [1, 3])
def test_set_membership_bounds_are_those_of_the_feasible_set(rows: int) -> None:
    """Every row, or every third: the linear program over the whole record, to a thousandth."""
    body = turning("set_membership")
    body["flow"].pop("B")
    body["observer"] |= {"window": 25}
    problem, observer = observer_of(body)
    run = simulate(problem.plant, until=2.0, rng=np.random.default_rng(5))
    kept = slice(None, None, rows)
    samples = list(rows_of(run.t[kept], run.block("y")[kept]))
    state, box = observer.init(0.0, lower=[-2, -2], upper=[2, 2]), np.array([[-2, -2], [2, 2]])
    for k, sample in enumerate(samples):
        state, row = observer.step(state, sample)
        assert row.lower is not None
        assert row.upper is not None
        exact = feasible_bounds(problem, box.astype(float), samples[: k + 1])
        size = exact[1] - exact[0]
        assert (row.lower <= exact[0] + 1e-7 * size).all()
        assert (row.upper >= exact[1] - 1e-7 * size).all()
        if k > 3:
            assert (row.upper - row.lower <= (1 + 2e-3) * size).all()


def test_a_plant_sampled_exactly_has_the_bounds_of_its_flow() -> None:
    """Without disturbance both feasible sets are one; held inputs act through their integral."""
    A, B, h = np.array([[0.0, 1.0], [-4.0, -0.4]]), np.array([[0.0], [1.0]]), 0.25
    whole = expm(np.block([[A, B], [np.zeros((1, 3))]]) * h)
    output = {"C": [[1, 0]], "noise_bound": 0.125, "measured": "periodic", "period": h}
    flow = {"A": A, "B": B}
    step = {"A": whole[:2, :2], "B": whole[:2, 2:], "dt": h}
    boxes = []
    plant = Problem.from_dict({"flow": flow, "output": output}).plant
    run = simulate(plant, until=6.0, rng=np.random.default_rng(1))
    for own in (flow, step):
        _, observer = observer_of({"flow": own, "output": output}, "set_membership")
        batch = observer.run_batch(
            run.t, run.block("y"), run.block("u"), lower=[-2, -2], upper=[2, 2]
        )
        assert set(batch.status) == {"ok"}
        boxes.append(np.stack([batch.lower, batch.upper]))
    np.testing.assert_allclose(boxes[0], boxes[1], rtol=0, atol=2e-4)
    assert (boxes[1][1] - boxes[1][0])[-1].max() < 0.2


@pytest.mark.parametrize("kind", KINDS)
def test_batches_equal_streams(kind: str) -> None:
    problem, observer = observer_of(pulsed(), kind)
    run = simulate(problem.plant, until=20.0, rng=np.random.default_rng(2))
    w = run.block("w")
    batch = observer.run_batch(
        run.t, run.block("y"), w=w, jump=run.happened[:, 0], lower=[-2, -2], upper=[2, 2]
    )
    state = observer.init(0.0, lower=[-2, -2], upper=[2, 2])
    samples = rows_of(run.t, run.block("y"), w=w, jump=run.happened[:, 0])
    for k, row in enumerate(observer.run(state, samples)):
        assert np.array_equal(row.lower, batch.lower[k])
        assert np.array_equal(row.upper, batch.upper[k])
        assert row.status == batch.status[k] == "ok"
    assert (batch.lower <= run.block("x")).all()
    assert (run.block("x") <= batch.upper).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_rows_stand_on_the_grid(kind: str, start: float) -> None:
    """A stamp between two steps is refused; one that is off by its rounding is none."""
    _, observer = observer_of(turning(kind), kind)
    state = observer.init(start, lower=[-1, -1], upper=[1, 1])
    state, _ = observer.step(state, Sample(start, y=[0.0], u=[0.0]))
    after, row = observer.step(state, Sample(start + 3 * 0.1, y=[0.0]))
    apart = f"{start + 3 * 0.1 - start:.9g}"  # two samples are missing
    assert row.status == f"time {apart} since the last sample exceeds 0.1"
    _, row = observer.step(state, Sample(start + 0.1))
    assert row.status == "missing sample"
    with pytest.raises(ValueError, match=r"must be a multiple of flow.dt = 0.1"):
        observer.step(after, Sample(start + 0.35, y=[0.0]))
    coarse = observer.init(1.7e18, lower=[0, 0], upper=[1, 1])
    with pytest.raises(ValueError, match="too coarse to count steps"):
        observer.step(coarse, Sample(1.7e18, u=[0.0]))


@pytest.mark.parametrize("kind", KINDS)
def test_a_long_gap_is_that_many_steps(kind: str) -> None:
    """The width after a row of 100 steps: of the powers of A, for the box of those of |A|."""
    problem, observer = observer_of(turning(kind), kind)
    state = observer.init(0.0, lower=[-1, -1], upper=[1, 1])
    state, _ = observer.step(state, Sample(0.0, u=[0.0]))
    _, row = observer.step(state, Sample(10.0))
    flow = problem.plant.flow
    A = np.abs(flow.A) if kind == "interval" else flow.A
    width, power = np.zeros(2), np.eye(2)
    for _ in range(100):
        width, power = width + np.abs(power) @ (flow.upper - flow.lower), A @ power
    width += np.abs(power) @ [2, 2]
    ratio = (row.upper - row.lower) / width
    assert (ratio >= 1).all()
    assert (ratio <= (1 + 1e-9 if kind == "interval" else 1.1)).all()


def test_bounds_of_a_bounded_input_of_bounded_rate() -> None:
    """Their d is that of each step, and changes by rate dt at most."""
    body = two_rates(2, 5)
    flow = body["flow"] | {"D": [[0], [0.1], [0]]}
    flow["d_bounds"] = {"lower": [0], "upper": [2], "rate": [0.5]}
    problem, observer = observer_of({**body, "flow": flow}, "set_membership")
    run = simulate(problem.plant, until=20.0, rng=np.random.default_rng(4))
    state = observer.init(0.0, lower=[-1] * 3, upper=[2] * 3)
    widths = []
    for row, d in zip(
        observer.run(state, rows_of(run.t, run.block("y"))), run.block("d"), strict=True
    ):
        assert row.status == "ok"
        assert (row.d_bounds[0] <= d).all()
        assert (d <= row.d_bounds[1]).all()
        widths.append(float(row.d_bounds[1, 0] - row.d_bounds[0, 0]))
    assert np.median(widths[50:]) < 1.9
