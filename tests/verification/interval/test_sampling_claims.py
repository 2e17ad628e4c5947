"""Claims about samples: tubes of samples and jumps, step limits; brute force, forgeries, refusals."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.data.simulation import simulate
from obsdesign.design_file import from_dict
from obsdesign.document import digest
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.runtime import Sample, from_design
from obsdesign.synthesis.interval.candidates import synthesize
from obsdesign.verification.interval.claims import claims

PERIODIC: dict[str, Any] = {
    "flow": {"A": [[-1, 0], [1, -2]], "disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}},
    "jump": {"G": [[2, 1], [1, 3]], "dwell_time": [1.0, 3.0],
             "disturbance": {"lower": [-0.3] * 2, "upper": [0.3] * 2}},
    "output": {"C": [[0, 1]], "noise_bound": [0.03], "measured": "periodic", "period": 0.1},
    "observer": {"kind": "interval", "form": "cooperative", "gains": {"L": [[0], [1]]}},
}  # fmt: skip


def problem_with(**changes: Any) -> obsdesign.Problem:
    body = copy.deepcopy(PERIODIC)
    for path, value in changes.items():
        block, key = path.split("__")
        body[block][key] = value
    return obsdesign.Problem.from_dict(body)


def claim(outcome: obsdesign.Outcome, name: str) -> obsdesign.Claim:
    return next(c for c in outcome.claims if c.id == name)


def test_no_jump_between_samples_leaves_the_tube() -> None:
    outcome = obsdesign.investigate(problem_with())
    assert outcome.verdict == "proved"
    assert obsdesign.verify(outcome.design).verdict == "proved"
    evidence = claim(outcome, "sampled_stability").evidence
    system = WidthSystem.from_gains(IntervalGains.from_document(outcome.design.gains))
    Z = np.zeros((3, 3))
    Z[:2, :2], Z[:2, 2] = system.W, system.f
    rng, h = np.random.default_rng(0), 0.1
    w, t, following = 5 * np.array(evidence["tube"]), 0.0, rng.uniform(1, 3)
    for k in range(1, 1500):
        end = round(k * h, 9)
        while following <= end:
            step = expm(Z * (following - t))
            w, t = step[:2, :2] @ w + step[:2, 2], following
            w = system.N @ w + system.h
            if k > 500:
                assert np.all(w <= evidence["after_jump"])
            following += rng.choice([1.0, 3.0, rng.uniform(1, 3)])
        step = expm(Z * (end - t))
        w, t = step[:2, :2] @ w + step[:2, 2], end
        if k > 500:
            assert np.all(w <= evidence["always"])
        w = system.K @ w + system.k
        if k > 500:
            assert np.all(w <= evidence["after_sample"])


@pytest.mark.parametrize("name", ["tube", "sampled", "jumped", "always"])
def test_a_forged_tube_of_samples_is_not_proved(name: str) -> None:
    problem = problem_with()
    candidate = next(iter(synthesize(problem)))
    for change in (lambda v: [0.5 * x for x in v], lambda v: v[:1], lambda v: None):
        forged = copy.deepcopy(dict(candidate.certificates))
        forged["sampled_stability"][name] = change(forged["sampled_stability"][name])
        again = claims(problem, candidate.document(), forged)
        assert again[-1].id == "sampled_stability"
        assert again[-1].verdict == "undecided"


def test_jumps_closer_than_samples_are_undecided_and_still_enclosed() -> None:
    outcome = obsdesign.investigate(problem_with(jump__dwell_time=[0.05, 1.0]))
    assert outcome.verdict == "undecided"
    assert outcome.design.guarantees[0].given
    assert not outcome.design.guarantees[1].given


def test_a_mode_that_samples_do_not_hold_is_refuted() -> None:
    # x1 grows and is never measured: from sample to sample its width does not shrink
    outcome = obsdesign.investigate(
        problem_with(flow__A=[[0.5, 0], [1, -2]], jump__dwell_time=[1.0, "inf"])
    )
    stability = claim(outcome, "sampled_stability")
    assert stability.verdict == "refuted"
    assert stability.evidence["witness"]["theta"] == 0.1


def test_a_step_limit_is_proved_and_forged_ones_are_not() -> None:
    body = copy.deepcopy(PERIODIC)
    body["output"]["measured"] = "continuous"
    body["observer"]["gains"]["M"] = [[1], [2.8]]
    problem = obsdesign.Problem.from_dict(body)
    outcome = obsdesign.investigate(problem)
    width = claim(outcome, "sampled_width")
    assert width.verdict == "proved"
    assert width.evidence["step_limit"] == 0.1  # the period that the file names
    candidate = next(iter(synthesize(problem)))
    forged = copy.deepcopy(dict(candidate.certificates))
    forged["sampled_width"]["step_limit"] = 3.0
    again = claims(problem, candidate.document(), forged)
    assert next(c for c in again if c.id == "sampled_width").verdict == "undecided"


def lost_problem(dwell: list[Any], when: str = "none") -> obsdesign.Problem:
    gains = {"L": [[0], [1]], "M": [[0], [0]]}
    return problem_with(
        jump__dwell_time=dwell, output__jump_measurement=when, observer__gains=gains
    )


def test_a_sample_that_a_jump_takes_away_is_covered() -> None:
    outcome = obsdesign.investigate(lost_problem([1.0, 3.0]))
    assert outcome.verdict == "proved"
    assert obsdesign.verify(outcome.design).verdict == "proved"
    evidence = claim(outcome, "sampled_stability").evidence
    with_sample = obsdesign.investigate(lost_problem([1.0, 3.0], "before"))
    assert np.all(
        evidence["after_sample"] >= claim(with_sample, "sampled_stability").evidence["sampled"]
    )
    system = WidthSystem.from_gains(IntervalGains.from_document(outcome.design.gains))
    Z = np.zeros((3, 3))
    Z[:2, :2], Z[:2, 2] = system.W, system.f
    step = expm(Z * 0.1)
    rng, w, following = np.random.default_rng(1), 5 * np.array(evidence["tube"]), 10
    worst = np.zeros(2)
    for k in range(1, 1500):
        w = step[:2, :2] @ w + step[:2, 2]
        if k == following:  # the jump instead of the sample
            w = system.N @ w + system.h
            following += int(rng.choice([10, 11, 30])) if k < 700 else 10
            assert k < 500 or np.all(w <= evidence["after_jump"])
            continue
        assert k < 500 or np.all(w <= evidence["always"])
        w = system.K @ w + system.k
        if k > 500:
            assert np.all(w <= evidence["after_sample"])
            worst = np.maximum(worst, w)
    # what is proved is for dwell times up to a period shorter: the offset of jumps is not followed
    assert np.all(worst > 0.5 * np.array(evidence["after_sample"]))


def test_all_samples_may_be_lost_to_jumps() -> None:
    outcome = obsdesign.investigate(lost_problem([0.1, 3.0]))
    stability = claim(outcome, "sampled_stability")
    assert stability.verdict == "undecided"


@pytest.mark.parametrize("dwell", [[1.0, 1.0], [0.9, 0.9], [0.95, 2.0]])
def test_rows_beside_lost_samples_are_in_order(dwell: list[float]) -> None:
    problem = lost_problem(dwell)
    outcome = obsdesign.investigate(problem)
    assert outcome.verdict == "proved"
    rng = np.random.default_rng(3)
    record = simulate(problem.plant, until=15.0, initial=[1.0, 1.0], disturbance="extreme", rng=rng)
    observer = from_design(outcome.design)
    batch = observer.run_batch(
        record.t, record.block("y"), jump=record.columns["jump"], lower=[1, 1], upper=[1, 1]
    )
    assert set(batch.status) == {"ok"}
    always = np.array(claim(outcome, "sampled_stability").evidence["always"])
    assert np.all(batch.upper - batch.lower <= always * (1 + 1e-12))
    # a sample that is missing beside the lost one is still said
    y = record.block("y").copy()
    jump = int(np.flatnonzero(record.columns["jump"])[2])
    y[jump + 1] = np.nan
    late = observer.run_batch(record.t, y, jump=record.columns["jump"], lower=[1, 1], upper=[1, 1])
    assert late.status[jump + 1] == "missing sample"
    assert "since the last sample" in late.status[jump + 2]


@pytest.mark.parametrize("start", [0.0, 1e7, 1.7e9])
def test_time_stamps_far_from_zero_are_in_time(start: float) -> None:
    outcome = obsdesign.investigate(problem_with())
    observer = from_design(outcome.design)
    state = observer.init(start, lower=[-1, -1], upper=[1, 1])
    for k in range(1, 60):
        t = start + round(0.1 * k, 10)
        state, row = observer.step(state, Sample(t, [0.0]))
        assert "since the last sample" not in row.status
    state, row = observer.step(state, Sample(start + 6.1, [0.0]))
    assert "since the last sample" in row.status


def test_a_step_beyond_the_one_that_was_proved_is_said() -> None:
    body = copy.deepcopy(PERIODIC)
    body["output"]["measured"] = "continuous"
    body["observer"]["gains"]["M"] = [[1], [2.8]]
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert outcome.design.gains["step_limit"] == 0.1
    assert obsdesign.verify(outcome.design).verdict == "proved"
    observer = from_design(outcome.design)
    state = observer.init(0.0, lower=[-1, -1], upper=[1, 1])
    state, row = observer.step(state, Sample(0.1, [0.0]))
    state, row = observer.step(state, Sample(0.2, [0.0]))
    assert row.status == "ok"
    state, row = observer.step(state, Sample(0.4, [0.0]))
    assert row.status == "step 0.2 above 0.1: no width is guaranteed"
    # without a spacing in the file nothing is promised for one, and nothing watched
    del body["output"]["period"]
    assert "step_limit" not in obsdesign.design(obsdesign.Problem.from_dict(body)).gains


def test_a_step_limit_in_the_gains_is_the_one_that_is_proved() -> None:
    body = copy.deepcopy(PERIODIC)
    body["output"]["measured"] = "continuous"
    body["observer"]["gains"]["M"] = [[1], [2.8]]
    whole = obsdesign.design(obsdesign.Problem.from_dict(body)).to_dict()
    whole["gains"]["step_limit"] = 3.0
    assert obsdesign.verify(from_dict({**whole, "digest": digest(whole)})).verdict != "proved"
