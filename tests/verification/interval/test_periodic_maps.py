"""The maps of periodic samples: laws of the bounds, proof and runtime alike, the narrowest gains."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign
from lmi.arithmetic.balls import exact, precision, rational
from lmi.arithmetic.exponential import absolute_flow, expm
from lmi.bounds.mean_value import Time
from lmi.bounds.mean_value import absolute_flow as absolute_flow_in_balls
from lmi.time_budget import UNLIMITED
from obsdesign.runtime import Sample, from_design
from obsdesign.synthesis.interval.candidates import synthesize
from obsdesign.synthesis.interval.periodic import SampledPlant
from obsdesign.verification.interval.claims import claims
from tests.long.periodic_plants import random_problem

ROUNDING = 1e-12


def random_maps(seed: int, n: int) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n, n)), 2 * rng.standard_normal((n, n)), rng.random(n)


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4))
def test_the_bound_of_a_flow_is_between_the_integral_and_the_comparison_system(
    seed: int, n: int
) -> None:
    X, A, b = random_maps(seed, n)
    (sizes,), (added,) = absolute_flow(X, A, b, np.array([0.3]))
    np.testing.assert_allclose(sizes, np.abs(X @ expm(A * 0.3)), atol=ROUNDING)
    grid = np.linspace(0, 0.3, 601)
    rates = np.abs(X @ expm(A * grid[:, None, None])) @ b
    integral = (rates.sum(axis=0) - (rates[0] + rates[-1]) / 2) * (grid[1] - grid[0])
    Z = np.zeros((n + 1, n + 1))
    Z[:n, :n], Z[:n, n] = np.where(np.eye(n, dtype=bool), A, np.abs(A)), b
    wide = np.abs(X) @ expm(Z * 0.3)[:n, n]
    assert np.all(integral <= added * (1 + 1e-5))
    assert np.all(added <= wide * (1 + ROUNDING))
    # exact for positive systems
    positive = absolute_flow(np.abs(X), Z[:n, :n], b, np.array([0.3]))[1][0]
    np.testing.assert_allclose(positive, wide, rtol=1e-12)


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 3), rate=st.sampled_from([1.0, -1.0]))
def test_a_flow_on_a_range_of_times_is_enclosed(seed: int, n: int, rate: float) -> None:
    X, A, b = random_maps(seed, n)
    reach = 0.01
    with precision(128):
        time = Time(rational(0.25), reach, rational(rate))
        paths = absolute_flow_in_balls(exact(X), exact(A), exact(b), time)
        tops = [np.array([float(x.upper()) for x in path.upper(reach)]) for path in paths]
    seen = absolute_flow(X, A, b, np.linspace(0.24, 0.26, 101))
    for top, values in zip(tops, seen, strict=True):
        highest = values.max(axis=0).ravel()
        assert np.all(highest <= top * (1 + ROUNDING))
        assert np.all(top <= highest + 0.05 * values.max())


def no_jumps(seed: int) -> obsdesign.Problem:
    body = random_problem(np.random.default_rng(seed)).to_dict()
    del body["jump"]
    return obsdesign.Problem.from_dict(body)


@pytest.mark.parametrize("seed", range(4))
def test_no_other_gain_is_narrower(seed: int) -> None:
    rng = np.random.default_rng(seed)
    plant = SampledPlant(no_jumps(seed), None, UNLIMITED)
    L = plant.gain(1.0)
    if L is None:  # in these coordinates the step contracts with no gain
        trials = rng.standard_normal((200, *plant.C.T.shape)) * 3
        assert all(plant.width(trial) == np.inf for trial in trials)
        return
    width = plant.width(L)
    for size in (1e-3, 0.03, 1.0):
        for _ in range(30):
            other = L + size * rng.standard_normal(L.shape)
            assert width <= plant.width(other) * (1 + 1e-5)
    faster = plant.gain(0.75)
    if faster is not None:
        K = np.eye(len(plant.A)) - faster @ plant.C
        P = np.abs(K @ expm(plant.A * plant.h))
        assert max(abs(np.linalg.eigvals(P))) <= 0.75 * (1 + 1e-6)


DOUBLE: dict[str, Any] = {
    "flow": {"A": [[0, 1], [0, 0]], "disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}},
    "output": {"C": [[1, 0]], "noise_bound": [0.05], "measured": "periodic", "period": 0.2},
    "observer": {"kind": "interval", "form": "split", "gains": {"L": [[1], [4]]}},
}


def test_widths_are_those_of_the_runtime() -> None:
    # the proved width after samples is the one that a run comes to, not only above it
    design = obsdesign.design(obsdesign.Problem.from_dict(DOUBLE))
    evidence = next(c for c in design.claims if c.id == "sampled_stability").evidence
    observer = from_design(design)
    state = observer.init(0.0, lower=[-1, -9], upper=[1, 9])
    for k in range(1, 400):
        state, _ = observer.step(state, Sample(round(0.2 * k, 9), [0.0]))
    reached = -state.box[:2] - state.box[2:]
    np.testing.assert_allclose(reached, evidence["after_sample"], rtol=1e-5)
    assert np.all(reached <= evidence["after_sample"])


@pytest.mark.parametrize("extra", [(0.25, 0.5), (0.125, 0.5, 0.625)])
@pytest.mark.parametrize("seen", [True, False])
def test_rows_between_samples_do_not_widen(extra: Any, seen: bool) -> None:
    # |K e^(A h/2)| |e^(A h/2)| has an unstable power where |K e^(A h)| contracts
    design = obsdesign.design(obsdesign.Problem.from_dict(DOUBLE))
    evidence = next(c for c in design.claims if c.id == "sampled_stability").evidence
    observer, always = from_design(design), np.array(evidence["always"])
    state = observer.init(0.0, lower=[0, 0], upper=[0, 0])
    for k in range(60):
        for part in (0.0, *extra):
            y = [0.0] if part == 0.0 or seen else None
            if k == 0 and part == 0.0:
                continue
            state, row = observer.step(state, Sample(round(0.2 * (k + part), 9), y))
            assert row.status == ("ok" if y else "missing sample")
            assert np.all(row.upper - row.lower <= always * (1 + 1e-12))


def test_evidence_of_earlier_versions_is_about_the_comparison_system() -> None:
    # it names no maps: the wider system is proved, or nothing is
    for A, L, verdict in (([[-1, 0], [1, -2]], [[0], [1]], "proved"),
                          (DOUBLE["flow"]["A"], [[1], [4]], "undecided")):  # fmt: skip
        body = copy.deepcopy(DOUBLE)
        body["flow"]["A"], body["observer"]["gains"] = A, {"L": L}
        if verdict == "proved":
            body["output"]["C"] = [[0, 1]]
        asked = obsdesign.Problem.from_dict(body)
        candidate = next(iter(synthesize(asked)))
        merged = claims(asked, candidate.document(), candidate.certificates)[-1]
        assert merged.verdict == "proved"
        assert merged.evidence["maps"] in ("|(I - L C) e^(A s)|",)
        older = copy.deepcopy(dict(candidate.certificates))
        del older["sampled_stability"]["maps"]
        claim = claims(asked, candidate.document(), older)[-1]
        assert claim.verdict in (verdict, "refuted" if verdict == "undecided" else verdict)
        assert "w' = W w + f" in claim.statement
        assert "maps" not in claim.evidence


@pytest.mark.parametrize("name", ["tube", "sampled", "jumped", "always"])
def test_forged_bounds_of_merged_maps_are_not_proved(name: str) -> None:
    body = copy.deepcopy(DOUBLE)
    body["jump"] = {"G": [[1, 0], [0, 0.9]], "dwell_time": [1, "inf"],
                    "disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}}  # fmt: skip
    asked = obsdesign.Problem.from_dict(body)
    candidate = next(iter(synthesize(asked)))
    assert claims(asked, candidate.document(), candidate.certificates)[-1].verdict == "proved"
    forged = copy.deepcopy(dict(candidate.certificates))
    forged["sampled_stability"][name] = [0.99 * x for x in forged["sampled_stability"][name]]
    assert claims(asked, candidate.document(), forged)[-1].verdict == "undecided"
