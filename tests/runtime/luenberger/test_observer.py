"""The streaming form of the point observer: flow, jumps, missing samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import obsdesign
from obsdesign.data.simulation import simulate
from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Jump, Plant
from obsdesign.runtime import Sample, from_design
from tests.systems.luenberger import problem


def test_the_estimate_converges_across_jumps() -> None:
    stated = problem(flow__B=[[0], [1], [0]], jump__E=[[0], [0], [1]],
                    flow__disturbance={"lower": [0.5, 0, -1], "upper": [0.5, 0, -1]})  # fmt: skip
    observer = from_design(obsdesign.design(stated))
    record = simulate(stated.plant, until=40.0, step=0.01, rng=np.random.default_rng(1))
    batch = observer.run_batch(
        record.t, record.block("y"), record.block("u"), np.nan_to_num(record.block("w")),
        record.columns["jump"], x=[5, 5, 5],
    )  # fmt: skip
    assert set(batch.status) == {"ok"}
    error = np.abs(batch.x - record.block("x")).max(axis=1)
    scale = np.abs(record.block("x")).max()
    assert error[0] > 1
    # linear interpolation of y errs by O(h^2) between samples
    assert error[-200:].max() < 1e-3 * scale


def test_the_flow_solves_its_differential_equation() -> None:
    A, C = np.array([[0.0, 1], [-2, -0.3]]), np.array([[1.0, 0.5]])
    L, B = np.array([[1.5], [-0.4]]), np.array([[0.3], [1.0]])
    plant = Plant(Flow(A, B=B, lower=[0.1, 0.2], upper=[0.3, 0.2]), None, Output(C))
    gains = {"kind": "luenberger", "gains": {"L": L.tolist()}}
    stated = obsdesign.Problem(flow=plant.flow, output=plant.output, observer=gains)
    observer = from_design(obsdesign.design(stated))
    state = observer.init(0.0, x=[1, -1])
    state, _ = observer.step(state, Sample(0.0, y=[0.7], u=[2.0]))
    _, estimate = observer.step(state, Sample(0.5, y=[-0.4], u=[9.0]))

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        y = np.array([0.7 + (-0.4 - 0.7) * t / 0.5])
        return A @ x + L @ (y - C @ x) + B @ [2.0] + [0.2, 0.2]

    expected = solve_ivp(rate, (0, 0.5), [1, -1], rtol=1e-11, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(estimate.x, expected, atol=1e-9)


@pytest.mark.parametrize("when", ["before", "after", "none"])
def test_the_jump_uses_the_measurement_as_it_was_taken(when: str) -> None:
    G, C, M = np.array([[1.0, 0.5], [0, 0.8]]), np.array([[1.0, 0]]), np.array([[0.3], [0.7]])
    M = 0 * M if when == "none" else M
    stated = obsdesign.Problem(
        flow=Flow(-np.eye(2)), output=Output(C, jump_measurement=when),
        jump=Jump(G, lower=[0.1, 0.1], upper=[0.3, 0.1], dwell_time=(1.0, 2.0)),
        observer={"kind": "luenberger", "gains": {"L": [[0], [0]], "M": M.tolist()}},
    )  # fmt: skip
    observer = from_design(obsdesign.design(stated))
    x, y = np.array([1.0, 2.0]), np.array([1.5])
    _, estimate = observer.step(observer.init(0.0, x=x), Sample(0.0, y=y, jump=True))
    after = G @ x + [0.2, 0.1]
    expected = {
        "before": after + M @ (y - C @ x), "after": after + M @ (y - C @ after), "none": after,
    }[when]  # fmt: skip
    np.testing.assert_allclose(estimate.x, expected)


def test_stream_and_batch_agree_and_missing_samples_are_said() -> None:
    observer = from_design(obsdesign.design(problem()))
    rng = np.random.default_rng(4)
    t = np.sort(rng.uniform(0, 5, 40))
    y = rng.standard_normal((40, 2))
    y[7:9] = np.nan
    jump = np.zeros(40, bool)
    jump[20] = True
    batch = observer.run_batch(t, y, jump=jump, x=[1, 2, 3])
    state, loop = observer.init(t[0], x=[1, 2, 3]), []
    for k in range(40):
        state, estimate = observer.step(state, Sample(t[k], y=y[k], jump=bool(jump[k])))
        loop.append(estimate)
    assert np.array_equal(batch.x, [e.x for e in loop])
    assert batch.status == tuple(e.status for e in loop)
    assert [k for k, s in enumerate(batch.status) if s.startswith("missing sample")] == [7, 8]
