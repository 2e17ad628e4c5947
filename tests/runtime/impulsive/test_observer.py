"""The impulsive observer at run time: window, inputs, gaps, statuses; streams and batches."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import obsdesign
from obsdesign.data.simulation import simulate
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.impulsive.observer import ImpulsiveObserver
from tests.systems.impulsive import DOUBLE, SPLINE, chain, first, impulsive_problem, plant_gains

# --- exactness, inputs, gaps --------------------------------------------------------------------


def full_problem(**options: Any) -> Any:
    """Everything at once: known inputs between and at jumps, bounds with a middle."""
    rng = np.random.default_rng(6)
    body = {
        "flow": {"A": (0.3 * rng.standard_normal((3, 3))).tolist(), "B": [[1], [0], [2]],
                 "disturbance": {"lower": [0, 0, 1], "upper": [0, 0.5, 1]}},
        "jump": {"G": rng.standard_normal((3, 3)).tolist(), "E": [[0], [1], [0]], "dwell_time": [0.3, 0.9],
                 "disturbance": {"lower": [0.1, 0, 0], "upper": [0.1, 0.2, 0]}},
        "output": {"C": [[1, 0, 0], [0, 1, 1]], "measured": "at_jumps"},
        "observer": {"kind": "impulsive", **options},
    }  # fmt: skip
    return obsdesign.Problem.from_dict(body)


@pytest.mark.parametrize("when", ["before", "after"])
def test_known_inputs_are_followed_exactly(when: str) -> None:
    body = full_problem().to_dict()
    body["output"]["jump_measurement"] = when
    problem = obsdesign.Problem.from_dict(body)
    design = obsdesign.design(problem)
    record = simulate(
        problem.plant,
        until=12.0,
        step=0.11,
        disturbance="zero",
        rng=np.random.default_rng(1),
        initial=[1, -2, 3],
    )
    observer: Any = from_design(design)
    batch = observer.run_batch(
        record.t,
        record.block("y"),
        record.block("u"),
        np.nan_to_num(record.block("w")),
        record.columns["jump"],
        x=[0, 0, 0],
    )
    error = np.abs(batch.x - record.block("x")).max(axis=1)
    impulses = np.flatnonzero(record.columns["jump"])
    assert len(impulses) > 12
    assert error[impulses[12] :].max() < 1e-12 * np.abs(record.block("x")).max()
    assert error[0] > 0.1
    assert set(batch.status) == {"ok"}


def spline_run(keep: Any, strategy: str = "auto", window: int | None = None) -> list[Any]:
    """Estimates minus truth over random impulses; y is left out where keep says no."""
    options = {"strategy": strategy} | ({} if window is None else {"window": window})
    plant = SPLINE if strategy != "full" else (chain(3), np.eye(3), first(3))
    design = obsdesign.design(impulsive_problem(plant, [0.1, 0.8], **options))
    observer: Any = from_design(design)
    A, G, C = plant
    rng = np.random.default_rng(3)
    x, t, results = rng.standard_normal(len(A)), 0.0, []
    state = observer.init(t=0.0)
    for k in range(14):
        spacing = rng.uniform(0.1, 0.4)
        x, t = expm(A * spacing) @ x, t + spacing
        state, estimate = observer.step(state, Sample(t, y=C @ x if keep(k) else None, jump=True))
        x = G @ x
        results.append((estimate.status, float(np.abs(estimate.x - x).max())))
    return results


@pytest.mark.parametrize("strategy", ["full", "compressed", "subspace"])
def test_an_impulse_without_measurement_costs_one_impulse(strategy: str) -> None:
    results = spline_run(lambda k: k not in (1, 7), strategy)
    statuses = [status for status, _ in results]
    assert statuses[0] == "ok"
    assert statuses[1] == "missing sample"
    assert statuses[2] == "window contains a missing sample or an uncertified spacing"
    assert statuses[4] == "window contains a missing sample or an uncertified spacing"
    assert statuses[5] == "ok"
    # three measurements still determine everything: dead-beat one impulse later
    assert max(error for _, error in results[3:]) < 1e-8
    assert results[1][1] > 1e-3


def test_estimates_between_impulses_wait_for_none() -> None:
    design = obsdesign.design(impulsive_problem(DOUBLE, [0.5, 1.5]))
    observer: Any = from_design(design)
    state = observer.init(t=0.0, x=[1.0, 2.0])
    state, estimate = observer.step(state, Sample(0.25))
    assert (estimate.status, estimate.x.tolist()) == ("ok", [1.5, 2.0])
    # a measurement that is not at an impulse is not used
    state, estimate = observer.step(state, Sample(0.5, y=[99.0]))
    assert estimate.x.tolist() == [2.0, 2.0]


def test_spacings_outside_the_range_are_flagged_until_they_leave_the_window() -> None:
    design = obsdesign.design(impulsive_problem(DOUBLE, [0.5, 1.5], window=3))
    observer: Any = from_design(design)
    times = [0.2, 1.2, 1.4, 2.4, 3.4, 4.4, 6.4]
    batch = observer.run_batch(times, np.zeros((7, 1)), jump=np.ones(7), x=[1.0, 1.0])
    assert batch.status == (
        "ok",  # the time to the first impulse is no spacing
        "ok",
        "dwell time 0.2 below 0.5",
        "window contains a missing sample or an uncertified spacing",
        "window contains a missing sample or an uncertified spacing",
        "window contains a missing sample or an uncertified spacing",
        "dwell time 2 above 1.5",
    )
    late = observer.run_batch([0.2, 1.0, 1.8, 2.2], None, jump=[1, 0, 0, 0], x=[1.0, 1.0])
    assert late.status[1:] == ("ok", "dwell time 1.6 above 1.5", "dwell time 2 above 1.5")


def test_bad_conditions_are_told() -> None:
    # a window much longer than the plant remembers
    A = np.diag([0.0, -30.0])
    gains = plant_gains(A, np.eye(2), np.array([[1.0, 1.0]]), window=6, alpha=1.01)
    observer = ImpulsiveObserver.from_gains(gains)
    state = observer.init(t=0.0)
    statuses = []
    for t in (0.1, 0.9, 1.7, 2.5, 3.3, 4.1):
        state, estimate = observer.step(state, Sample(t, y=[1.0], jump=True))
        statuses.append(estimate.status)
    assert statuses[-1] == "ok"
    hidden = plant_gains(np.zeros((2, 2)), np.eye(2), np.array([[1.0, 0.0]]), window=2)
    observer = ImpulsiveObserver.from_gains(hidden)
    state, estimate = observer.step(observer.init(t=0.0, x=[1, 1]), Sample(0.5, y=[5.0], jump=True))
    assert estimate.status == "singular window: no correction"
    assert estimate.x.tolist() == [1.0, 1.0]


def test_nearly_coinciding_impulses_are_ill_conditioned() -> None:
    gains = plant_gains(chain(2), np.eye(2), first(2), window=2)
    observer = ImpulsiveObserver.from_gains(gains)
    state, _ = observer.step(observer.init(t=0.0), Sample(1.0, y=[0.0], jump=True))
    state, estimate = observer.step(state, Sample(1.0 + 1e-9, y=[0.0], jump=True))
    assert "ill-conditioned window" in estimate.status


# --- laws ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("strategy", ["full", "compressed", "subspace", "quadratic"])
def test_stream_is_batch_and_survives_the_file(strategy: str, tmp_path: Any) -> None:
    plant = (chain(3), np.eye(3), first(3)) if strategy == "full" else SPLINE
    design = obsdesign.design(impulsive_problem(plant, [0.4, 0.5], strategy=strategy))
    design.save(tmp_path / "d.json")
    rng = np.random.default_rng(4)
    t, y = np.cumsum(rng.uniform(0.4, 0.5, 20)), rng.standard_normal((20, 1))
    y[7] = np.nan
    first_one: Any = from_design(design)
    batch = first_one.run_batch(t, y, jump=np.ones(20), x=np.ones(len(plant[0])))
    second: Any = obsdesign.runtime.load(tmp_path / "d.json")
    state = second.init(t=float(t[0]), x=np.ones(len(plant[0])))
    for k in range(20):
        before = state
        state, estimate = second.step(state, Sample(t[k], y[k], jump=True))
        again = second.step(before, Sample(t[k], y[k], jump=True))[1]  # a state is a value
        assert np.array_equal(again.x, estimate.x)
        assert np.array_equal(batch.x[k], estimate.x)
        assert batch.status[k] == estimate.status


def test_the_quadratic_table_contracts() -> None:
    problem = impulsive_problem(SPLINE, [0.4, 0.5], strategy="quadratic")
    design = obsdesign.design(problem)
    evidence = next(c for c in design.claims if c.id == "contracting").evidence
    P, A, G, C = np.array(evidence["P"]), *SPLINE
    observer: Any = from_design(design)
    rng = np.random.default_rng(9)
    state, error = observer.init(t=0.0), rng.standard_normal(4)
    t = 0.0
    for spacing in rng.uniform(0.4, 0.5, 30):
        t += spacing
        state, _ = observer.step(state, Sample(t, y=[0.0], jump=True))
        L, _ = observer._gain(state)
        smaller = (G + L @ C) @ expm(A * spacing) @ error
        if t > spacing:  # the first impulse has no spacing before it
            assert (
                smaller @ P @ smaller
                <= evidence["gamma"] ** 2 * (error @ P @ error) * (1 + 1e-6) + 1e-300
            )
        error = smaller


# --- what is refused ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"strategy": "best"}, "gains.strategy must be one of full, compressed, subspace, quadratic."),
        ({"window": 0}, "gains.window must be a whole number >= 1; got 0."),
        ({"window": 5000}, "gains.window must be a whole number from 1 to 4096; got 5000."),
        ({"alpha": 1.0}, "gains.alpha must be a number > 1; got 1.0."),
        ({"G": np.eye(3)}, "gains.G must have shape (2, 2) (n x n); got shape (3, 3)."),
        ({"G": None}, "gains.G is missing."),
        ({"B": np.eye(3)}, "gains.B must have shape (2, 3) (n x m); got shape (3, 3)."),
        ({"strategy": "compressed"}, "gains.image is missing."),
        ({"strategy": "subspace"}, "gains.core_place is missing."),
        ({"strategy": "quadratic"}, "gains.cells is missing."),
        ({"jump_measurement": "none"}, "gains.jump_measurement must be before or after."),
    ],
)  # fmt: skip
def test_gains_that_do_not_fit(changes: dict[str, Any], line: str) -> None:
    gains = plant_gains(*DOUBLE, window=2) | changes
    with pytest.raises(ValueError) as error:
        ImpulsiveObserver.from_gains({k: v for k, v in gains.items() if v is not None})
    assert str(error.value) == line


def test_bad_starts_and_times() -> None:
    observer: Any = from_design(obsdesign.design(impulsive_problem(DOUBLE, [0.5, 1.5])))
    with pytest.raises(obsdesign.InputError) as error:
        observer.start(0.0, [1.0])
    assert str(error.value) == "--initial must be the 2 finite numbers x1,x2; got 1 numbers."
    state, _ = observer.step(observer.init(t=0.0), Sample(0.0))
    with pytest.raises(ValueError, match="time must increase"):
        observer.step(state, Sample(0.0, y=[1.0], jump=True))
    with pytest.raises(ValueError, match="y must have 1 entries; got 2"):
        observer.step(state, Sample(1.0, y=[1.0, 2.0], jump=True))


def test_digest_and_runtime_agree(tmp_path: Any) -> None:
    design = obsdesign.design(impulsive_problem(DOUBLE, [0.5, 1.5]))
    design.save(tmp_path / "d.json")
    body = json.loads((tmp_path / "d.json").read_text())
    body["gains"]["window"] = 5
    (tmp_path / "d.json").write_text(json.dumps(body))
    with pytest.raises(obsdesign.InputError, match="digest does not match"):
        obsdesign.runtime.load(tmp_path / "d.json")


@pytest.mark.parametrize("B", [None, np.ones((2, 1))])
@pytest.mark.parametrize("drift", [[0.0, 0.0], [0.0, 0.5]])
def test_a_flow_is_driven_by_known_inputs_or_by_a_drift(B: Any, drift: list[float]) -> None:
    own: Any = SimpleNamespace(gains=SimpleNamespace(B=B, flow_drift=np.array(drift)))
    assert ImpulsiveObserver._forced.func(own) is (B is not None or any(drift))
