"""Few samples: the discrete operator, and the hormone record of the examples."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.runtime import from_design
from obsdesign.runtime.base import rows_of
from obsdesign.runtime.impulsive_input.samples.filter import Row, SampledPlant
from obsdesign.synthesis.impulsive_input import candidates as synthesis
from obsdesign.verification.impulsive_input import claims as verification
from obsdesign.verification.impulsive_input.samples import sampled_claims
from tests.systems.designs import designed
from tests.systems.impulsive_input import events_of, record

EXAMPLES = Path(__file__).parents[3] / "examples"
DATA = np.loadtxt(EXAMPLES / "luteinizing_hormone.csv", delimiter=",", skiprows=1)
SIX = [
    (54.34, 2.87, 0.952, 0.162), (131.48, 1.95, 1.995, 0.216), (212.04, 2.16, 1.190, 0.165),
    (263.34, 2.39, 1.441, 0.196), (379.08, 1.56, 2.622, 0.241), (442.66, 2.16, 1.339, 0.232),
]  # fmt: skip
PRIOR = {"x": [0, 2.4], "covariance": np.diag([0.25, 1.0])}


def events_in(observer: Any, t: Any, y: Any, **initial: Any) -> list[Any]:
    return events_of(list(observer.run(observer.init(float(t[0]), **initial), rows_of(t, y))))


def test_six_impulses_in_the_hormone_record(observer: Any) -> None:
    # computed elsewhere, with a normal prior of weights of deviation 3
    events = events_in(observer, DATA[:, 0], DATA[:, 1:], **PRIOR)
    for event, numbers in zip(events, SIX, strict=True):
        numbers_of_event = (event.t, event.t_std, event.weights[0], event.weights_std[0])
        for value, other, allowed in zip(
            numbers_of_event, numbers, (0.2, 0.1, 0.03, 0.01), strict=True
        ):
            assert value == pytest.approx(other, abs=allowed)
    assert [event.status for event in events[:5]] == ["ok"] * 5
    assert events[5].status == "provisional: the record ends inside its window"


@pytest.mark.parametrize("size", [1e30, 1e60, 1e99])
@pytest.mark.parametrize("row", [0, 1, 40])
def test_an_outlier_at_any_row_leaves_all_rows_finite(observer: Any, size: float, row: int) -> None:
    y = DATA[:, 1:].copy()
    y[row] = size
    rows = list(observer.run(observer.init(0.0), rows_of(DATA[:, 0], y)))
    assert len(rows) == len(y)
    assert all(np.isfinite(one.x).all() for one in rows)
    for event in events_of(rows):
        assert np.isfinite([event.t, event.t_std, *event.weights, *event.weights_std]).all()


@given(st.integers(0, 10**6), st.sampled_from([0, 30, 60, 90]))
@settings(max_examples=12, deadline=None)
def test_the_filter_of_a_covariance_however_large_is_that_of_least_squares(
    seed: int, decades: int
) -> None:
    """With P so large that nothing is known before, n samples determine the state."""
    rng = np.random.default_rng(seed)
    plant = SampledPlant(
        A=rng.standard_normal((2, 2)), B=np.zeros((2, 0)), C=rng.standard_normal((1, 2)),
        H=np.ones((2, 1)), drift=np.zeros(2),
    )  # fmt: skip
    if np.linalg.cond(np.vstack([plant.C, plant.C @ plant.A])) > 50:
        return
    t, y, std = np.arange(8) * 0.5, 10.0**decades * rng.uniform(1, 2, (8, 1)), np.full(1, 0.1)
    rows = [Row(float(a), b, np.zeros(0), 10.0**decades * std) for a, b in zip(t, y, strict=True)]
    first = plant.start(0.0, np.zeros(2), 1e8 * 10.0**decades * np.eye(2), np.zeros(0), rows[0])
    last = first
    for row in rows[1:]:
        last = plant.after(last, row)
    output_rows = np.vstack([plant.C @ expm(plant.A * (a - t[-1])) for a in t])
    best = np.linalg.lstsq(output_rows, y[:, 0], rcond=None)[0]
    np.testing.assert_allclose(last.x, best, rtol=1e-5, atol=1e-5 * np.abs(best).max())
    wanted = (10.0**decades * 0.1) ** 2 * np.linalg.inv(output_rows.T @ output_rows)
    np.testing.assert_allclose(last.P, wanted, rtol=1e-4, atol=1e-4 * np.abs(wanted).max())


@pytest.mark.parametrize("covariance", [np.full((2, 2), np.nan), np.diag([1.0, -1.0])])
def test_a_covariance_that_is_none_is_refused(observer: Any, covariance: Any) -> None:
    with pytest.raises(ValueError, match="covariance must be finite, its diagonal"):
        observer.init(0.0, covariance=covariance)


def test_the_first_covariance_hardly_matters(observer: Any) -> None:
    events = events_in(observer, DATA[:, 0], DATA[:, 1:])
    for event, numbers in zip(events, SIX, strict=True):
        assert event.t == pytest.approx(numbers[0], abs=0.7)
        assert event.weights[0] == pytest.approx(numbers[2], abs=0.05)


def test_rows_come_once_and_the_tail_is_unresolved(observer: Any) -> None:
    rows = list(observer.run(observer.init(0.0, **PRIOR), rows_of(DATA[:, 0], DATA[:, 1:])))
    np.testing.assert_array_equal([row.t for row in rows], DATA[:, 0])
    assert [row.status for row in rows[:40]] == ["ok"] * 40
    assert all("unresolved" in row.status for row in rows[-2:])
    batch = observer.run_batch(DATA[:, 0], DATA[:, 1:], **PRIOR)
    np.testing.assert_allclose(batch.x, [row.x for row in rows], rtol=1e-12)


@pytest.mark.parametrize("onset", [100.5, 103.7, 109.1])
def test_an_onset_between_samples_is_exact_without_noise(
    body: dict[str, Any], onset: float
) -> None:
    quiet = copy.deepcopy(body)
    quiet["output"] |= {"noise_std": [1e-4], "noise_cv": [0.0]}
    observer = from_design(designed(quiet))
    t = 10.0 * np.arange(30)
    drift = np.array(quiet["flow"]["disturbance"]["lower"])
    x = record(quiet["flow"]["A"], quiet["jump"]["H"], [(onset, 1.8)], t, [0.1, 1.5], drift)
    (event,) = events_in(observer, t, x[:, 1:], x=[0.1, 1.5], covariance=1e-8 * np.eye(2))
    assert event.t == pytest.approx(onset, abs=5 * event.t_std + 1e-6)
    assert event.t_std < 0.02
    assert event.weights[0] == pytest.approx(1.8, rel=0.01)


def test_unit_vectors_of_the_response(body: dict[str, Any]) -> None:
    A = np.array(body["flow"]["A"])
    h = [(expm(A * v) @ [1.0, 0])[1] for v in (2, 10, 20, 30, 40)]
    np.testing.assert_allclose(
        h, [0.32485192, 0.78997196, 0.79462162, 0.70622714, 0.61676458], atol=1e-8
    )


def test_a_missing_sample_costs_little(observer: Any) -> None:
    y = DATA[:, 1:].copy()
    y[20] = np.nan
    events = events_in(observer, DATA[:, 0], y, **PRIOR)
    assert len(events) == 6
    rows = list(observer.run(observer.init(0.0, **PRIOR), rows_of(DATA[:, 0], y)))
    assert rows[20].status == "missing sample"


def test_no_sample_is_due_between_samples(observer: Any) -> None:
    t = np.insert(DATA[:, 0], [6, 14], [54.3, 131.5])  # rows of impulses, as a simulation has them
    y = np.insert(DATA[:, 1:], [6, 14], np.nan, axis=0)
    y[20] = np.nan  # the twin: a row on the period
    rows = list(observer.run(observer.init(0.0, **PRIOR), rows_of(t, y)))
    assert [k for k, row in enumerate(rows) if "missing sample" in row.status] == [20]
    assert [rows[6].status, rows[15].status] == ["ok", "ok"]


def test_the_operator_is_chosen_by_the_sampling(body: dict[str, Any]) -> None:
    open_body = copy.deepcopy(body)
    for name in ("operator", "window"):
        del open_body["observer"][name]
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(open_body))
    assert outcome.result["form"].startswith(
        "samples: the fastest mode of A - K C times the period is 2.5"
    )
    assert outcome.design.gains["window"] == 40.0
    open_body["output"]["period"] = 0.1
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(open_body))
    assert outcome.design.gains["operator"] == "integral"


def test_one_compartment_shows_only_the_interval_of_an_onset() -> None:
    body = {
        "flow": {"A": [[-0.0139]]}, "jump": {"H": [[1]], "dwell_time": [45, "inf"]},
        "output": {"C": [[1]], "measured": "periodic", "period": 10, "noise_cv": [0.01]},
        "observer": {"kind": "impulsive_input", "operator": "samples"},
    }  # fmt: skip
    design = designed(body)
    claim = next(claim for claim in design.claims if claim.id == "uniqueness")
    assert "determine that an impulse came in its first interval" in claim.statement
    t = 10.0 * np.arange(30)
    y = [record(body["flow"]["A"], [[1.0]], [(onset, 2.0)], t, [0.0]) for onset in (101.0, 108.0)]
    for exact_y, onset in zip(y, (101.0, 108.0), strict=True):
        (event,) = from_design(design).run_batch(t, exact_y, x=np.zeros(1)).events
        assert 100 < event.t < 110
        assert event.t_std == pytest.approx(10 / math.sqrt(12), rel=0.02)
        assert abs(event.t - onset) < math.sqrt(3.5) * event.t_std


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"observer": {"window": 35}}, "observer.window must be a multiple of output.period = 10.0 for operator 'samples'; got 35.0."),
        ({"observer": {"weighting": "plain"}}, "observer.weighting must be 'gls' for operator 'samples'; got 'plain'."),
        ({"output": {"noise_std": [0], "noise_cv": [0]}}, "output.noise_std must be > 0 for operator 'samples'; got 0 for output 1."),
    ],
)  # fmt: skip
def test_bad_input_has_its_line(body: dict[str, Any], changes: Any, line: str) -> None:
    wrong = copy.deepcopy(body)
    for block, entries in changes.items():
        wrong[block] |= entries
    with pytest.raises(obsdesign.InputError) as error:
        obsdesign.investigate(obsdesign.Problem.from_dict(wrong))
    assert str(error.value) == line


def test_an_output_of_zero_with_proportional_noise_is_not_exact(body: dict[str, Any]) -> None:
    still = copy.deepcopy(body)
    still["output"] |= {"noise_std": [0.0], "noise_cv": [0.1]}
    del still["flow"]["disturbance"]
    observer = from_design(designed(still))
    t = 10.0 * np.arange(30)
    assert not observer.run_batch(t, np.zeros((30, 1))).events
    x = record(still["flow"]["A"], still["jump"]["H"], [(104.0, 2.0)], t, [0.0, 0.0])
    (event,) = observer.run_batch(t, x[:, 1:]).events
    assert event.t == pytest.approx(104, abs=4)


def test_a_window_of_very_many_samples_is_looked_at_in_some(body: dict[str, Any]) -> None:
    fine = copy.deepcopy(body)
    fine["output"]["period"] = 1e-5
    fine["observer"]["window"] = 40.0
    problem = obsdesign.Problem.from_dict(fine)
    gains = next(synthesis.synthesize(problem)).gains
    stored = gains.to_document()
    verdicts = {c.id: c.verdict for c in verification.claims(problem, stored, {})}
    assert set(verdicts.values()) == {"proved"}
    # the twin: what a few samples cannot show at all is not called impossible for all of them
    A, C = np.array([[0.0, np.pi], [-np.pi, 0.0]]), np.array([[1.0, 1.0]])
    H = np.array([[1.0], [2.0]])
    for window, words in ((64.0, "refuted"), (128.0, "undecided")):
        turning = replace(gains, A=A, C=C, H=H, period=1.0, window=window)
        every = sampled_claims(turning, 200.0)
        assert next(c for c in every if c.id == "rank").verdict == words


DEPOT: dict[str, Any] = {
    "flow": {"A": [[-0.2, 0], [0.2, -0.0138629436111989]]},
    "jump": {"H": [[1], [0]], "dwell_time": [100, "inf"]},
    "output": {"C": [[0, 1]], "noise_std": [0.02], "measured": "periodic", "period": 10},
    "observer": {"kind": "impulsive_input", "operator": "samples"},
}


def depot_record(unit: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """(times, samples) of three impulses."""
    A, H = np.array(DEPOT["flow"]["A"]), np.array([[1.0], [0.0]])
    t = np.arange(0.0, 560.0, 10.0)
    x = record(A, H, [(153.0, 1.5), (300.0, 1.0), (430.0, 2.0)], t, np.zeros(2))
    return t * unit, x[:, 1:] + 0.02 * np.random.default_rng(0).standard_normal((len(t), 1))


@pytest.mark.parametrize("missing", [(16, 17, 18), (17, 18, 19), (17, 18, 19, 20), (31, 32, 33)])
def test_rows_that_are_missing_after_an_impulse_leave_numbers(missing: tuple[int, ...]) -> None:
    """Onsets that no sample sees are ruled out, not undefined."""
    design = designed(DEPOT)
    t, y = depot_record()
    y[list(missing)] = np.nan
    rows = list(from_design(design).run(from_design(design).init(0.0), rows_of(t, y)))
    assert all(np.isfinite(row.x).all() for row in rows)
    events = events_of(rows)
    assert len(events) == 3
    for event, (at, weight) in zip(events, ((153, 1.5), (300, 1.0), (430, 2.0)), strict=True):
        assert abs(event.t - at) <= 6 * event.t_std
        assert abs(event.weights[0] - weight) <= 6 * event.weights_std[0]


@pytest.mark.parametrize("bits", [-43, -36, 36])
def test_the_unit_of_time_does_not_matter(bits: int) -> None:
    """Down to samples 1e-12 apart."""
    unit = 2.0**bits
    body = copy.deepcopy(DEPOT)
    body["flow"]["A"] = (np.array(DEPOT["flow"]["A"]) / unit).tolist()
    body["jump"]["dwell_time"] = [100 * unit, "inf"]
    body["output"]["period"] = 10 * unit
    events = []
    for problem, time in ((DEPOT, 1.0), (body, unit)):
        design = designed(problem)
        t, y = depot_record(time)
        events.append(events_in(from_design(design), t, y))
    for ours, scaled in zip(*events, strict=True):
        assert scaled.t == pytest.approx(ours.t * unit, rel=1e-9)
        assert scaled.t_std == pytest.approx(ours.t_std * unit, rel=1e-6)
        assert scaled.weights == pytest.approx(ours.weights, rel=1e-6)
        assert ours.status == scaled.status
