"""Guaranteed widths: tubes proved, limits exact, simulation never wider; forgeries fail."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign
from lmi.arithmetic.balls import exact
from lmi.arithmetic.exponential import expm
from lmi.bounds.tube import Affine, periodic_limit, prove_below
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem, periodic_width
from obsdesign.synthesis.interval.candidates import synthesize
from obsdesign.verification.interval.claims import claims
from obsdesign.verification.interval.width import raised_product

TIGHT = 1e-4  # a proved bound is at most this much above the width that is reached


def random_system(rng: np.random.Generator, n: int) -> tuple[np.ndarray, ...]:
    """A positive system whose widths settle for dwell times in [0.2, 1.5]."""
    W = rng.random((n, n)) * rng.random()
    W -= np.diag(W.sum(axis=1) + rng.uniform(0.1, 1.0))
    N = rng.random((n, n))
    N *= rng.uniform(0.2, 0.95) / N.sum(axis=1).max()
    return W, N, rng.random(n), rng.random(n)


def body_of(W: Any, N: Any, f: Any, h: Any, dwell: list[Any]) -> dict[str, Any]:
    n = len(W)
    return {
        "flow": {"A": W, "disturbance": {"lower": np.zeros(n), "upper": f}},
        "jump": {"G": N, "dwell_time": dwell, "disturbance": {"lower": -h, "upper": 0 * h}},
        "output": {"C": np.eye(1, n), "noise_bound": 0},
        "observer": {"kind": "interval",
                     "gains": {"L": np.zeros((n, 1)), "M": np.zeros((n, 1))}},
    }  # fmt: skip


def width_evidence(outcome: obsdesign.Outcome) -> dict[str, Any]:
    (claim,) = [claim for claim in outcome.claims if claim.id == "width"]
    assert claim.verdict == "proved", claim.evidence
    return dict(claim.evidence)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4))
def test_no_sequence_of_dwell_times_leaves_the_tube(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    W, N, f, h = random_system(rng, n)
    evidence = width_evidence(
        obsdesign.investigate(obsdesign.Problem(**body_of(W, N, f, h, [0.2, 1.5])))
    )
    Z = np.block([[W, f[:, None]], [np.zeros((1, n + 1))]])
    w = 3 * np.array(evidence["tube"])  # from outside
    for k, theta in enumerate(rng.choice([0.2, 1.5, rng.uniform(0.2, 1.5)], 150)):
        end = expm(Z * theta)
        before = end[:n, :n] @ w + end[:n, n]
        w = N @ before + h
        if k > 110:
            assert np.all(before <= evidence["before_jump"])
            assert np.all(w <= evidence["after_jump"])
    # and the tube is not loose: the least one is reached by the worst constant dwell or its mixtures
    ends = [periodic_width(W, N, f, h, theta)[1] for theta in np.linspace(0.2, 1.5, 40)]
    assert np.all(np.max(ends, axis=0) <= np.array(evidence["after_jump"]))
    if n == 1:
        assert evidence["after_jump"][0] <= np.max(ends) * (1 + TIGHT)


@pytest.mark.parametrize("high", [1.5, "inf"])
def test_one_dwell_time_gives_the_periodic_limit(high: Any) -> None:
    W, N, f, h = random_system(np.random.default_rng(4), 3)
    evidence = width_evidence(
        obsdesign.investigate(obsdesign.Problem(**body_of(W, N, f, h, [1.5, high])))
    )
    before, after, mean = periodic_width(W, N, f, h, 1.5)
    row = evidence["constant_dwell"][0]
    for name, value in (("before_jump", before), ("after_jump", after), ("mean", mean)):
        np.testing.assert_allclose(row[name], value, rtol=1e-12)
    if high == 1.5:
        np.testing.assert_allclose(evidence["after_jump"], after, rtol=TIGHT)
        np.testing.assert_allclose(evidence["before_jump"], before, rtol=TIGHT)
    else:
        assert np.all(np.array(evidence["always"]) >= -np.linalg.solve(W, f))


def test_a_plant_without_jumps_has_its_limit() -> None:
    W, N, f, h = random_system(np.random.default_rng(7), 3)
    body = body_of(W, N, f, h, [1, 1])
    del body["jump"]
    evidence = width_evidence(obsdesign.investigate(obsdesign.Problem(**body)))
    np.testing.assert_allclose(evidence["always"], -np.linalg.solve(W, f), rtol=TIGHT)


@pytest.mark.parametrize("name", ["tube", "after_jump", "before_jump", "always"])
def test_a_forged_width_is_not_proved(name: str) -> None:
    W, N, f, h = random_system(np.random.default_rng(4), 3)
    problem = obsdesign.Problem(**body_of(W, N, f, h, [0.2, 1.5]))
    candidate = next(iter(synthesize(problem)))
    for change in (
        lambda v: [0.99 * x for x in v],
        lambda v: v[:2],
        lambda v: "wide",
        lambda v: [math.nan] * 3,
    ):
        forged = copy.deepcopy(dict(candidate.certificates))
        forged["width"][name] = change(forged["width"][name])
        again = [c for c in claims(problem, candidate.document(), forged) if c.id == "width"]
        assert all(claim.verdict == "undecided" for claim in again)


def test_an_unstable_width_has_no_tube() -> None:
    W, N, f, h = random_system(np.random.default_rng(4), 3)
    outcome = obsdesign.investigate(obsdesign.Problem(**body_of(W, 40 * N, f, h, [0.2, 1.5])))
    assert not [claim for claim in outcome.claims if claim.id == "width"]


def test_without_disturbance_the_width_vanishes_and_no_tube_is_claimed() -> None:
    W, N, f, h = random_system(np.random.default_rng(4), 2)
    outcome = obsdesign.investigate(obsdesign.Problem(**body_of(W, N, 0 * f, 0 * h, [0.2, 1.5])))
    assert outcome.verdict == "proved"
    assert not [claim for claim in outcome.claims if claim.id == "width"]


def test_widths_in_other_coordinates_are_those_of_the_plant() -> None:
    body: dict[str, Any] = {
        "flow": {"A": [[-1, 0], [1, -2]], "disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}},
        "jump": {"G": [[2, 1], [1, 3]], "dwell_time": [1, 1],
                 "disturbance": {"lower": [-0.3] * 2, "upper": [0.3] * 2}},
        "output": {"C": [[0, 1]], "noise_bound": [0.03]},
        "observer": {"kind": "interval", "gains": {"L": [[0], [1]], "M": [[5], [5]], "S": [[0, 2], [1, 1]]}},
    }  # fmt: skip
    design = obsdesign.design(obsdesign.Problem.from_dict(body))
    row = next(c for c in design.claims if c.id == "width").evidence["constant_dwell"][0]
    np.testing.assert_allclose(row["before_jump"], [0.70223192, 0.51741793], atol=1e-7)
    np.testing.assert_allclose(row["after_jump"], [1.56520789, 1.83260395], atol=1e-7)
    np.testing.assert_allclose(row["mean"], [1.06297598, 0.94605400], atol=1e-7)


# --- the prover -------------------------------------------------------------------------------


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 3), share=st.floats(0.9, 1.1))
def test_a_bound_is_proved_exactly_when_it_holds(seed: int, n: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    W, X, f, v = random_system(rng, n)
    Z = np.block([[W, f[:, None]], [np.zeros((1, n + 1))]])
    thetas = np.linspace(0.2, 1.5, 4001)
    ends = expm(Z * thetas[:, None, None])
    reached = np.max((ends[:, :n, :n] @ v + ends[:, :n, n]) @ X.T, axis=0)
    system = Affine(exact(W), exact(f), exact(v))
    verdict = prove_below(system, exact(X), exact(reached * share), 0.2, 1.5)
    if share < 1 - 1e-9:
        assert verdict.outcome == "undecided"
    elif share > 1 + 1e-3:
        assert verdict.outcome == "proved"


def test_an_endless_rise_needs_its_limit() -> None:
    W, f, v, X = exact([[-1.0]]), exact([1.0]), exact([0.1]), exact([[1.0]])
    rising = Affine(W, f, v)  # u -> 1
    assert prove_below(rising, X, exact([1.001]), 0.0, math.inf).outcome == "proved"
    assert prove_below(rising, X, exact([0.999]), 0.0, math.inf).outcome == "undecided"
    growing = Affine(exact([[0.1]]), f, v)
    assert prove_below(growing, X, exact([1e9]), 0.0, math.inf).outcome == "undecided"


def test_signs_are_checked_by_the_prover() -> None:
    W, f, v, X = (
        exact([[-1.0, -0.1], [0, -1]]),
        exact([1.0, 1]),
        exact([0.1, 0.1]),
        exact(np.eye(2)),
    )
    assert prove_below(Affine(W, f, v), X, exact([9.0, 9]), 0.0, 1.0).outcome == "undecided"


def test_a_limit_that_does_not_exist_is_not_certified() -> None:
    unit = exact([[1.0]])
    assert periodic_limit(0 * unit, unit, exact([1.0]), exact([0.0]), 1.0) is None


def test_the_float_and_the_exact_width_system_agree() -> None:
    from lmi.arithmetic.balls import inverse, to_float

    W, N, f, h = random_system(np.random.default_rng(1), 3)
    design = obsdesign.design(obsdesign.Problem(**body_of(W, N, f, h, [0.2, 1.5])))
    rough, true = (
        WidthSystem.from_gains(IntervalGains.from_document(design.gains)),
        WidthSystem.from_gains(IntervalGains.from_document(design.gains), exact, inverse),
    )
    for name in ("W", "f", "N", "h"):
        np.testing.assert_allclose(getattr(rough, name), to_float(getattr(true, name)), rtol=1e-12)


def test_a_tube_that_is_nearly_touched_is_proved_with_more_room() -> None:
    # dead-beat coordinates of example 4.1: jumps at once and never, L = 0
    S = np.array([[0.0, 2.0], [1.0, 1.0]])
    body: dict[str, Any] = {
        "flow": {"A": [[-1, 0], [1, -2]], "disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}},
        "jump": {"G": [[2, 1], [1, 3]], "dwell_time": [0, "inf"],
                 "disturbance": {"lower": [-0.3] * 2, "upper": [0.3] * 2}},
        "output": {"C": [[0, 1]], "noise_bound": [0.03]},
        "observer": {"kind": "interval", "form": "coordinates",
                     "gains": {"S": S, "L": np.zeros((2, 1)), "M": [[5], [5]]}},
    }  # fmt: skip
    for form in ("given", "sought"):
        if form == "sought":
            body["observer"] = {"kind": "interval", "form": "coordinates"}
        outcome = obsdesign.investigate(obsdesign.Problem(**body))
        assert outcome.verdict == "proved"
        always = width_evidence(outcome)["always"]
        assert np.isfinite(always).all()
        if form == "given":  # any spacing will do, and the document says so
            spaced = next(c for c in outcome.claims if c.id == "sampled_width")
            assert spaced.evidence["step_limit"] == math.inf
            assert spaced.evidence["always"] == always
            sentences = [g for g in outcome.design.guarantees if "any spacing, and" in g.statement]
            assert [g.given for g in sentences] == [True]
        assert obsdesign.verify(outcome.design).verdict == "proved"


def test_widths_of_constant_dwell_times_are_told_rounded_up() -> None:
    W, N, f, h = random_system(np.random.default_rng(4), 3)
    outcome = obsdesign.investigate(obsdesign.Problem(**body_of(W, N, f, h, [0.5, 1.0])))
    rows = width_evidence(outcome)["constant_dwell"]
    sentences = [
        g.statement for g in outcome.design.guarantees if "a constant dwell" in g.statement
    ]
    assert len(sentences) == len(rows) == 2
    for row, text in zip(rows, sentences, strict=True):
        groups = [part.split(")")[0].split(", ") for part in text.split("(")[1:]]
        for name, values in zip(("before_jump", "after_jump", "mean"), groups, strict=True):
            for exactly, word in zip(row[name], values, strict=True):
                assert exactly <= float(word) <= exactly * (1 + 1e-5)


@given(st.lists(st.floats(0.01, 10.0), min_size=6, max_size=6))
def test_widths_are_carried_into_the_plant_rounded_up(numbers: list[float]) -> None:
    S, x = exact(np.array(numbers[:4]).reshape(2, 2)), exact(np.array(numbers[4:]))
    assert all(exact(up).item() >= y for up, y in zip(raised_product(S, x), S @ x, strict=True))
    assert raised_product(exact(np.eye(2)), x) == numbers[4:]
