"""Deviations of impulses where samples show only the interval of an onset, in every operator."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from obsdesign.runtime import from_design
from obsdesign.runtime.base import rows_of
from obsdesign.runtime.impulsive_input.integral.onsets import valleys
from obsdesign.runtime.impulsive_input.whitening import log_evidence
from tests.systems.designs import designed
from tests.systems.impulsive_input import events_of, observer_of, record, rows_from

ONE = ([[-0.7]], [[1.0]], [[1.0]])
FAST = ([[-0.7, 0.0], [1.0, -2.0]], [[0.0], [1.0]], [[1.0, 1.0]])  # H: the fast mode alone
BESIDE = ([[-0.7, 0.0], [1.0, -2.0]], [[1.0], [0.0]], [[1.0, 1.0]])  # H is no eigenvector


def plant(matrices: Any, noise: float, period: float, **options: Any) -> dict[str, Any]:
    A, H, C = matrices
    return {
        "flow": {"A": A},
        "jump": {"H": H, "dwell_time": [8, "inf"]},
        "output": {"C": C, "noise_std": [noise], "measured": "periodic", "period": period},
        "observer": {"kind": "impulsive_input", **options},
    }


def errors_of(body: dict[str, Any], count: int, seed: int = 0) -> tuple[np.ndarray, list[Any], str]:
    """(errors of time and weight over their deviations (count, 2), events, operator)."""
    design = designed(body)
    rng, period = np.random.default_rng(seed), body["output"]["period"]
    moments = np.cumsum(8 * (1.05 + rng.exponential(0.2, count)))
    weights = rng.uniform(0.5, 2, count)
    t = period * np.arange(round((moments[-1] + 12) / period))
    A, H, C = (np.array(body[a][b]) for a, b in (("flow", "A"), ("jump", "H"), ("output", "C")))
    y = record(A, H, list(zip(moments, weights, strict=True)), t, np.zeros(len(A))) @ C.T
    y = y + body["output"]["noise_std"][0] * rng.standard_normal(y.shape)
    events = from_design(design).run_batch(t, y, x=np.zeros(len(A))).events
    nearest = [min(events, key=lambda e, at=at: abs(e.t - at)) for at in moments]
    scores = [
        ((e.t - at) / e.t_std, (e.weights[0] - g) / e.weights_std[0])
        for e, at, g in zip(nearest, moments, weights, strict=True)
    ]
    return np.array(scores), nearest, design.gains["operator"]


@pytest.mark.parametrize(
    ("matrices", "noise", "options", "operator"),
    [
        (ONE, 0.01, {}, "samples"),
        (FAST, 0.01, {"nonnegative": True}, "samples"),
        (FAST, 0.01, {"operator": "integral"}, "integral"),
        (ONE, 1e-4, {"weighting": "plain"}, "integral"),
        (ONE, 1e-4, {"operator": "integral", "nonnegative": True}, "integral"),
        (BESIDE, 0.01, {}, "samples"),
        (BESIDE, 0.01, {"operator": "integral"}, "integral"),
    ],
)
def test_errors_are_about_their_deviations(
    matrices: Any, noise: float, options: Any, operator: str
) -> None:
    period = 0.25
    scores, events, chosen = errors_of(plant(matrices, noise, period, **options), 20)
    assert chosen == operator
    # the level of residuals is passed by chance in about 1 of 100 windows
    assert sum(event.status != "ok" for event in events) <= 2
    size = np.sqrt((scores**2).mean(axis=0))
    assert (size > 0.7).all()
    assert (size < 1.3).all()
    deviation = np.median([event.t_std for event in events])
    if matrices is BESIDE:  # time and weight are told apart between samples
        assert deviation < 0.15 * period
    else:
        assert deviation == pytest.approx(period / math.sqrt(12), rel=0.03)


@pytest.mark.parametrize(("speed", "count"), [(-0.5, 30), (-25.0, 30)])
@pytest.mark.parametrize("options", [{}, {"nonnegative": True}])
def test_onsets_are_in_the_middle_however_fast_a_compartment_is(
    speed: float, count: int, options: dict[str, Any]
) -> None:
    """Up to five time constants between samples; a flat prior of weights put them .3 h early."""
    period, matrices = 0.2, ([[speed]], [[1.0]], [[1.0]])
    body = plant(matrices, 0.001, period, **options)
    body["jump"]["dwell_time"] = [2.0, "inf"]
    scores, events, operator = errors_of(body, count)
    assert operator == "samples"
    deviation = [event.t_std for event in events]
    np.testing.assert_allclose(deviation, period / math.sqrt(12), rtol=1e-3)
    assert (np.sqrt((scores**2).mean(axis=0)) < 1.3).all()
    assert abs(scores[:, 0].mean()) < 0.5


@pytest.mark.parametrize("response", [0.1, 1.0, 30.0])
def test_the_evidence_of_an_onset_is_that_over_all_sizes_of_a_weight(response: float) -> None:
    """int N(y; g s, 1) dg / |g| for unit noise: the same whatever weight an onset would take."""
    # even steps of log g are dg / g
    logs, weights = [], np.geomspace(1e-3, 1e3, 200_001)
    for y in (6.0, 9.0):
        likelihood = np.exp(-((y - weights * response) ** 2) / 2)
        logs.append(math.log(likelihood.sum()) + y**2 / 2)
    # its slope: the constant, and what a weight of nothing has, are no matter of the onset
    expected = log_evidence(np.array([36.0, 81.0]), 1)
    assert logs[1] - logs[0] == pytest.approx(expected[1] - expected[0], abs=0.03)


def test_a_dwell_time_is_not_short_by_what_samples_do_not_show() -> None:
    body = plant(ONE, 0.001, 0.5, operator="integral")
    design = designed(body)
    for onsets in ((9.49, 17.49, 25.49, 33.49), (9.49, 17.51, 25.51, 33.52)):
        t = 0.5 * np.arange(100)
        y = record(body["flow"]["A"], [[1.0]], [(at, 1.0) for at in onsets], t, [0])
        events = from_design(design).run_batch(t, y, x=np.zeros(1)).events
        assert [event.status for event in events] == ["ok"] * 4


@pytest.mark.parametrize(
    ("noise", "seed"),
    [
        ({"noise_cv": [0.0012, 0.0043]}, 0),
        ({"noise_std": [2e-4, 7e-4]}, 1),
    ],
)
def test_onsets_of_two_cells_that_leave_the_same_both_count(
    noise: dict[str, Any], seed: int
) -> None:
    """Under the plain norm: as many numbers as unknowns, and an output that jumps."""
    A, C = np.array([[-0.25, -0.94], [0.94, -0.35]]), np.array([[0, 1], [0.46, 1.2]])
    body = {
        "flow": {"A": A.tolist()},
        "jump": {"H": [[1], [0]], "dwell_time": [16.0, math.inf]},
        "output": {"C": C.tolist(), "measured": "periodic", "period": 0.19, **noise},
        "observer": {"kind": "impulsive_input", "operator": "integral", "weighting": "plain",
                     "gains": {"K": [[-0.08, 0.61], [0.51, -0.1]]}},
    }  # fmt: skip
    t, rng = 0.19 * np.arange(1090), np.random.default_rng(seed)
    train = [(18 * k + rng.uniform(0, 2), rng.choice([-1, 1]) * rng.uniform(0.4, 3))
             for k in range(1, 11)]  # fmt: skip
    exact = record(A, [[1.0], [0.0]], train, t, np.zeros(2)) @ C.T
    spread = noise.get("noise_std", np.array(noise.get("noise_cv", [0, 0])) * np.abs(exact))
    events = events_of(
        rows_from(observer_of(body), t, exact + spread * rng.standard_normal(exact.shape))
    )
    assert len(events) == len(train)
    for event, (onset, weight) in zip(events, train, strict=True):
        assert abs(event.t - onset) < 4 * event.t_std
        assert abs(event.weights[0] - weight) < 4 * event.weights_std[0]


@pytest.mark.parametrize(
    ("cost", "borders"),
    [
        ([9, 4, 0, 4, 9], [0, 5]),
        ([9, 0, 9, 0, 9], [0, 2, 5]),
        ([9, 0, 1, 0, 9], [0, 5]),  # a ridge of rounding is none
        ([0, 50, 40, 50, 0, 7, 7, 0], [0, 1, 3, 6, 8]),
        ([3, 3, 3], [0, 3]),
    ],
)
def test_valleys_of_the_cost_are_apart_by_ridges(cost: list[float], borders: list[int]) -> None:
    parts = valleys(np.array(cost, float))
    assert [parts[0].start, *(part.stop for part in parts)] == borders


@pytest.mark.parametrize("operator", ["integral", "samples"])
def test_doubtful_impulses_one_after_another_mark_the_same_rows_in_parts(operator: str) -> None:
    """With noise that is stated too small every impulse has a doubt."""
    body = plant(BESIDE, 0.003, 0.25, operator=operator)
    observer = from_design(designed(body))
    rng = np.random.default_rng(0)
    moments = np.cumsum(8 * (1.02 + rng.exponential(0.1, 6)))
    t = 0.25 * np.arange(240)
    A, H, C = (np.array(body[a][b]) for a, b in (("flow", "A"), ("jump", "H"), ("output", "C")))
    x = record(A, H, [(float(at), 1.0) for at in moments], t, np.zeros(2))
    y = x @ C.T + 0.01 * rng.standard_normal((len(t), 1))
    rows = list(observer.run(observer.init(0.0), rows_of(t, y)))
    assert sum(row.status != "ok" for row in rows) > 100
    assert [row.status for row in rows] == list(observer.run_batch(t, y, x=np.zeros(2)).status)


@pytest.mark.parametrize("ulps", [1, 4, 32])
def test_coarse_time_stamps_blur_times_alone(ulps: int) -> None:
    """Samples a few units in the last place apart: weights as from zero on, times to a digit."""
    begin = 1.7e9
    period = ulps * math.ulp(begin)
    body = plant(BESIDE, 0.01, 0.25, operator="integral")
    body["flow"]["A"] = (np.array(BESIDE[0]) * 0.25 / period).tolist()
    body["jump"]["dwell_time"] = [32 * period, "inf"]
    body["output"]["period"] = period
    observer = from_design(designed(body))
    A, H, C = (np.array(body[a][b]) for a, b in (("flow", "A"), ("jump", "H"), ("output", "C")))
    steps, moments = np.arange(200), [30.37 * period, 81.81 * period, 140.45 * period]
    x = record(A, H, [(at, 1.0) for at in moments], period * steps, np.zeros(2))
    y = x @ C.T + 0.01 * np.random.default_rng(1).standard_normal((len(steps), 1))
    early, late = (
        observer.run_batch(t0 + period * steps, y, x=np.zeros(2)).events for t0 in (0.0, begin)
    )
    assert len(early) == len(late) == 3
    for ours, other, at in zip(late, early, moments, strict=True):
        assert abs(ours.weights - other.weights)[0] < 0.5 * other.weights_std[0]
        assert ours.weights_std == pytest.approx(other.weights_std, rel=0.05)
        assert abs(ours.t - begin - at) < 4 * ours.t_std
        assert ours.t_std >= 0.28 * math.ulp(begin)
