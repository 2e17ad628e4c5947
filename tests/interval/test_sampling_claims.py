"""Claims about samples: tubes of samples and jumps, step limits; brute force, forgeries, refusals."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.exponential import expm
from obsdesign.equations.interval_width import width_system_of
from obsdesign.synthesis.interval import synthesize
from obsdesign.verification.interval import claims

PERIODIC: dict[str, Any] = {
    "flow": {"A": [[-1, 0], [1, -2]], "disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}},
    "jump": {"G": [[2, 1], [1, 3]], "dwell_time": [1.0, 3.0],
             "disturbance": {"lower": [-0.3] * 2, "upper": [0.3] * 2}},
    "output": {"C": [[0, 1]], "noise_bound": [0.03], "measured": "periodic", "period": 0.1},
    "observer": {"kind": "interval", "form": "cooperative", "gains": {"L": [[0], [1]]}},
}  # fmt: skip


def problem(**changes: Any) -> obsdesign.Problem:
    body = copy.deepcopy(PERIODIC)
    for path, value in changes.items():
        block, key = path.split("__")
        body[block][key] = value
    return obsdesign.Problem.from_dict(body)


def claim(outcome: obsdesign.Outcome, name: str) -> obsdesign.Claim:
    return next(c for c in outcome.claims if c.id == name)


def test_no_jump_between_samples_leaves_the_tube() -> None:
    outcome = obsdesign.investigate(problem())
    assert outcome.verdict == "proved"
    assert obsdesign.verify(outcome.design).verdict == "proved"
    evidence = claim(outcome, "sampled_stability").evidence
    system = width_system_of(outcome.design.gains)
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
    asked = problem()
    candidate = next(iter(synthesize(asked)))
    for change in (lambda v: [0.5 * x for x in v], lambda v: v[:1], lambda v: None):
        forged = copy.deepcopy(dict(candidate.certificates))
        forged["sampled_stability"][name] = change(forged["sampled_stability"][name])
        found = claims(asked, candidate.gains, forged)
        assert found[-1].id == "sampled_stability"
        assert found[-1].verdict == "undecided"


def test_jumps_closer_than_samples_are_undecided_and_still_enclosed() -> None:
    outcome = obsdesign.investigate(problem(jump__dwell_time=[0.05, 1.0]))
    assert outcome.verdict == "undecided"
    assert outcome.design.guarantees[0]["given"]
    assert not outcome.design.guarantees[1]["given"]


def test_a_mode_that_samples_do_not_hold_is_refuted() -> None:
    # x1 grows and is never seen: from sample to sample its width does not shrink
    outcome = obsdesign.investigate(
        problem(flow__A=[[0.5, 0], [1, -2]], jump__dwell_time=[1.0, "inf"])
    )
    found = claim(outcome, "sampled_stability")
    assert found.verdict == "refuted"
    assert found.evidence["witness"]["theta"] == 0.1


def test_a_step_limit_is_proved_and_forged_ones_are_not() -> None:
    body = copy.deepcopy(PERIODIC)
    body["output"]["measured"] = "continuous"
    body["observer"]["gains"]["M"] = [[1], [2.8]]
    asked = obsdesign.Problem.from_dict(body)
    outcome = obsdesign.investigate(asked)
    found = claim(outcome, "sampled_width")
    assert found.verdict == "proved"
    assert found.evidence["step_limit"] == 0.1  # the period that the file names
    candidate = next(iter(synthesize(asked)))
    forged = copy.deepcopy(dict(candidate.certificates))
    forged["sampled_width"]["step_limit"] = 3.0
    again = claims(asked, candidate.gains, forged)
    assert next(c for c in again if c.id == "sampled_width").verdict == "undecided"
