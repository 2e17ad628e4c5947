"""What the guarantee promises holds, and what cannot hold is not promised."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.equations.impulsive_input.evaluation_rule import reason_against_exponents
from obsdesign.equations.impulsive_input.features import (
    feature_scales,
    filtered_system,
    window_matrix,
)
from obsdesign.runtime import from_design
from obsdesign.verification.impulsive_input import claims as verification
from obsdesign.verification.impulsive_input.window import shown
from tests.systems.impulsive_input import CHAIN, observer_of, record

TRAIN = ((20.0, 1.0), (50.0, 2.0), (80.0, -3.0), (120.0, 1.0))
SLOW = [-0.65, -0.7, -0.75, -0.8, -0.85, -0.9]
LH = Path(__file__).parents[3] / "examples" / "luteinizing_hormone.toml"


def chain(period: float = 0.05, **options: Any) -> dict[str, Any]:
    body = copy.deepcopy(CHAIN)
    body["output"]["period"] = period
    body["observer"] |= options
    return body


def claims_of(body: dict[str, Any]) -> tuple[Any, dict[str, str]]:
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    return outcome, {claim.id: claim.verdict for claim in outcome.claims}


def observed_run(
    body: dict[str, Any], train: Any = TRAIN, until: float = 160.0, **hidden: Any
) -> Any:
    observer = observer_of(body)
    h = body["output"]["period"]
    t = np.round(h * np.arange(round(until / h) + 1), 10)
    x = record(np.array(body["flow"]["A"]), body["jump"]["H"], train, t, [1, 1, 1])
    y = x @ np.array(body["output"]["C"], float).T
    if hidden:
        absent = np.random.default_rng(hidden["seed"]).random(len(t)) < hidden["share"]
        absent[0] = False
        y[absent] = np.nan
    return observer.run_batch(t, y, x=[1, 1, 1]), (t, x, y)


def assert_train(events: Any, train: Any = TRAIN, tolerance: float = 1e-4) -> None:
    assert len(events) == len(train)
    for event, (moment, weight) in zip(events, train, strict=True):
        assert event.status == "ok"
        assert event.t == pytest.approx(moment, abs=tolerance)
        assert event.weights[0] == pytest.approx(weight, abs=tolerance)


# --- growing exponents ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "exponents", [[-5, -1, 0, 0.5, 1, 2], [-2, -1, 0, 0.3, 0.6, 1], [0, 0.1, 0.2, 0.3, 0.4, 0.5]]
)
def test_growing_exponents_find_what_falling_ones_find(exponents: list[float]) -> None:
    assert_train(observed_run(chain(exponents=exponents))[0].events)


def test_exponents_that_binary64_cannot_follow_are_refused() -> None:
    steep = [0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
    with pytest.raises(obsdesign.InputError, match=r"at most 6 / window = 0\.3; got 0"):
        obsdesign.design(obsdesign.Problem.from_dict(chain(exponents=steep)))
    assert reason_against_exponents(np.array(steep), 3, 1, 20.0)
    assert reason_against_exponents(np.array([*steep, -1, -2, -3]), 3, 1, 20.0) is None


def test_scales_multiply_features_and_nothing_else() -> None:
    D, C = np.array([[-0.3, 1.0], [0.0, -0.2]]), np.array([[1.0, 0.0], [0.0, 1.0]])
    lams, tau = np.array([-1.0, 0.5, 2.0]), 4.0
    scales = feature_scales(lams, tau)
    assert scales[0] == 1
    whole = window_matrix(D, C, lams, tau)
    np.testing.assert_allclose(
        window_matrix(D, C, lams, tau, scales), np.tile(scales, 2)[:, None] * whole, rtol=1e-12
    )
    np.testing.assert_array_equal(
        filtered_system(D, C, lams, np.ones(3)), filtered_system(D, C, lams)
    )


# --- rows without measurement -------------------------------------------------------------------------


@pytest.mark.parametrize(("period", "share"), [(0.1, 0.1), (0.5, 0.3), (1.0, 0.1)])
def test_missing_samples_change_nothing(period: float, share: float) -> None:
    train = ((33.3, 4.0), (71.7, 5.0), (122.1, -7.0))
    run, (t, x, y) = observed_run(chain(period, exponents=SLOW), train, seed=1, share=share)
    assert_train(run.events, train, 1e-5)
    absent = np.isnan(y[:, 0])
    reported = np.array(["missing sample" in status for status in run.status])
    np.testing.assert_array_equal(reported, absent)
    # missing rows too, also those right after an impulse
    settled = (t > 5) & (t < 100) & (np.abs(t[:, None] - np.array(train)[:, 0]) > 1e-6).all(axis=1)
    np.testing.assert_allclose(run.x[settled], x[settled], atol=1e-3)


def test_known_inputs_of_missing_rows_count() -> None:
    body = chain(0.25, exponents=SLOW)
    body["flow"]["B"] = [[0.0], [1.0], [0.0]]
    observer = observer_of(body)
    t = 0.25 * np.arange(481)
    rng = np.random.default_rng(7)
    u = rng.standard_normal(len(t))
    A, H = np.array(body["flow"]["A"]), body["jump"]["H"]
    x, pieces = np.array([[1.0, 2.0, 3.0]]), []
    for k in range(len(t) - 1):
        train = [(at, g) for at, g in ((30.1, 3.0), (70.2, -2.0)) if t[k] < at <= t[k + 1]]
        pieces.append(record(A, H, train, t[k : k + 2], x[-1], [0, u[k], 0])[1])
        x = np.vstack([x, pieces[-1]])
    y = x[:, 2:].copy()
    y[(rng.random(len(t)) < 0.2) & (t > 0)] = np.nan
    run = observer.run_batch(t, y, u[:, None], x=[1, 2, 3])
    # the input is constant between rows, its response no exact line: the free run knows to 1e-3
    assert_train(run.events, ((30.1, 3.0), (70.2, -2.0)), 2e-2)


# --- what is promised -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("period", "verdict"), [(30.0, "refuted"), (12.0, "refuted"),
                                                 (8.0, "undecided"), (4.0, "undecided"), (2.5, "proved")])  # fmt: skip
def test_samples_of_a_window_are_a_claim(period: float, verdict: str) -> None:
    outcome, verdicts = claims_of(chain(period, exponents=SLOW))
    assert verdicts["samples"] == verdict
    if verdict == "proved":
        assert outcome.verdict == "proved"
        assert_train(observed_run(chain(period, exponents=SLOW))[0].events)
    else:
        assert outcome.verdict != "proved"


def promise(body: dict[str, Any]) -> str:
    return str(claims_of(body)[0].design.guarantees[0].statement)


def test_the_promise_names_its_conditions() -> None:
    plain = promise(chain(exponents=SLOW))
    assert "found at their times" in plain
    assert "nonnegative" not in plain
    assert "impulses of nonnegative weight" in promise(chain(exponents=SLOW, nonnegative=True))
    body = chain(exponents=[-2.65, -2.7, -2.75, -2.8, -2.85, -2.9], threshold=33.4,
                 gains={"K": [[0.0002], [0.0048], [0.02]]})  # fmt: skip
    outcome, _ = claims_of(body)
    assert "first exceed the threshold 33.4" in outcome.design.guarantees[0].statement
    evidence = next(claim for claim in outcome.claims if claim.id == "uniqueness").evidence
    # 33.4 over the largest |b|, 11.026520
    assert evidence["approx_expected"]["smallest_weight"] == pytest.approx(3.029060, abs=1e-4)
    noisy = chain(exponents=SLOW)
    noisy["output"]["noise_std"] = [0.3]
    assert "found at their times" not in promise(noisy)
    assert "is not reported" in promise(noisy)
    assert "is not reported" in promise(obsdesign.load_problem(LH).to_dict())


def test_no_false_impulse_after_large_ones_in_other_units() -> None:
    S = np.diag([1e-4, 1, 1e4])
    body = chain(0.01)
    del body["observer"]["window"], body["observer"]["margin"]
    A, H, C = (np.array(v, float) for v in (body["flow"]["A"], body["jump"]["H"], [[0, 0, 1]]))
    body["flow"]["A"] = (S @ A @ np.linalg.inv(S)).tolist()
    body["jump"]["H"], body["output"]["C"] = (S @ H).tolist(), (C @ np.linalg.inv(S)).tolist()
    t = np.round(0.01 * np.arange(20001), 10)
    x = record(A, H, TRAIN, t, [1, 1, 1])
    assert_train(observer_of(body).run_batch(t, x[:, 2:], x=S @ [1, 1, 1]).events)


def test_an_onset_that_samples_hide_lies_in_its_interval() -> None:
    rng = np.random.default_rng(5)
    for _ in range(3):
        T = rng.standard_normal((2, 2))
        A = T @ np.diag(-rng.uniform(0.1, 1, 2)) @ np.linalg.inv(T)
        C, h = rng.standard_normal((2, 2)), 0.05
        body = {
            "flow": {"A": A.tolist()}, "jump": {"H": [[1, 0], [0, 1]], "dwell_time": [6.0, "inf"]},
            "output": {"C": C.tolist(), "measured": "periodic", "period": h},
            "observer": {"kind": "impulsive_input"},
        }  # fmt: skip
        train = [(3.2157, [1.0, -2.0]), (12.3068, [-1.2, -1.7]), (21.377, [-2.3, 0.9])]
        t = np.round(h * np.arange(721), 10)
        x = record(A, np.eye(2), train, t, [0.5, -1.0])
        events = observer_of(body).run_batch(t, x @ C.T, x=x[0]).events
        cells = [np.ceil(event.t / h - 1e-7) for event in events]
        assert cells == [np.ceil(at / h) for at, _ in train]
        assert {event.status for event in events} == {"ok"}


# --- files that somebody else wrote -----------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes",
    [
        {"rule": "position"},
        {"exponents": np.array([14, 14.1, 14.2, 14.3, 14.4, 14.5])},
        {"exponents": np.array([-0.01, -0.02, -0.03, -0.04, -0.05, -0.06])},
        {"exponents": ["a"]}, {"exponents": np.array([])}, {"exponents": np.array([np.inf, -1])},
        {"window": "inf"}, {"window": np.inf}, {"rule": 3}, {"margin": 1e3},
    ],
)  # fmt: skip
def test_gains_that_do_not_fit_are_refuted(changes: dict[str, Any]) -> None:
    problem = obsdesign.Problem.from_dict({**chain(), "observer": {"kind": "impulsive_input"}})
    gains = dict(obsdesign.design(problem).gains)
    assert all(c.verdict == "proved" for c in verification.claims(problem, gains, {}))
    (only,) = verification.claims(problem, gains | changes, {})
    assert (only.id, only.verdict) == ("consistent", "refuted")


@pytest.mark.parametrize(
    "changes",
    [{"window": 35.0}, {"window": 15.1}, {"window": 4.0}, {"weighting": "plain"}, {"margin": 9.0}],
)
def test_gains_of_samples_that_do_not_fit_are_refuted(changes: dict[str, Any]) -> None:
    body = obsdesign.load_problem(LH).to_dict()
    del body["observer"]["window"]
    problem = obsdesign.Problem.from_dict(body)
    gains = dict(obsdesign.design(problem).gains)
    assert all(c.verdict == "proved" for c in verification.claims(problem, gains, {}))
    (only,) = verification.claims(problem, gains | changes, {})
    assert (only.id, only.verdict) == ("consistent", "refuted")
    if "window" in changes:
        with pytest.raises(ValueError, match=r"multiple of gains\.period"):
            from_design(obsdesign.design(problem)).from_gains(gains | changes)


def test_a_gap_longer_than_the_window() -> None:
    data = np.loadtxt(LH.with_suffix(".csv"), delimiter=",", skiprows=1)
    observer = from_design(obsdesign.design(obsdesign.load_problem(LH)))
    whole = observer.run_batch(data[:, 0], data[:, 1:])
    left = data[(data[:, 0] < 100) | (data[:, 0] > 250)]
    run = observer.run_batch(left[:, 0], left[:, 1:])
    np.testing.assert_array_equal(run.t, left[:, 0])
    assert run.events[0].t == whole.events[0].t
    assert [e.t for e in run.events[-2:]] == pytest.approx(
        [e.t for e in whole.events[-2:]], abs=0.5
    )
    assert all(event.t_std > 10 for event in run.events if 90 < event.t < 250)


@pytest.mark.parametrize(
    ("block", "entries", "words"),
    [
        (
            "output",
            {"measured": "continuous", "period": None},
            "output.measured must be 'periodic'",
        ),
        ("observer", {"margin": 5.0}, "observer.margin belongs to operator 'integral'"),
        ("observer", {"state_correction": False}, "always corrects the state"),
    ],
)
def test_what_samples_cannot_use_is_refused(block: str, entries: Any, words: str) -> None:
    body = obsdesign.load_problem(LH).to_dict()
    body[block] |= entries
    body[block] = {name: value for name, value in body[block].items() if value is not None}
    with pytest.raises(obsdesign.InputError, match=words):
        obsdesign.design(obsdesign.Problem.from_dict(body))


def test_an_output_of_zeros_is_refuted() -> None:
    body = chain(exponents=SLOW, gains={"K": [[0.0], [0.0], [0.0]]})
    body["output"]["C"] = [[0, 0, 0]]
    outcome, verdicts = claims_of(body)
    assert {verdicts["observable"], verdicts["rank"]} == {"refuted"}
    rank = next(claim for claim in outcome.claims if claim.id == "rank")
    assert rank.evidence["witness"]["vector"] == [1.0, 0.0, 0.0]  # a state that C does not show


@pytest.mark.parametrize("cells", [3.5, 4.3, 6.5])
@pytest.mark.parametrize("seed", [1, 2])
def test_few_samples_leave_room_for_the_next_impulse(cells: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = np.array([[-rng.uniform(0.05, 0.2), 0], [rng.uniform(0.5, 2), -rng.uniform(0.05, 0.3)]])
    H, C = np.array([[1.0], [0.0]]), np.array([[0.0, 1.0]])
    for slack, wanted in ((2.01, "proved"), (0.02, "undecided")):
        period = 10 / (cells + slack)
        body = {
            "flow": {"A": A.tolist()}, "jump": {"H": H.tolist(), "dwell_time": [10, "inf"]},
            "output": {"C": C.tolist(), "measured": "periodic", "period": period},
            "observer": {"kind": "impulsive_input", "window": cells * period,
                         "operator": "integral"},
        }  # fmt: skip
        outcome, verdicts = claims_of(body)
        assert verdicts["samples"] == wanted
        if wanted != "proved" or outcome.verdict != "proved":
            continue
        onsets = 11 + np.cumsum(10 + rng.uniform(0, 0.5, 6) * (rng.random(6) < 0.6))
        train = list(zip(onsets, rng.uniform(1, 5, 6), strict=True))
        t = period * np.arange(int(120 / period))
        events = (
            from_design(outcome.design).run_batch(t, record(A, H, train, t, [0, 0]) @ C.T).events
        )
        for event, (onset, weight) in zip(events, train[:-1], strict=False):
            assert event.t == pytest.approx(onset, abs=1e-4)
            assert event.weights[0] == pytest.approx(weight, abs=1e-4)
        assert len(events) >= 5


def test_directions_are_shown_with_their_largest_entry_one() -> None:
    assert shown([0.5, -2.0, 0.0]) == "[0.25, -1, 0]"
    assert shown([1.0, 3.0]) == "[0.3333, 1]"
    assert shown([0.0, 0.0]) == "[0, 0]"
    assert shown([]) == "[]"


def test_samples_determine_an_impulse_in_the_first_interval_alone() -> None:
    """Later in a window of two samples other impulses leave the same two."""

    def y(since: float) -> float:
        return math.exp(-since) - 3 * math.exp(-3 * since)

    body: dict[str, Any] = {
        "flow": {"A": [[-1.0, 0], [0, -3.0]]},
        "jump": {"H": [[1.0], [1.0]], "dwell_time": [3.1, "inf"]},
        "output": {"C": [[1.0, -3.0]], "noise_std": [1e-4], "measured": "periodic", "period": 1.0},
        "observer": {"kind": "impulsive_input", "window": 2.0},
    }
    design = obsdesign.design(obsdesign.Problem.from_dict(body))
    assert (design.gains["operator"], design.gains["window"]) == ("samples", 2.0)
    first = 1 - math.log(3) / 2  # leaves nothing at the first sample
    assert y(1 - first) == pytest.approx(0, abs=1e-12)
    assert y(2 - first) / y(2 - 1.2) > 1  # a weight that the guarantee must not exclude at 1.2
    assert "that holds one impulse, between its first two samples, determines" in (
        design.guarantees[0].statement
    )
    # the twin: integrals of y
    body["observer"]["operator"] = "integral"
    body["output"]["period"] = 0.05
    statement = obsdesign.design(obsdesign.Problem.from_dict(body)).guarantees[0].statement
    assert "of a window that holds one impulse determines its time and weight" in statement


@pytest.mark.parametrize(
    ("response", "rows", "dwell", "verdict"),
    [([1.0, -3.0], 1, 2.1, "undecided"), ([1.0, 2.0], 1, 2.1, "undecided"),
     ([1.0, -3.0], 1, 3.1, "proved"), ([1.0, -3.0], 2, 2.1, "proved")],
)  # fmt: skip
def test_samples_as_few_as_what_is_unknown_must_be_of_one_impulse(
    response: list[float], rows: int, dwell: float, verdict: str
) -> None:
    """Two impulses 2.11 apart leave three samples that one impulse at another time leaves too."""
    body = {
        "flow": {"A": [[-1.0, 0.0], [0.0, -3.0]]},
        "jump": {"H": [[1.0], [1.0]], "dwell_time": [dwell, "inf"]},
        "output": {"C": [response, [1.0, 1.0]][:rows], "noise_std": 1e-4, "measured": "periodic",
                   "period": 1.0},
        "observer": {"kind": "impulsive_input", "operator": "samples"},
    }  # fmt: skip
    outcome, verdicts = claims_of(body)
    assert verdicts["uniqueness"] == verdict
    assert {claim.verdict for claim in outcome.claims} == {"proved", verdict}
