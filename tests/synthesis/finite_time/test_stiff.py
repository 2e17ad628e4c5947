"""Plants whose modes decay within a window: solved against the state at the window's start."""

from __future__ import annotations

import contextlib
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign
from lmi.arithmetic.balls import Ball, rational, scalar
from lmi.arithmetic.exponential import flow_integrals
from obsdesign.analysis.finite_time import enclosed_gains as window_gains
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.analysis.finite_time.error_radius import PRECISIONS
from obsdesign.data.simulation import simulate
from obsdesign.design_file import from_dict
from obsdesign.equations.finite_time.rows import least_squares_gain
from obsdesign.runtime import Sample, from_design
from obsdesign.synthesis.finite_time import minimax, window_gain
from obsdesign.verification.finite_time.gains import _reason_against_window
from tests.verification.finite_time.test_claims import sampled_problem

BOTH = [[1.0, 1.0]]
BOUNDS: Any = {
    "flow": {"disturbance": {"lower": [-1, -1], "upper": [1, 1]}, "B": [[0], [1]]},
    "output": {"noise_bound": [0.1]},
}


def stiff(fast: float, **more: Any) -> obsdesign.Problem:
    return sampled_problem(np.diag([-fast, -1.0]), BOTH, 0.1, window=0.4, **more)


def verdicts(outcome: Any) -> dict[str, str]:
    return {claim.id: claim.verdict for claim in outcome.claims}


@pytest.mark.parametrize("fast", [200.0, 300.0, 1000.0])
@pytest.mark.parametrize("method", ["least_squares", "minimax"])
def test_fast_modes_are_measured_at_the_start(fast: float, method: str) -> None:
    design = obsdesign.design(stiff(fast, method=method, **BOUNDS))
    assert design.gains["reference"] == "start"
    # nothing is amplified, and what is missed is rounding of x(t_i - T)
    assert np.abs(design.gains["window_gain"]).sum(axis=1).max() < 1.0
    assert design.gains["state_error"].max() < 1e-14
    assert design.guarantees[0].statement.endswith(
        "to rounding of what it was at the window's start."
    )
    again = from_dict(design.to_dict())
    assert obsdesign.verify(again, paranoid=True).verdict == "proved"


def test_everything_may_be_forgotten() -> None:
    design = obsdesign.design(sampled_problem([[-1e4]], [[1.0]], 0.05, window=6))
    assert design.gains["window_gain"].max() == 0.0  # e^-60000
    # the twin: a mode that stays is not forgotten
    design = obsdesign.design(sampled_problem([[-1e-4]], [[1.0]], 0.05, window=6))
    assert "reference" not in design.gains


def test_twins_that_are_not_proved() -> None:
    design = obsdesign.design(stiff(300.0))
    G = np.array(design.gains["window_gain"])
    G[1, 0] += 1e-6
    wrong = obsdesign.verify(replace(design, gains={**design.gains, "window_gain": G}))
    assert verdicts(wrong)["unbiased"] == "refuted"
    smaller = {**design.gains, "state_error": design.gains["state_error"] / 2}
    assert verdicts(obsdesign.verify(replace(design, gains=smaller)))["unbiased"] == "undecided"
    # against the last state, the same gains miss what has decayed
    last = {name: value for name, value in design.gains.items() if name != "reference"}
    assert verdicts(obsdesign.verify(replace(design, gains=last)))["unbiased"] == "refuted"
    unknown = {**design.gains, "reference": "middle"}
    assert verdicts(obsdesign.verify(replace(design, gains=unknown)))["consistent"] == "refuted"
    bounded = obsdesign.design(stiff(300.0, **BOUNDS))
    less = {**bounded.gains, "radius": bounded.gains["radius"] * (1 - 1e-6)}
    assert verdicts(obsdesign.verify(replace(bounded, gains=less)))["error_radius"] == "refuted"


def test_undetermined_states_are_refused() -> None:
    # pathological sampling beside a fast mode, and two modes that no sample tells apart
    A = np.zeros((3, 3))
    A[:2, :2], A[2, 2] = [[0, 0.15], [-0.15, 0]], -50.0
    period = 2 * np.pi / 0.3
    with pytest.raises(obsdesign.NotProved, match="pathological sampling"):
        obsdesign.design(sampled_problem(A, [[1, 0, 1]], period, window=3 * period))
    obsdesign.design(sampled_problem(A, [[1, 0, 1]], 1.0, window=3))
    with pytest.raises(obsdesign.NotProved, match="hardly see a state"):
        obsdesign.design(
            sampled_problem(np.diag([-3.0, -3.0 * (1 + 1e-13)]), BOTH, 0.1, window=0.4)
        )
    with pytest.raises(obsdesign.NotProved, match="and another one grows by"):
        obsdesign.design(sampled_problem(np.diag([-200.0, 100.0]), BOTH, 0.1, window=0.4))


def test_rows_that_are_singular_to_the_last_bit() -> None:
    """Modes that die within a period make R of the QR singular: an answer, no traceback."""
    A = np.diag([-1565.0, -704.0, -100.0, 0.3]) + np.diag(np.ones(3), 1)
    outcome = obsdesign.investigate(sampled_problem(A, [[1.0, 1.0, 1.0, 1.0]], 0.05, window=0.2))
    assert outcome.claims[-1].verdict != "undecided"
    rows = np.array([[1.0, 0.0], [2.0, 0.0]])
    fitted = least_squares_gain(rows, np.ones(2))
    assert np.abs(fitted @ rows - np.diag([1.0, 0.0])).max() < 1e-14  # onto what is seen
    # the twin: rows that are not singular are inverted
    rows = np.array([[1.0, 1.0], [2.0, 1.0]])
    assert np.abs(least_squares_gain(rows, np.ones(2)) @ rows - np.eye(2)).max() < 1e-14


def exact(fast: float, gain: float = 0.3) -> Any:
    problem = sampled_problem(
        np.diag([-fast, -1.0]), BOTH, 0.3, window=1.2, method="exact",
        gains={"L": [[gain], [gain]]},
    )  # fmt: skip
    return obsdesign.investigate(problem)


def test_exact_is_refuted_for_its_own_matrix_alone() -> None:
    """sigma_min / |P^k - A_d^k| is 9.4e-4 here, and 3e-13 only after the product with A_d^-k."""
    outcome = exact(20.0)
    assert outcome.verdict == "proved"
    ratio = {c.id: c for c in outcome.claims}["injection_invertible"].evidence["approx_ratio"]
    assert ratio > 1e-6
    assert outcome.design is not None
    assert obsdesign.verify(outcome.design).verdict == "proved"
    # the twin: Z = exp(C W L) is e^21 over a period, so that P^k - A_d^k is all but of rank one
    assert verdicts(exact(25.0))["injection_invertible"] == "refuted"
    witness = exact(25.0).claims[-1].evidence["witness"]
    assert "of its norm" in witness["reason"]
    assert "is singular: L C = 0" in exact(20.0, 0.0).claims[-1].evidence["witness"]["reason"]


def test_exact_is_undecided_beyond_its_work_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(window_gains, "_MOST_WORK", 1e4)
    claim = exact(21.0).claims[-1]
    assert (claim.id, claim.verdict) == ("injection_invertible", "undecided")
    monkeypatch.undo()
    window_gains._injection.cache_clear()
    assert exact(21.0).verdict != "undecided"  # the twin


@pytest.mark.parametrize("rate", [-1.0, 0.3])
@pytest.mark.parametrize("method", ["least_squares", "minimax"])
def test_bounds_hold_and_w_moves(rate: float, method: str) -> None:
    """Feedback keeps an unstable slow mode small while w alone would grow."""
    plant = {"A": [[-300.0, 50.0], [0.0, rate]], "C": BOTH, "period": 0.1, "window": 0.8}
    problem = sampled_problem(**plant, method=method, **BOUNDS)
    observer: Any = from_design(obsdesign.design(problem))
    rng = np.random.default_rng(0)
    A, h = np.array(plant["A"]), 0.1
    flow, once = flow_integrals(A, h)
    x, state, full = np.array([5.0, 1.0]), observer.init(), 0
    for i in range(200):
        v = 0.1 * rng.choice([-1.0, 1.0])
        u = np.array([-1.5 * x[1]])
        state, estimate = observer.step(state, Sample(i * h, BOTH @ x + v, u=u))
        if estimate.status == "ok":
            full += 1
            assert (estimate.lower <= x).all()
            assert (x <= estimate.upper).all()
        x = flow @ x + once @ (np.array([0.0, u[0]]) + rng.choice([-1.0, 1.0], 2))
    assert full == 192
    assert np.abs(state.w).max() < 100
    radius = observer.gains.radius
    assert (estimate.upper - estimate.lower <= 2 * radius * (1 + 1e-9) + 1e-9).all()


def coupled(seed: int) -> tuple[Any, Any, Any]:
    """A, C and the noise's bounds of a plant with rates over three decades, in mixed states."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    rates = -(10.0 ** rng.uniform(0, 3.5, n))
    rates[0] = rng.choice([0.3, -0.2, 0.0])
    T = rng.standard_normal((n, n)) + 2 * np.eye(n)
    return T @ np.diag(rates) @ np.linalg.inv(T), rng.standard_normal((2, n)), [0.01, 0.02]


@pytest.mark.parametrize("method", ["least_squares", "minimax"])
def test_modes_that_decay_within_a_period_need_not_be_distinguished(method: str) -> None:
    """diag(-1000, -900, -1): y at the start shows x1 + x2 + x3, and later x3 alone."""
    rng = np.random.default_rng(1)
    S = rng.standard_normal((3, 3)) + 2 * np.eye(3)
    A = S @ np.diag([-1000.0, -900.0, -1.0]) @ np.linalg.inv(S)
    C = rng.standard_normal((1, 3))
    bounds: Any = {"output": {"noise_bound": [0.1]}}
    design = obsdesign.design(sampled_problem(A, C, 0.1, window=0.9, method=method, **bounds))
    assert design.gains["reference"] == "start"
    assert np.abs(design.gains["window_gain"]).max() < 10
    evidence = {claim.id: claim.evidence for claim in design.claims}
    assert evidence["sampled_observable"] == {"died_out": True}
    assert evidence["unbiased"]["error"] <= 1e-11
    assert obsdesign.verify(from_dict(design.to_dict()), paranoid=True).verdict == "proved"
    # what no sample shows has no bound, and the design says so
    sentences = [entry.statement for entry in design.guarantees if entry.given]
    assert any("the bounds at run time are infinite" in text for text in sentences)
    observer: Any = from_design(design)
    flow = flow_integrals(A, 0.1)[0]
    x, state = np.array([5.0, -3.0, 1.0]), observer.init()
    for i in range(30):
        state, estimate = observer.step(state, Sample(0.1 * i, C @ x))
        if estimate.status == "ok":
            assert np.abs(estimate.x - x).max() < 1e-12
            assert np.isinf(estimate.upper).all()
        x = flow @ x
    # the twins: other gains, and a mode that lasts a little
    G = np.array(design.gains["window_gain"])
    G[0, 0] += 1e-9
    wrong = obsdesign.verify(replace(design, gains={**design.gains, "window_gain": G}))
    assert verdicts(wrong)["sampled_observable"] == "refuted"
    A = S @ np.diag([-10.0, -10.0 * (1 + 1e-13), -1.0]) @ np.linalg.inv(S)
    with pytest.raises(obsdesign.NotProved, match="hardly see a state"):
        obsdesign.design(sampled_problem(A, C, 0.1, window=0.9, method=method, **bounds))


def test_random_stiff_stable_plants_are_not_refused() -> None:
    """Rates over four and a half decades: what lasts is always seen."""
    reasons = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 6))
        rates = -(10.0 ** rng.uniform(0, 4.5, n))
        rates[0] = rng.choice([0.3, -0.2, 0.0])
        T = rng.standard_normal((n, n)) + 2 * np.eye(n)
        A, C = T @ np.diag(rates) @ np.linalg.inv(T), rng.standard_normal((2, n))
        outcome = obsdesign.investigate(sampled_problem(A, C, 0.05, window=0.1 * n))
        reasons += [] if outcome.verdict == "proved" else [seed]
    assert reasons == []


def test_words_of_a_refusal_make_sense() -> None:
    # growth and decay beyond 16 digits within the shortest window
    with pytest.raises(obsdesign.NotProved, match="choose a shorter period, and with it"):
        obsdesign.design(sampled_problem(np.diag([-400.0, 400.0]), BOTH, 0.1, window=0.4))
    advice = _reason_against_window(Sampled.from_plant(np.diag([-100.0, 100.0]), BOTH, 0.01, 100))
    assert advice is not None
    assert advice.endswith("choose a window below 0.18")
    # what hardly grows is not said to grow
    reason = _reason_against_window(Sampled.from_plant(np.diag([-100.0, 1e-10]), BOTH, 0.01, 100))
    assert reason is not None
    assert "grows" not in reason
    assert (
        _reason_against_window(Sampled.from_plant(np.diag([-100.0, 100.0]), BOTH, 0.01, 10)) is None
    )  # the twin


@pytest.mark.parametrize("seed", [0, 1, 2, 5, 7, 9])
def test_bounds_at_run_time_are_those_of_the_design(seed: int) -> None:
    """Coupled fast modes: e^(|A| nu) is beyond 10^40, and |e^(A nu)| about one."""
    A, C, V = coupled(seed)
    n = len(A)
    disturbance = {"lower": np.full(n, -0.1), "upper": np.full(n, 0.1)}
    problem = sampled_problem(
        A, C, 0.1, window=0.4, flow={"disturbance": disturbance}, output={"noise_bound": V}
    )
    outcome = obsdesign.investigate(problem)
    assert outcome.verdict == "proved"
    observer: Any = from_design(outcome.design)
    radius = observer.gains.radius
    flow, once = flow_integrals(A, 0.1)
    rng = np.random.default_rng(seed)
    x, state = rng.standard_normal(n), observer.init()
    wide, attained = 0.0, 0.0
    for i in range(40):
        state, estimate = observer.step(state, Sample(i * 0.1, C @ x + V * rng.choice([-1, 1], 2)))
        x_true = x
        x = flow @ x + once @ (0.1 * rng.choice([-1.0, 1.0], n))
        if estimate.status != "ok":
            continue
        assert (estimate.lower <= x_true).all()
        assert (x_true <= estimate.upper).all()
        wide = max(wide, float(((estimate.upper - estimate.lower) / 2 / radius).max()))
        attained = max(attained, float((np.abs(estimate.x - x_true) / radius).max()))
    assert wide <= 1.001
    # the twin: a tenth of it would have been violated
    assert attained > 0.1
    # between samples the plant predicts, and no comparison system blows that up
    _, between = observer.step(state, Sample(39.5 * 0.1))
    assert ((between.upper - between.lower) / 2 <= 100 * radius.max()).all()


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 4), fast=st.floats(100, 500))
def test_random_stiff_plants_to_rounding(seed: int, n: int, fast: float) -> None:
    rng = np.random.default_rng(seed)
    S, rates = rng.standard_normal((n + 1, n + 1)), np.append(rng.uniform(-1.0, 0.2, n), -fast)
    A = S @ np.diag(rates) @ np.linalg.inv(S)
    C = rng.standard_normal((1, n + 1))
    problem = sampled_problem(
        A, C, 0.2, window=0.2 * 4 * (n + 1), flow={"B": rng.standard_normal((n + 1, 1))}
    )
    outcome = obsdesign.investigate(problem)
    if outcome.verdict != "proved":
        return
    amplified = {c.id: c for c in outcome.claims}["unbiased"].evidence["amplification"]
    record = simulate(
        problem.plant, until=4.0 * (n + 1), step=0.1, initial=rng.standard_normal(n + 1),
        disturbance="zero", rng=rng,
    )  # fmt: skip
    batch = from_design(outcome.design).run_batch(record.t, record.block("y"), record.block("u"))
    full = np.array([status == "ok" for status in batch.status])
    x = record.block("x")
    assert full.any()
    size = np.abs(x).max() + np.abs(record.block("u")).max()
    limit = 1e-12 * (1 + amplified) * size * np.linalg.cond(S)
    assert np.abs(batch.x - x)[full].max() <= limit


def test_missing_samples_of_a_stiff_plant() -> None:
    design = obsdesign.design(sampled_problem(np.diag([-300.0, -1.0]), BOTH, 0.1, window=0.8))
    observer: Any = from_design(design)
    t = 0.1 * np.arange(30)
    x = np.exp(np.outer(t, [-300.0, -1.0])) * [3.0, 2.0]
    y = x.sum(axis=1)[:, None]
    y[12] = np.nan
    batch = observer.run_batch(t, y)
    assert batch.status[14] == "missing sample"
    # a sample that shows the fast mode is 12 decades below: the rest still gives the slow one
    assert np.abs(batch.x[8:] - x[8:]).max() < 1e-13


def test_larger_radius_or_state_error_is_refuted() -> None:
    """A larger radius or state_error would make the bounds that run wider than the sentence."""
    design = obsdesign.design(stiff(300.0, **BOUNDS))
    radius, state_error = design.gains["radius"], design.gains["state_error"]
    wider = {**design.gains, "radius": radius * (1 + 1e-4)}
    claims = verdicts(obsdesign.verify(replace(design, gains=wider)))
    assert claims["error_radius"] == "refuted"
    wider = {**design.gains, "state_error": state_error + 1e-6}
    assert verdicts(obsdesign.verify(replace(design, gains=wider)))["unbiased"] == "refuted"
    # the twin: what rounding does to a file is no lie
    wider = {**design.gains, "radius": radius * (1 + 1e-12), "state_error": state_error * 2}
    assert obsdesign.verify(replace(design, gains=wider)).verdict == "proved"


def test_a_window_that_is_never_full_warns_of_nothing() -> None:
    problem = sampled_problem(
        [[-1333.0, 666.0], [-666.0, 332.0]], [[1.0, 0.0]], 0.1, window=0.4,
        flow={"B": [[1], [0]], "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]}},
        output={"noise_bound": [0.01]},
    )  # fmt: skip
    design = obsdesign.design(problem)
    observer: Any = from_design(design)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        state = observer.init()
        for i in range(30):
            state, estimate = observer.step(state, Sample(0.07 * i, np.zeros(1), u=np.zeros(1)))
    assert not np.isfinite(estimate.upper).all()  # no window was ever full
    with pytest.warns(RuntimeWarning), np.errstate(all="warn"):  # the twin
        _ = estimate.lower + estimate.upper


# --- minimax --------------------------------------------------------------------------------------


def test_minimax_is_never_worse_than_least_squares() -> None:
    # an unscaled program of this plant is called infeasible, although least squares is there
    rng = np.random.default_rng(3)
    A = rng.standard_normal((5, 5)) * 0.1 - 0.3 * np.eye(5)
    units = 10.0 ** rng.integers(-4, 5, 5)
    more = {
        "flow": {"disturbance": {"lower": -units, "upper": units}}, "output": {"noise_bound": [0.1]},
    }  # fmt: skip
    A, C = units[:, None] * A / units, rng.standard_normal((1, 5)) / units
    radii = [
        obsdesign.design(sampled_problem(A, C, 0.3, window=6, method=method, **more)).gains[
            "radius"
        ]
        for method in ("least_squares", "minimax")
    ]
    assert (radii[1] <= 0.98 * radii[0]).all()


def test_a_solver_that_gives_up_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(minimax, "_solutions", lambda *_: [])
    options = {"window": 2, "output": {"noise_bound": [0.1]}}
    outcome = obsdesign.investigate(sampled_problem(method="minimax", **options))
    assert outcome.verdict == "proved"
    assert outcome.result["remarks"] == [
        "minimax: the solvers find nothing better for x1, x2 than least squares, whose gains are "
        "used for it"
    ]
    fitted = obsdesign.design(sampled_problem(**options)).gains["window_gain"]
    assert outcome.design is not None
    assert np.abs(outcome.design.gains["window_gain"] - fitted).max() < 1e-12
    monkeypatch.undo()
    twin = obsdesign.investigate(sampled_problem(method="minimax", **options))
    assert "remarks" not in twin.result


@pytest.mark.parametrize("method", ["exact", "approximate"])
@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_a_slow_plant_in_short_units_of_time_is_designed(method: str, unit: float) -> None:
    """Gains for which e^(-(A + L C) T) underflows are passed over."""
    body = {
        "flow": {"A": [[-4.1e-06 / unit]]},
        "output": {"C": [[9.6e-09]], "noise_bound": 0.0, "measured": "periodic",
                   "period": 5e4 * unit},
        "observer": {"kind": "finite_time", "method": method, "window": 1e5 * unit},
    }  # fmt: skip
    assert obsdesign.investigate(obsdesign.Problem.from_dict(body)).verdict == "proved"


def test_bounds_of_a_long_window_take_the_digits_they_need() -> None:
    """Backwards a damped oscillation grows: 160 bits are lost over 1500 samples."""
    problem = obsdesign.Problem(
        flow={"A": [[0.0, 1.0], [-1.0, -0.2]], "disturbance": {"lower": [0, -0.1], "upper": [0, 0.1]}},
        output={"C": [[1.0, 0.0]], "noise_bound": [0.01], "measured": "periodic", "period": 0.1},
        observer={"kind": "finite_time", "window": 150.0},
    )  # fmt: skip
    design = obsdesign.design(problem)
    assert (design.gains["radius"] > 0.6).all()
    assert obsdesign.verify(design).verdict == "proved"


@pytest.mark.parametrize(("rate", "evaluations"), [(100.0, 1), (1.0, len(PRECISIONS))])
def test_no_digits_are_spent_on_bounds_of_a_refuted_gain(
    rate: float, evaluations: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def unknown(sampled: Sampled, *_: object) -> list[Ball]:
        calls.append(sampled.k)
        return [scalar(rational(0)).union(scalar(rational(1)))] * len(sampled.A)

    monkeypatch.setattr(window_gain, "error_radius", unknown)
    problem = sampled_problem(np.diag([-rate, rate]), BOTH, 0.1, window=0.4, **BOUNDS)
    with contextlib.suppress(obsdesign.InputError):  # of bounds that stay unknown
        assert obsdesign.investigate(problem).verdict == "refuted"
    assert len(calls) == evaluations
