"""Unknown-input observers in discrete time: designed, proved, executed; twins, refusals."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.time_budget import UNLIMITED
from obsdesign import workflow
from obsdesign.data.simulation import simulate
from obsdesign.errors import DoesNotApply
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample, rows_of
from obsdesign.studies.check.which_kinds import check_kinds


def body(output: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    """Three states, one unknown input, two outputs."""
    flow = {
        "dt": 0.1, "A": [[0.9, 0.2, 0], [-0.1, 1.05, 0.3], [0, 0, 1.01]],
        "B": [[0], [0], [1]], "D": [[1], [0.5], [0]], **more.pop("flow", {}),
    }  # fmt: skip
    output = {"C": [[1, 0, 0], [0, 1, 0]], "noise_bound": 0.01, **(output or {})}
    observer = {"kind": "unknown_input", **more.pop("observer", {})}
    return {"flow": flow, "output": output, "observer": observer, **more}


SQUARE = {"flow": {"dt": 0.5, "A": [[0.5, 0.2], [0.1, 0.4]], "B": None, "D": [[1], [0]]}}


@pytest.mark.parametrize("units", [1.0, 1e6])
def test_state_and_input_are_found(units: float) -> None:
    """Without noise both errors vanish, whatever d does; batches equal streams."""
    C = [[units, 0, 0], [0, 1, 0]]
    problem = Problem.from_dict(body({"C": C, "noise_bound": [0.01 * units, 0.01]}))
    design = obsdesign.design(problem)
    again = obsdesign.verify(design)
    assert {claim.verdict for claim in again.claims} == {"proved"}
    assert [claim.id for claim in again.claims][:3] == ["consistent", "rank", "zeros"]
    rng = np.random.default_rng(3)
    x, d = np.array([1.0, -1.0, 0.5]), rng.normal(size=200) * 10
    flow, C = problem.plant.flow, np.array(C)
    rows, truth = [], []
    for k in range(200):
        if k:
            x = flow.A @ x + flow.D[:, 0] * d[k]
        truth.append(x)
        rows.append(C @ x)
    t = np.round(0.1 * np.arange(200), 9)
    observer = from_design(design)
    batch = observer.run_batch(t, np.array(rows))
    assert set(batch.status) == {"ok"}
    size = np.abs(truth).max()
    np.testing.assert_allclose(batch.x[120:], truth[120:], atol=1e-7 * size)
    np.testing.assert_allclose(batch.d[120:, 0], d[120:], atol=1e-7 * size)
    assert np.isnan(batch.d[0]).all()
    stream = list(observer.run(observer.init(0.0), rows_of(t, np.array(rows))))
    assert all(np.array_equal(row.x, own) for row, own in zip(stream, batch.x, strict=True))


def test_noise_and_disturbance_leave_errors_bounded() -> None:
    disturbance = {"lower": [-0.01, 0, 0], "upper": [0.01, 0, 0]}
    problem = Problem.from_dict(body(flow={"disturbance": disturbance}))
    run = simulate(problem.plant, until=40.0, rng=np.random.default_rng(2))
    observer = from_design(obsdesign.design(problem))
    batch = observer.run_batch(run.t, run.block("y"), run.block("u"))
    late = slice(100, None)
    assert np.abs(batch.x - run.block("x"))[late].max() < 1.0
    assert np.abs(batch.d - run.block("d"))[late].max() < 1.0


def test_a_square_plant_has_one_gain_and_its_zeros() -> None:
    """As many inputs as outputs: (I - M C) A has the invariant zeros, which decide."""
    decaying = {**SQUARE["flow"], "B": [[0], [0]]}
    one = {"C": [[1, 0]], "noise_bound": 0.1}
    claims = {
        c.id: c for c in workflow.investigate(Problem.from_dict(body(one, flow=decaying))).claims
    }
    assert claims["zeros"].evidence["zeros"] == [[pytest.approx(0.4), 0.0]]
    assert claims["step_stability"].verdict == "proved"
    growing = {**decaying, "A": [[0.5, 0.2], [0.1, 1.0]]}
    outcome = workflow.investigate(Problem.from_dict(body(one, flow=growing)))
    assert outcome.verdict == "refuted"
    reasons = [c.evidence["witness"]["reason"] for c in outcome.claims if c.verdict == "refuted"]
    assert "an invariant zero of modulus 1" in reasons[0]


@pytest.mark.parametrize("zero", [1.25, -1.0, 0.75])
@pytest.mark.parametrize("outputs", [[[0, 1]], [[0, 1], [0, 2]], [[0, 1], [0, 2], [0, 1]]])
def test_zeros_decide_whatever_the_gains(zero: float, outputs: list[list[float]]) -> None:
    """x1 is hidden from every output: more of them than inputs leave gains, which do not help."""
    flow = {"A": [[zero, 0], [0, 0.5]], "D": [[0], [1]], "B": [[0], [0]]}
    problem = Problem.from_dict(body({"C": outputs, "noise_bound": 0.1}, flow=flow))
    outcome = workflow.investigate(problem)
    answers = check_kinds(problem, ("unknown_input",), lambda done, total: None, UNLIMITED)
    checked = answers["unknown_input"].verdict
    zeros = next(claim for claim in outcome.claims if claim.id == "zeros")
    if abs(zero) < 1:
        assert zeros.verdict == outcome.verdict == checked == "proved"
        return
    assert zeros.verdict == outcome.verdict == checked == "refuted"
    assert f"zero of modulus {abs(zero):g}" in zeros.evidence["witness"]["reason"]


def test_an_input_that_does_not_show_is_refuted() -> None:
    outcome = workflow.investigate(Problem.from_dict(body(flow={"D": [[0], [0], [1]]})))
    assert outcome.verdict == "refuted"
    claim = next(c for c in outcome.claims if c.verdict == "refuted")
    assert claim.id == "rank"
    assert "does not show in y one step later" in claim.evidence["witness"]["reason"]


def test_forged_gains_are_not_confirmed() -> None:
    design = obsdesign.design(Problem.from_dict(body()))
    for key, factor in (("M", 1 + 1e-6), ("N", 1 + 1e-6), ("D", 2.0), ("dt", 2.0)):
        gains = copy.deepcopy(dict(design.gains))
        gains[key] = gains[key] * factor
        assert obsdesign.verify(replace(design, gains=gains)).verdict != "proved"


def test_missing_samples() -> None:
    observer = from_design(obsdesign.design(Problem.from_dict(body())))
    state, row = observer.step(observer.init(0.0), Sample(0.0, y=[0.0, 0.0]))
    assert row.status == "ok"
    _, row = observer.step(state, Sample(0.1))
    assert row.status == "missing sample"
    assert np.isnan(row.d).all()
    _, row = observer.step(state, Sample(0.2, y=[1.0, 0.0]))
    assert row.status == "missing sample"
    assert np.isnan(row.d).all()
    _, row = observer.step(state, Sample(0.1, y=[1.0, 0.5]))
    assert row.status == "ok"
    assert row.d[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("plain", "message"),
    [
        (body(observer={"differentiator": "cell"}), "observer.differentiator is not available"),
        (body({"measured": "periodic", "period": 0.2}), "output.period must be flow.dt"),
        (body(jump={"dwell_time": [1, 2]}), r"\[jump\] is refused by kind 'unknown_input'"),
        (body(flow={"D": None}), "flow.D is required"),
    ],
)
def test_refusals(plain: dict[str, Any], message: str) -> None:
    plain["flow"] = {key: value for key, value in plain["flow"].items() if value is not None}
    with pytest.raises(DoesNotApply, match=message) as refusal:
        workflow.investigate(Problem.from_dict(plain))
    assert "\n" not in str(refusal.value)
