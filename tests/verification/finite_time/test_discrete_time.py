"""Finite-time estimation in discrete time: designed, proved, executed; twins, refusals."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign import workflow
from obsdesign.data.simulation import simulate
from obsdesign.equations.finite_time.steps import StepWindowGains, error_maps
from obsdesign.errors import DoesNotApply
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample, rows_of

A = [[1.02, 0.2], [-0.2, 0.9]]


def body(output: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    observer = {"kind": "finite_time", **more.pop("observer", {})}
    flow = {
        "dt": 0.1, "A": A, "B": [[0], [1]],
        "disturbance": {"lower": [-0.01, 0], "upper": [0.01, 0.04]},
        **more.pop("flow", {}),
    }  # fmt: skip
    output = {"C": [[1, 0]], "noise_bound": [[-0.02, 0.06]], **(output or {})}
    return {"flow": flow, "output": output, "observer": observer, **more}


SERVED = [
    body(),
    body({"measured": "periodic", "period": 0.3}),
    body({"C": [[1, 0], [1, 1]], "noise_bound": [0.1, 0.0]}, observer={"window": 0.5}),
    body(jump={"G": [[1.5, 0], [0.3, 1]], "dwell_time": [0.5, 0.8]}),
    body({"jump_measurement": "after"}, jump={"G": [[0, 1], [1, 0]], "dwell_time": [0.8, 1.2]}),
    body({"jump_measurement": "none"}, jump={"G": [[0, 1], [1, 0]], "dwell_time": [0.8, 1.2]}),
]


@pytest.mark.parametrize("plain", SERVED, ids=range(len(SERVED)))
@pytest.mark.parametrize("disturbance", ["zero", "extreme", "random"])
def test_the_state_is_as_near_as_claimed(plain: dict[str, Any], disturbance: str) -> None:
    problem = Problem.from_dict(plain)
    outcome = workflow.investigate(problem)
    assert outcome.verdict == "proved"
    assert outcome.design is not None
    assert obsdesign.verify(outcome.design).verdict == "proved"
    radius = {c.id: c.evidence for c in outcome.claims}["error_radius"]["largest_error"]
    rng = np.random.default_rng(5)
    run = simulate(problem.plant, until=30.0, disturbance=disturbance, rng=rng)
    jump = None if run.happened is None else run.happened[:, 0]
    observer = from_design(outcome.design)
    batch = observer.run_batch(run.t, run.block("y"), run.block("u"), jump=jump)
    full = np.array([status == "ok" for status in batch.status])
    # between samples the plant predicts
    at_sample = full & np.isfinite(run.block("y")[:, 0])
    at_sample &= True if jump is None else ~jump
    assert at_sample.sum() > 20
    assert set(batch.status) <= {"ok", "window not full"}
    error = np.abs(batch.x - run.block("x"))[at_sample]
    limit = 1e-10 if disturbance == "zero" else np.array(radius) * (1 + 1e-9)
    assert (error <= limit).all()
    rows = observer.run(
        observer.init(0.0), rows_of(run.t, run.block("y"), run.block("u"), jump=jump)
    )
    assert all(np.array_equal(row.x, x) for row, x in zip(rows, batch.x, strict=True))


def test_the_largest_error_is_reached() -> None:
    """Disturbances and noise with the signs of their factors: the error is the radius."""
    design = obsdesign.design(Problem.from_dict(body(flow={"B": [[0], [0]]})))
    gains = StepWindowGains.from_document(design.gains)
    claims = {claim.id: claim.evidence for claim in design.claims}
    maps = error_maps(gains.A, gains.C, gains.of_samples, 1)
    ends = gains.flow_lower, gains.flow_upper
    for i, radius in enumerate(claims["error_radius"]["largest_error"]):
        x, observer = np.array([0.3, -0.2]), from_design(design)
        state = observer.init(0.0)
        for k, own in enumerate(gains.of_samples):
            if k:
                x = gains.A @ x + np.where(maps[k][i] > 0, ends[1], ends[0])
            noise = np.where(own[i] > 0, 0.06, -0.02)
            state, row = observer.step(state, Sample(round(0.1 * k, 9), y=gains.C @ x + noise))
        assert row.status == "ok"
        assert row.x[i] - x[i] == pytest.approx(-(x[i] - row.x[i]))
        assert abs(row.x[i] - x[i]) == pytest.approx(radius, rel=1e-9)


def test_twins_are_not_proved() -> None:
    """One sample of two states, a hidden state, gains that were changed."""
    short = workflow.investigate(Problem.from_dict(body(observer={"window": 0.1})))
    assert short.verdict == "refuted"
    hidden = body({"C": [[0, 1]]}, flow={"A": [[1, 0.2], [0, 0.5]]})
    outcome = workflow.investigate(Problem.from_dict(hidden))
    assert outcome.verdict == "refuted"
    design = obsdesign.design(Problem.from_dict(body()))
    for key in ("window_gain", "dt", "period", "samples"):
        gains = copy.deepcopy(dict(design.gains))
        if key == "window_gain":
            gains[key] = gains[key] * (1 + 1e-6)
        elif key == "samples":
            gains[key] = gains[key] + 1
        else:
            gains[key] = 2 * gains[key]
        assert obsdesign.verify(replace(design, gains=gains)).verdict != "proved"
    claims = [
        replace(c, evidence={"largest_error": [0.01, 0.01]}) if c.id == "error_radius" else c
        for c in design.claims
    ]
    assert obsdesign.verify(replace(design, claims=tuple(claims))).verdict != "proved"


def test_the_error_changes_with_the_units() -> None:
    units = np.array([0.25, 8.0])
    plain = body(observer={"window": 0.6})
    scaled = copy.deepcopy(plain)
    flow = scaled["flow"]
    flow["A"] = (np.array(A) * units[:, None] / units).tolist()
    flow["B"] = (np.array(flow["B"]) * units[:, None]).tolist()
    for end in ("lower", "upper"):
        flow["disturbance"][end] = (np.array(flow["disturbance"][end]) * units).tolist()
    scaled["output"]["C"] = (np.array([[1, 0]]) / units).tolist()
    errors = [
        {c.id: c.evidence for c in workflow.investigate(Problem.from_dict(one)).claims}[
            "error_radius"
        ]["largest_error"]
        for one in (plain, scaled)
    ]
    np.testing.assert_allclose(errors[1], np.array(errors[0]) * units, rtol=1e-6)


def test_rows_that_do_not_keep_the_period() -> None:
    plain = body({"measured": "periodic", "period": 0.2}, observer={"window": 0.4})
    observer = from_design(obsdesign.design(Problem.from_dict(plain)))
    state, row = observer.step(observer.init(0.0), Sample(0.0, y=[1.0]))
    assert row.status == "window not full"
    between, row = observer.step(state, Sample(0.1, y=[1.0]))
    assert row.status == "sample off the period is not used"
    state, row = observer.step(between, Sample(0.2, y=[1.0]))
    assert row.status == "ok"
    _, row = observer.step(state, Sample(0.3))
    assert row.status == "ok"
    after, row = observer.step(state, Sample(0.4))
    assert row.status == "missing sample"
    after, row = observer.step(after, Sample(0.6, y=[1.0]))
    assert row.status == "window not full"
    _, row = observer.step(after, Sample(0.8, y=[1.0]))
    assert row.status == "ok"
    _, row = observer.step(state, Sample(1.0, y=[1.0]))
    assert row.status == "missing sample"


@pytest.mark.parametrize(
    ("plain", "message"),
    [
        (body(observer={"method": "minimax"}), "observer.method must be least_squares"),
        (body(observer={"objective": "least_noise"}), "observer.objective is not available"),
        (body(observer={"gains": {"L": [[0], [0]]}}), "observer.gains.L is not available"),
        (body(observer={"window": 0.25}), "observer.window must be a multiple"),
        (body(observer={"window": 60.0}), "a window of at most 400 steps"),
        (body({"measured": "at_jumps"}, jump={"dwell_time": [0.5, 1]}), "must be periodic"),
    ],
)
def test_refusals(plain: dict[str, Any], message: str) -> None:
    with pytest.raises(DoesNotApply, match=message) as refusal:
        workflow.investigate(Problem.from_dict(plain))
    assert "\n" not in str(refusal.value)
