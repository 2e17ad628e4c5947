"""How fast samples must be for integrals of them, and which operator is taken where they are not."""

from __future__ import annotations

import copy
import re
import warnings
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.equations.impulsive_input import sampling as equations
from obsdesign.runtime import from_design
from obsdesign.runtime.impulsive_input.history import short_dwell
from obsdesign.synthesis.impulsive_input.operator import jump_share
from obsdesign.synthesis.placement import placed_gain
from tests.systems.impulsive_input import CHAIN, record

TURNING: dict[str, Any] = {
    "flow": {"A": [[0, 1], [-6.29, -0.4]]},
    "jump": {"H": [[1], [0]], "dwell_time": [6, "inf"]},
    "output": {"C": [[1, 0]], "measured": "periodic"},
    "observer": {"kind": "impulsive_input"},
}
TRAIN = ((6.0, 1.0), (13.0, -2.0), (20.0, 3.0))


def turning(period: float, noise: float = 0.0, **options: Any) -> dict[str, Any]:
    body = copy.deepcopy(TURNING)
    body["output"]["period"] = period
    if noise:
        body["output"]["noise_std"] = [noise]
    body["observer"] |= options
    return body


def outcome(body: dict[str, Any]) -> tuple[Any, Any]:
    result = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    return result, next((claim for claim in result.claims if claim.id == "samples"), None)


def events(body: dict[str, Any], design: Any, shift: float, seed: int | None = None) -> list[Any]:
    h = body["output"]["period"]
    t = h * np.arange(round(30 / h))
    A, H, C = (
        np.array(body[a][b], float) for a, b in (("flow", "A"), ("jump", "H"), ("output", "C"))
    )
    y = record(A, H, [(at + shift, g) for at, g in TRAIN], t, np.zeros(len(A))) @ C.T
    if seed is not None:
        y = y + body["output"]["noise_std"][0] * np.random.default_rng(seed).standard_normal(
            y.shape
        )
    return list(from_design(design).run_batch(t, y, x=np.zeros(len(A))).events)


# --- integrals of samples -------------------------------------------------------------------------


@pytest.mark.parametrize("period", [0.05, 0.1, 0.15])
@pytest.mark.parametrize("window", [None, 2.0, 4.0])
def test_what_is_proved_misses_nothing(period: float, window: float | None) -> None:
    body = turning(period, operator="integral", **({} if window is None else {"window": window}))
    result, samples = outcome(body)
    assert samples.verdict == ("undecided" if (period, window) == (0.15, 4.0) else "proved")
    if window is None:  # six time constants, and no longer for the sake of many samples
        D = result.design.gains["A"] - result.design.gains["K"] @ result.design.gains["C"]
        slowest = -np.linalg.eigvals(D).real.max()
        assert result.design.gains["window"] == pytest.approx(6 / slowest, rel=1e-9)
    if samples.verdict != "proved":
        return
    for share in (0.0003, 0.3, 0.7):
        for event, (at, g) in zip(events(body, result.design, share * period), TRAIN, strict=True):
            assert event.t == pytest.approx(at + share * period, abs=1e-4)
            assert event.weights[0] == pytest.approx(g, abs=1e-4)


@pytest.mark.parametrize("period", [0.25, 0.3, 0.6])
@pytest.mark.parametrize("given", [False, True])
def test_samples_too_far_apart_are_undecided_with_a_period_that_does(
    period: float, given: bool
) -> None:
    gains = {"gains": {"K": [[7.0], [5.0]]}} if given else {"operator": "integral"}
    result, samples = outcome(turning(period, window=2.0, **gains))
    assert (result.verdict, samples.verdict) == ("undecided", "undecided")
    if "period" not in samples.evidence:  # too few samples of a window, whatever their distance
        assert period > 0.5
        return
    enough = samples.evidence["period"]
    assert f"at most {enough:g} would do" in samples.evidence["reason"]
    assert enough < period
    again, samples = outcome(turning(enough, window=2.0, **gains))
    assert (again.verdict, samples.verdict) == ("proved", "proved")


def test_the_refusal_without_noise_names_a_period_and_no_gain() -> None:
    with pytest.raises(obsdesign.InputError) as error:
        obsdesign.design(obsdesign.Problem.from_dict(turning(0.25)))
    text = str(error.value)
    assert "the fastest mode of A - K C times the period is 0.94" in text
    assert "gains.K" not in text
    enough = float(re.findall(r"output.period of at most ([0-9.]+)\.", text)[0])
    result, _ = outcome(turning(enough))
    assert (result.verdict, result.design.gains["operator"]) == ("proved", "integral")


def test_the_longest_period_scales_with_time_and_not_with_coordinates() -> None:
    rng = np.random.default_rng(3)
    D, T = -np.eye(3) + 0.3 * rng.standard_normal((3, 3)), rng.standard_normal((3, 3))
    exponents = np.array([-1.0, -20.0])
    for window in (2.0, 40.0):
        plain = equations.longest_period(D, exponents, window)
        turned = equations.longest_period(T @ D @ np.linalg.inv(T), exponents, window)
        assert turned == pytest.approx(plain, rel=1e-9)
        slow = equations.longest_period(D / 8, exponents / 8, 8 * window)
        assert slow == pytest.approx(8 * plain, rel=1e-9)
    assert equations.rounded_down(0.18999) == 0.189
    assert equations.rounded_down(2.5) <= 2.5


def test_what_is_given_speaks_of_integrals_and_not_of_samples() -> None:
    sentences = outcome(turning(0.1))[0].design.guarantees
    assert sentences[0].given
    assert (
        "with the integrals of y known exactly (y measured continuously)" in sentences[0].statement
    )
    (left,) = [sentence for sentence in sentences if sentence.claims == ("samples",)]
    assert not left.given
    assert "samples 0.1 apart reproduce these integrals is not claimed" in left.statement
    assert "A - K C times the period is 0.376" in left.statement
    # the twins: nothing is sampled, or the samples themselves are the features
    body = turning(0.1, noise=0.01)
    result, _ = outcome(body)
    assert not [
        sentence for sentence in result.design.guarantees if sentence.claims == ("samples",)
    ]
    assert "integrals of y" not in result.design.guarantees[0].statement
    body["output"] = {"C": [[1, 0]], "measured": "continuous"}
    result, _ = outcome(body)
    assert not [
        sentence for sentence in result.design.guarantees if sentence.claims == ("samples",)
    ]
    assert result.design.guarantees[0].given


def test_no_row_is_ok_that_floats_cannot_follow() -> None:
    body = copy.deepcopy(CHAIN)
    body["output"]["period"] = 0.01
    A, C = np.array(body["flow"]["A"]), np.array(body["output"]["C"], float)
    K = placed_gain(A, C, [-400.0, -440.0, -480.0])
    body["observer"] = {"kind": "impulsive_input", "window": 0.5, "gains": {"K": K.tolist()}}
    samples = outcome(body)[1]
    assert samples.verdict == "undecided"
    body["output"] = {"C": body["output"]["C"], "measured": "continuous"}
    problem = obsdesign.Problem.from_dict(body)
    observer = from_design(obsdesign.design(problem, allow_undecided=True))
    for step, followed in ((0.01, False), (0.001, True)):
        t = step * np.arange(8000)
        x = record(body["flow"]["A"], body["jump"]["H"], [(1.0, 1.0)], t, [0, 0, 0])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            run = observer.run_batch(t, x[:, 2:], x=[0, 0, 0])
        finite = np.isfinite(run.x).all(axis=1)
        assert finite.all() == followed
        assert all("too far apart for A - K C" in run.status[k] for k in np.flatnonzero(~finite))
        assert any("too far apart" in status for status in run.status) != followed


# --- noise, and an output that jumps --------------------------------------------------------------


@pytest.mark.parametrize("period", [0.05, 0.1])
def test_an_output_that_jumps_is_taken_as_samples_in_noise(period: float) -> None:
    body = turning(period, noise=0.1)
    result, _ = outcome(body)
    assert result.verdict == "proved"
    assert result.design.gains["operator"] == "samples"
    assert "the output jumps with an impulse, by 100%" in result.result["form"]
    errors = []
    for seed in range(3):
        fitted = events(body, result.design, 0.4 * period, seed)
        for at, _ in TRAIN:
            near = min(fitted, key=lambda event: abs(event.t - at - 0.4 * period))
            errors.append((near.t - at - 0.4 * period) / near.t_std)
    assert np.abs(errors).max() < 5
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 2


def test_noise_alone_makes_few_impulses_of_a_fine_record() -> None:
    body = turning(0.05, noise=0.1)
    observer = from_design(obsdesign.design(obsdesign.Problem.from_dict(body)))
    few = turning(0.05, noise=0.1, operator="samples", window=0.2)
    four = from_design(obsdesign.design(obsdesign.Problem.from_dict(few)))
    assert observer.engine.least_ratio == pytest.approx(12 + 2 * np.log(8))
    assert four.engine.least_ratio == 12.0
    t = 0.05 * np.arange(800)
    noise = [0.1 * np.random.default_rng(seed).standard_normal((800, 1)) for seed in range(3)]
    assert sum(len(observer.run_batch(t, y, x=[0, 0]).events) for y in noise) <= 1
    # the twin: what noise does not make is seen
    kicked = record(body["flow"]["A"], [[1], [0]], [(20.01, 0.7)], t, [0, 0])[:, :1] + noise[0]
    times = [event.t for event in observer.run_batch(t, kicked, x=[0, 0]).events]
    assert min(abs(at - 20.01) for at in times) < 0.2


@pytest.mark.parametrize(
    ("block", "entries"),
    [("jump", {"H": [[0], [1]]}), ("observer", {"operator": "integral"}), ("observer", {"margin": 0.3}),
     ("observer", {"window": 1.93}), ("observer", {"state_correction": False}),
     ("jump", {"H": [[1, 0], [0, 1]]})],
)  # fmt: skip
def test_integrals_are_kept_where_nothing_jumps_or_samples_cannot_do(
    block: str, entries: dict[str, Any]
) -> None:
    body = turning(0.1, noise=0.1)
    body[block] |= entries
    candidate = outcome(body)[0]
    assert candidate.claims[1].id == "observable"
    assert any(claim.id == "hurwitz" for claim in candidate.claims)


def test_how_much_an_output_jumps_does_not_depend_on_units() -> None:
    A, C, H = np.array([[0, 1], [-6.29, -0.4]]), np.array([[1.0, 0.2]]), np.array([[0.1], [1.0]])
    S = np.diag([1e-4, 1e3])
    share = jump_share(A, C, H, 2.0)
    assert 0.05 < share < 1
    back = np.linalg.inv(S)
    assert jump_share(S @ A @ back, 7 * C @ back, S @ H * 0.3, 2.0) == pytest.approx(share)
    assert jump_share(A, np.array([[1.0, 0.0]]), np.array([[0.0], [1.0]]), 2.0) == 0


# --- dwell times, and small impulses --------------------------------------------------------------


def test_a_dwell_time_is_too_short_beyond_the_deviations_of_both_times() -> None:
    assert short_dwell(0.0, 5.9, 6.0) == "dwell time 5.9 below 6"
    assert not short_dwell(0.0, 6.0, 6.0)
    assert not short_dwell(0.0, 5.9, 6.0, 0.03, 0.04)
    assert short_dwell(0.0, 5.8, 6.0, 0.03, 0.04)
    assert not short_dwell(-np.inf, 5.0, 6.0, 0.1, 0.0)
    assert not short_dwell(-9.1, -3.1 - 5e-9, 6.0)
    assert short_dwell(-9.1, -3.1 - 7e-9, 6.0)


def test_admissible_impulses_are_seldom_called_too_close() -> None:
    body = turning(0.25, noise=0.001)
    dwell = 6 * 0.25 * 1.001
    body["jump"]["dwell_time"] = [dwell, "inf"]
    observer = from_design(obsdesign.design(obsdesign.Problem.from_dict(body)))
    t, flagged = 0.25 * np.arange(120), 0
    for seed in range(3):
        rng = np.random.default_rng(seed)
        train = [(2 + seed / 9 + k * dwell, rng.uniform(1, 2)) for k in range(16)]
        y = record(body["flow"]["A"], body["jump"]["H"], train, t, [0, 0])[:, :1]
        run = observer.run_batch(t, y + 0.001 * rng.standard_normal(y.shape), x=[0, 0])
        flagged += sum("dwell time" in event.status for event in run.events)
        assert len(run.events) >= 16
    assert flagged == 0
    # the twin: half the dwell time is told
    train = [(2.0, 1.0), (2 + dwell, 1.5), (2 + 1.6 * dwell, 1.0)]
    y = record(body["flow"]["A"], body["jump"]["H"], train, t, [0, 0])[:, :1]
    run = observer.run_batch(t, y + 0.001 * rng.standard_normal(y.shape), x=[0, 0])
    assert any("dwell time" in event.status for event in run.events)


def test_the_promise_is_relative_to_the_whole_output() -> None:
    body = copy.deepcopy(CHAIN)
    body["flow"]["B"] = [[0], [0], [1.0]]
    del body["observer"]["window"], body["observer"]["margin"]
    design = obsdesign.design(obsdesign.Problem.from_dict(body))
    assert "and of the whole output, what known inputs make of it included" in (
        design.guarantees[0].statement
    )
    t = 0.05 * np.arange(3200)
    for forcing, wanted in ((1e3, 2), (1e6, 1)):  # .12 of 5e3 is promised, of 5e6 it is not
        x = record(body["flow"]["A"], body["jump"]["H"], [(30, 0.01), (70, 1.0)], t,
                   [0, 0, 0], [0, 0, forcing])  # fmt: skip
        u = np.full((len(t), 1), forcing)
        run = from_design(design).run_batch(t, x[:, 2:], u, x=[0, 0, 0])
        assert len(run.events) == wanted
        assert run.events[-1].t == pytest.approx(70, abs=1e-4 if wanted == 2 else 0.05)


@pytest.mark.parametrize(
    "changes",
    [{"H": [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]}, {"weighting": "plain"}],
    ids=str,
)  # fmt: skip
def test_an_operator_that_nobody_chose_is_not_named_alone(changes: dict[str, Any]) -> None:
    """Integrals do with a window of few samples where samples as they are cannot."""
    options, given = dict(changes), [[1.0], [0.0], [0.0]]
    body: dict[str, Any] = {
        "flow": {"A": [[-0.7, 0, 0], [1, -1.2, 0], [0, 1, -0.3]]},
        "jump": {"H": options.pop("H", given), "dwell_time": [5, "inf"]},
        "output": {"C": [[1, 0, 0], [0, 0, 1]], "noise_std": [0.01, 0.01], "measured": "periodic"},
        "observer": {"kind": "impulsive_input", **options},
    }
    body["output"]["period"] = 0.4
    design = obsdesign.design(obsdesign.Problem.from_dict(body))
    assert design.gains["operator"] == "integral"
    # the twin: samples so far apart that integrals cannot either; both operators are named
    body["output"]["period"] = 0.8
    with pytest.raises(obsdesign.InputError) as refusal:
        obsdesign.design(obsdesign.Problem.from_dict(body))
    assert "'samples'" in str(refusal.value)
    assert "It is chosen since the fastest mode of A - K C times the period is" in str(
        refusal.value
    )
    assert "'integral' needs an output.period of at most 0." in str(refusal.value)
