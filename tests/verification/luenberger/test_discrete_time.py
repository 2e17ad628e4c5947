"""Point observers in discrete time: designed, proved, executed; twins, refusals."""

from __future__ import annotations

import copy
from dataclasses import replace
from decimal import Decimal, localcontext
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign import workflow
from obsdesign.analysis.discrete_error import error_maps
from obsdesign.data.simulation import simulate
from obsdesign.equations.luenberger.gains import StepGains, step_entries
from obsdesign.errors import DoesNotApply
from obsdesign.interop import control_estimator
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample, rows_of

A = [[1.02, 0.2], [-0.2, 0.9]]
KICK = {"G": [[1.5, 0], [0.3, 1]], "dwell_time": [0.5, 0.8]}


def body(output: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    observer = {"kind": "luenberger", **more.pop("observer", {})}
    flow = {"dt": 0.1, "A": A, "B": [[0], [1]], **more.pop("flow", {})}
    return {"flow": flow, "output": {"C": [[1, 0]], **(output or {})}, "observer": observer, **more}


SERVED = [
    body(),
    body({"measured": "periodic", "period": 0.3}, observer={"decay_rate": 1.0}),
    body(jump=KICK),
    body(jump={**KICK, "dwell_time": [0.5, 0.5]}),
    body({"jump_measurement": "after"}, jump={**KICK, "dwell_time": [0.1, "inf"]}),
    body({"jump_measurement": "none"}, jump={**KICK, "dwell_time": [0.3, 0.4]}),
    body({"measured": "at_jumps"}, jump=KICK),
]


@pytest.mark.parametrize("plain", SERVED, ids=range(len(SERVED)))
def test_gains_are_found_proved_and_run(plain: dict[str, Any]) -> None:
    """Without disturbance the estimates tend to the state; batches equal streams."""
    problem = Problem.from_dict(plain)
    design = obsdesign.design(problem)
    again = obsdesign.verify(design)
    assert {claim.verdict for claim in again.claims} == {"proved"}
    run = simulate(problem.plant, until=30.0, disturbance="zero", rng=np.random.default_rng(3))
    jump = None if run.happened is None else run.happened[:, 0]
    observer = from_design(design)
    batch = observer.run_batch(run.t, run.block("y"), run.block("u"), jump=jump)
    assert set(batch.status) == {"ok"}
    error = np.abs(batch.x - run.block("x")).max(axis=1)
    assert error[-1] < 1e-4 * error[0]
    rows = observer.run(
        observer.init(0.0), rows_of(run.t, run.block("y"), run.block("u"), jump=jump)
    )
    assert all(np.array_equal(row.x, x) for row, x in zip(rows, batch.x, strict=True))


def test_the_error_of_a_row_is_that_of_the_claim() -> None:
    """e+ = (I - L C) A^3 e from sample to sample, and M in place of L at an event."""
    plain = body({"measured": "periodic", "period": 0.3}, flow={"B": [[0], [0]]})
    gains = obsdesign.design(Problem.from_dict(plain)).gains
    observer = from_design(obsdesign.design(Problem.from_dict(plain)))
    L, C, x = gains["L"], gains["C"], np.array([1.0, -2.0])
    state = observer.init(0.0, x=[0, 0])
    state, row = observer.step(state, Sample(0.0, y=C @ x))
    error = (np.eye(2) - L @ C) @ x
    np.testing.assert_allclose(x - row.x, error, rtol=1e-12)
    x = np.linalg.matrix_power(gains["A"], 3) @ x
    state, row = observer.step(state, Sample(0.3, y=C @ x))
    error = (np.eye(2) - L @ C) @ np.linalg.matrix_power(gains["A"], 3) @ error
    np.testing.assert_allclose(x - row.x, error, rtol=1e-12)


def test_twins_are_not_proved() -> None:
    """A hidden mode at 1 refutes every gain; a gain that destabilises, and events too fast."""
    hidden = body({"C": [[0, 1]]}, flow={"A": [[1, 0.2], [0, 0.5]]})
    outcome = workflow.investigate(Problem.from_dict(hidden))
    assert outcome.verdict == "refuted"
    given = body(observer={"gains": {"L": [[3], [0]]}})
    claims = {c.id: c for c in workflow.investigate(Problem.from_dict(given)).claims}
    assert claims["step_stability"].verdict == "refuted"
    assert "spectral radius" in claims["step_stability"].evidence["witness"]["reason"]


def test_dwell_times_that_decay_alone_and_grow_in_turns_are_refuted() -> None:
    """G A and G A^2 decay, their product grows: refuted by the cycle; half of G is proved."""
    A, G = np.diag([0.25, 1.5]), np.array([[0, 4], [0.5, 0]])
    maps = [G @ A, G @ A @ A]
    assert max(np.abs(np.linalg.eigvals(own)).max() for own in maps) < 0.9
    assert np.abs(np.linalg.eigvals(maps[0] @ maps[1])).max() > 1.1
    for scale, verdict in ((1.0, "refuted"), (0.5, "proved")):
        turns = body(
            {"measured": "at_jumps"}, flow={"A": A.tolist()},
            jump={"G": (scale * G).tolist(), "dwell_time": [0.1, 0.2]},
            observer={"gains": {"L": [[0], [0]], "M": [[0], [0]]}},
        )  # fmt: skip
        claims = {c.id: c for c in workflow.investigate(Problem.from_dict(turns)).claims}
        assert claims["step_stability"].verdict == verdict


def test_forged_gains_are_not_confirmed() -> None:
    design = obsdesign.design(Problem.from_dict(body(jump=KICK)))
    for key, value in (("dt", 0.05), ("period", 0.2), ("L", [[5.0], [0.0]])):
        gains = copy.deepcopy(dict(design.gains))
        gains[key] = np.array(value) if key == "L" else value
        assert obsdesign.verify(replace(design, gains=gains)).verdict != "proved"


@pytest.mark.parametrize(
    ("plain", "message"),
    [
        (body(observer={"poles": [0.1, 0.2]}), "observer.poles is not available with flow.dt"),
        (body({"measured": "periodic", "period": 0.2}, jump=KICK), "must be flow.dt = 0.1"),
        (body(jump={**KICK, "dwell_time": [0.5, 8.0]}), "must lie between 1 and 60 steps"),
        (body(jump={**KICK, "dwell_time": [0, 0.5]}), "must lie between 1 and 60 steps"),
        (body({"measured": "periodic", "period": 100.0}), "must be at most 400 steps"),
    ],
)
def test_refusals(plain: dict[str, Any], message: str) -> None:
    with pytest.raises(DoesNotApply, match=message) as refusal:
        workflow.investigate(Problem.from_dict(plain))
    assert "\n" not in str(refusal.value)


def test_rows_that_do_not_keep_the_period() -> None:
    plain = body({"measured": "periodic", "period": 0.2})
    observer = from_design(obsdesign.design(Problem.from_dict(plain)))
    state, _ = observer.step(observer.init(0.0), Sample(0.0, y=[1.0]))
    between, row = observer.step(state, Sample(0.1, y=[1.0]))
    assert row.status == "sample off the period is not used"
    _, row = observer.step(between, Sample(0.2, y=[1.0]))
    assert row.status == "ok"
    _, row = observer.step(between, Sample(0.2))
    assert row.status == "missing sample"
    _, row = observer.step(state, Sample(0.4, y=[1.0]))
    assert row.status == "time 0.4 since the last sample exceeds 0.2"


def test_the_estimator_of_python_control_keeps_the_step() -> None:
    control = pytest.importorskip("control", reason="the extra `interop` is not installed")
    problem = Problem.from_dict(body())
    design = obsdesign.design(problem)
    system = control_estimator(design)
    assert system.dt == 0.1
    run = simulate(problem.plant, until=3.0, rng=np.random.default_rng(1))
    y, u = run.block("y"), run.block("u")
    _, x = control.forced_response(system, run.t, np.hstack([y, u]).T)
    batch = from_design(design).run_batch(run.t, y, u)
    np.testing.assert_allclose(x.T, batch.x, atol=1e-10)


@pytest.mark.parametrize(("rate", "dt"), [(0.1, 0.1), (1 / 3, 0.1), (0.7, 99.0), (0.011, 3600.0)])
def test_the_growth_of_a_decay_rate_is_rounded_up(rate: float, dt: float) -> None:
    """e^(rate dt) of the two floats: their product, rounded, is off by more than e^x above 32."""
    plain = body(flow={"dt": dt, "A": [[1, 0], [0, 1]]}, observer={"decay_rate": rate})
    problem = Problem.from_dict(plain)
    n, p = 2, 1
    gains = StepGains(**step_entries(problem.plant), L=np.zeros((n, p)), M=np.zeros((n, p)))
    growth = error_maps(problem, gains, rate)[0, 0]
    with localcontext() as context:
        context.prec = 60
        true = (Decimal(rate) * Decimal(dt)).exp()
        given = Decimal(int(growth.p)) / Decimal(int(growth.q))
        assert true <= given <= true * (1 + Decimal(2) ** -50)


def test_decay_rates_beyond_floats_are_refused() -> None:
    """e^(rate dt) would overflow; the twin at the limit is decided."""
    still = {"dt": 3600, "A": [[0, 0], [0, 0]]}
    for rate in (0.5, 1e150):
        with pytest.raises(DoesNotApply, match=r"decay_rate times flow\.dt must be at most 100"):
            obsdesign.design(Problem.from_dict(body(flow=still, observer={"decay_rate": rate})))
    slow = Problem.from_dict(body(flow=still, observer={"decay_rate": 100 / 3600}))
    assert {claim.verdict for claim in obsdesign.design(slow).claims} == {"proved"}
