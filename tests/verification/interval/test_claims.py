"""Claims of interval observers: laws that verdicts must obey, twins that must not be proved."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign
from lmi.arithmetic.balls import exact
from lmi.arithmetic.exponential import expm
from obsdesign.equations.interval.width import periodic_width
from obsdesign.synthesis.interval.candidates import synthesize
from obsdesign.verification.interval.claims import claims
from obsdesign.verification.interval.signs import nonnegative_claim

BASE: dict[str, Any] = {
    "flow": {"A": [[-1, 0], [1, -2]]},
    "jump": {"G": [[2, 1], [1, 3]], "dwell_time": [0.7, "inf"]},
    "output": {"C": [[0, 1]], "noise_bound": [0]},
    "observer": {"kind": "interval", "gains": {"L": [[0], [1]], "M": [[1], [2.8]]}},
}


def problem_with(**changes: Any) -> obsdesign.Problem:
    body = copy.deepcopy(BASE)
    for path, value in changes.items():
        block, key = path.split("__")
        body[block][key] = value
    return obsdesign.Problem.from_dict(body)


def verdicts(outcome: obsdesign.Outcome) -> dict[str, str]:
    return {claim.id: claim.verdict for claim in outcome.claims}


def random_body(rng: np.random.Generator, n: int) -> dict[str, Any]:
    """A plant whose minimal split is stable from some dwell time on."""
    p = int(rng.integers(1, n + 1))
    A, C = rng.standard_normal((n, n)) - (n + 1) * np.eye(n), rng.standard_normal((p, n))
    G = rng.standard_normal((n, n))
    L, M = 0.3 * rng.standard_normal((2, n, p))
    return {
        "flow": {"A": A},
        "jump": {"G": G, "dwell_time": [0.1, 2.0]},
        "output": {"C": C, "noise_bound": 0},
        "observer": {"kind": "interval", "form": "split", "gains": {"L": L, "M": M}},
    }


def outcome_of(body: dict[str, Any]) -> obsdesign.Outcome:
    return obsdesign.investigate(obsdesign.Problem(**body))


# --- laws -------------------------------------------------------------------------------------


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4), exponent=st.integers(-6, 6))
def test_another_unit_of_time_changes_no_verdict(seed: int, n: int, exponent: int) -> None:
    body = random_body(np.random.default_rng(seed), n)
    scaled = copy.deepcopy(body)
    unit = 2.0**exponent  # exact, so that the two problems are the same one
    scaled["flow"]["A"] = body["flow"]["A"] * unit
    scaled["jump"]["dwell_time"] = [t / unit for t in body["jump"]["dwell_time"]]
    scaled["observer"]["gains"]["L"] = body["observer"]["gains"]["L"] * unit
    assert verdicts(outcome_of(body)) == verdicts(outcome_of(scaled))


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4))
def test_other_units_and_order_of_the_states_change_no_verdict(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    body = random_body(rng, n)
    S = np.diag(2.0 ** rng.integers(-3, 4, n))[rng.permutation(n)]
    inverse = np.linalg.inv(S)
    transformed = copy.deepcopy(body)
    transformed["flow"]["A"] = S @ body["flow"]["A"] @ inverse
    transformed["jump"]["G"] = S @ body["jump"]["G"] @ inverse
    transformed["output"]["C"] = body["output"]["C"] @ inverse
    for name in ("L", "M"):
        transformed["observer"]["gains"][name] = S @ body["observer"]["gains"][name]
    assert verdicts(outcome_of(body)) == verdicts(outcome_of(transformed))


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4), room=st.floats(0.0, 1.0))
def test_a_larger_range_never_helps(seed: int, n: int, room: float) -> None:
    small = random_body(np.random.default_rng(seed), n)
    large = copy.deepcopy(small)
    low, high = small["jump"]["dwell_time"]
    large["jump"]["dwell_time"] = [low * (1 - room), high * (1 + room)]
    if outcome_of(large).verdict == "proved":
        assert outcome_of(small).verdict == "proved"
    if outcome_of(small).verdict == "refuted":
        assert outcome_of(large).verdict != "proved"


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4))
def test_brute_force_never_contradicts_a_verdict(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    body = random_body(rng, n)
    outcome = outcome_of(body)
    gains = outcome.design.gains
    W, N = gains["D0"] + gains["D1"], gains["Gp"] + gains["Gn"]
    cycles = expm(W * rng.uniform(0.1, 2.0, 400)[:, None, None]) @ N
    product = np.eye(n)
    for cycle in cycles:
        product = cycle @ product
        product /= max(np.abs(product).max(), 1e-300) if outcome.verdict == "refuted" else 1.0
    if outcome.verdict == "proved":
        assert np.abs(product).max() < 1e-3
    if outcome.verdict == "refuted":
        theta = outcome.claims[-1].evidence["witness"]["theta"]
        radius = max(abs(np.linalg.eigvals(expm(W * theta) @ N)))
        assert radius > 1 - 1e-9
        assert 0.1 <= theta <= 2.0


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 3),
    excess=st.sampled_from([0.0, 1e-9, 0.1, 2.0]),
)
def test_no_split_beats_the_minimal_one(seed: int, n: int, excess: float) -> None:
    rng = np.random.default_rng(seed)
    body = random_body(rng, n)
    minimal = outcome_of(body)
    gains = minimal.design.gains
    more = {
        name: gains[name] + excess * rng.random((n, n)) * keep
        for name, keep in (("D0", 1.0), ("Gp", 1.0))
    }
    wider = copy.deepcopy(body)
    wider["observer"]["gains"] |= more | {
        "D1": more["D0"] - (gains["D0"] - gains["D1"]),
        "Gn": more["Gp"] - (gains["Gp"] - gains["Gn"]),
    }
    outcome = outcome_of(wider)
    assert verdicts(outcome)["flow_positive"] == "proved"
    if outcome.verdict == "proved":
        assert minimal.verdict == "proved"


# --- witnesses and twins ----------------------------------------------------------------------


def test_an_entry_of_the_wrong_sign_is_the_witness() -> None:
    outcome = obsdesign.investigate(
        problem_with(observer__form="cooperative", flow__A=[[-1, -0.5], [1, -2]])
    )
    claim = next(c for c in outcome.claims if c.id == "flow_positive")
    assert claim.verdict == "refuted"
    assert claim.evidence["witness"]["entry"] == [1, 2]
    assert claim.evidence["witness"]["value"] == -0.5


def test_rounding_of_decimals_is_told_apart() -> None:
    # 0.3 - 3 * 0.1 is -2.8e-17 in binary64: not Metzler, and the split form does not mind
    changes = {"flow__A": [[-1, 0.3], [1, -2]], "observer__gains": {"L": [[3], [1]], "M": [[0], [0]]},
               "output__C": [[0, 0.1]], "jump__G": [[0.1, 0], [0, 0.1]]}  # fmt: skip
    strict = obsdesign.investigate(problem_with(observer__form="cooperative", **changes))
    reason = next(c for c in strict.claims if c.id == "flow_positive").evidence["witness"]["reason"]
    assert reason == (
        "A - L C is not Metzler: entry (1, 2) is -2.77556e-17; "
        "rounding of decimals, which form = split absorbs"
    )
    relaxed = obsdesign.investigate(problem_with(**changes))
    assert (relaxed.verdict, relaxed.result["form"]) == ("proved", "split")


def test_auto_prefers_the_cooperative_form_and_reports_both() -> None:
    assert obsdesign.investigate(problem_with()).result["form"] == "cooperative"
    outcome = obsdesign.investigate(
        problem_with(jump__G=[[2, 1], [1, 2]], jump__dwell_time=[1.5, 3])
    )
    assert outcome.result["form"] == "split"
    assert outcome.result["forms"]["cooperative"]["verdict"] == "refuted"
    reasons = outcome.result["forms"]["cooperative"]["reasons"]
    assert reasons == [
        "jump_positive: the jump matrix of the error, H, is not nonnegative: entry (2, 2) is -0.8"
    ]


def test_own_splits_are_taken_completed_or_refused() -> None:
    own = {"D0": [[-1, 0.125], [1.125, -2.875]]}
    gains = BASE["observer"]["gains"]
    outcome = obsdesign.investigate(
        problem_with(observer__gains=gains | own, jump__dwell_time=[2, "inf"])
    )
    assert outcome.verdict == "proved"
    np.testing.assert_allclose(outcome.design.gains["D1"], [[0, 0.125], [0.125, 0.125]])
    wrong = gains | {"D0": [[-1, 0.5], [1.5, -2.5]], "D1": [[0, 0.5], [0.5, 0.6]]}
    outcome = obsdesign.investigate(problem_with(observer__gains=wrong))
    claim = next(c for c in outcome.claims if c.id == "flow_positive")
    assert claim.verdict == "refuted"
    assert claim.evidence["witness"]["reason"] == (
        "D0 - D1 misses the matrix it splits at entry (2, 2) by -0.1"
    )
    negative = gains | {"D0": [[-1, 0], [1, -3.5]]}
    outcome = obsdesign.investigate(problem_with(observer__gains=negative))
    claim = next(c for c in outcome.claims if c.id == "flow_positive")
    assert claim.evidence["witness"]["reason"] == "D1 has the wrong sign: entry (2, 2) is -0.5"


@pytest.mark.parametrize(
    "spoil",
    [
        lambda P: -P,
        lambda P: P + np.array([[0, 3000], [3000, 0]]),
        lambda P: P + np.array([[0, 1e-3], [0, 0]]),
        lambda P: 0 * P,
        lambda P: P * np.nan,
        lambda P: np.eye(2),
    ],
)
def test_a_spoilt_certificate_proves_nothing(spoil: Any) -> None:
    problem = problem_with()
    candidate = next(iter(synthesize(problem)))
    P = np.array(candidate.certificates["dwell_stability"]["P"])
    good = claims(problem, candidate.document(), {"dwell_stability": {"P": P}})
    assert good[-1].verdict == "proved"
    bad = claims(problem, candidate.document(), {"dwell_stability": {"P": spoil(P)}})
    assert bad[-1].verdict == "undecided"
    assert claims(problem, candidate.document(), {})[-1].verdict == "undecided"


def test_an_infinite_range_needs_a_flow_that_decays() -> None:
    steady = {"flow__A": [[-1, 0], [0, 0]], "observer__gains": {"L": [[0], [0]], "M": [[0], [0]]},
              "jump__G": [[0.5, 0], [0, 0.5]]}  # fmt: skip
    assert (
        obsdesign.investigate(problem_with(**steady, jump__dwell_time=[0, 9])).verdict == "proved"
    )
    outcome = obsdesign.investigate(problem_with(**steady, jump__dwell_time=[0, "inf"]))
    assert verdicts(outcome)["hurwitz"] == "refuted"
    claim = next(c for c in outcome.claims if c.id == "hurwitz")
    assert claim.evidence["witness"]["eigenvalue"] == {"real": 0.0, "imag": 0.0}


@pytest.mark.parametrize(
    ("G", "dwell", "verdict"),
    [
        ([[0, 0], [0, 0]], [0, 5], "proved"),  # H = 0
        ([[0.5, 0], [0, 0.5]], [1, 1], "proved"),  # one dwell time
        ([[2, 0], [0, 2]], [0, 1], "refuted"),  # jumps may follow at once
        ([[1, 0], [0, 1]], [0.5, "inf"], "proved"),  # no jump at all, in effect
    ],
)
def test_degenerate_problems_are_ordinary(G: Any, dwell: Any, verdict: str) -> None:
    gains = {"L": [[0], [0]], "M": [[0], [0]]}
    problem = problem_with(jump__G=G, jump__dwell_time=dwell, observer__gains=gains)
    assert obsdesign.investigate(problem).verdict == verdict


def test_a_plant_without_jumps() -> None:
    body = copy.deepcopy(BASE)
    del body["jump"]
    del body["observer"]["gains"]["M"]
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert verdicts(outcome) == {
        "consistent": "proved", "flow_positive": "proved", "hurwitz": "proved",
        "sampled_width": "proved",
    }  # fmt: skip
    assert obsdesign.verify(outcome.design).verdict == "proved"
    unstable = copy.deepcopy(body)
    unstable["flow"]["A"] = [[1, 0], [1, -2]]
    assert obsdesign.investigate(obsdesign.Problem.from_dict(unstable)).verdict == "refuted"


@pytest.mark.parametrize("when", ["before", "after", "none"])
def test_every_jump_measurement_is_designed_verified_and_run(when: str) -> None:
    M = [[0], [0]] if when == "none" else [[0.2], [0.5]]
    problem = problem_with(
        output__jump_measurement=when, jump__dwell_time=[2, 4],
        observer__gains={"L": [[0], [1]], "M": M},
    )  # fmt: skip
    design = obsdesign.design(problem)
    assert obsdesign.verify(design).verdict == "proved"
    H = design.gains["Gp"] - design.gains["Gn"]
    G, C = np.array(BASE["jump"]["G"]), np.array([[0, 1]])
    expected = {"before": G - M @ C, "after": (np.eye(2) - M @ C) @ G, "none": G}[when]
    np.testing.assert_allclose(H, expected, atol=1e-15)


def test_verify_after_a_round_trip_through_text() -> None:
    import json

    from obsdesign.design_file import from_dict

    design = obsdesign.design(problem_with())
    again = from_dict(json.loads(json.dumps(design.to_dict())))
    assert again.to_dict() == design.to_dict()
    assert obsdesign.verify(again).verdict == "proved"


def test_periodic_width_is_the_limit_of_the_recursion() -> None:
    W, N = np.array([[-1.0, 0.2], [1.0, -3.0]]), np.array([[0.5, 0.1], [0.2, 0.2]])
    f, h, dwell = np.array([0.2, 0.3]), np.array([0.6, 0.1]), 0.8
    before, after, mean = periodic_width(W, N, f, h, dwell)
    flow = expm(np.block([[W, f[:, None]], [np.zeros((1, 3))]]) * (dwell / 1000))
    w, total = np.zeros(2), np.zeros(2)
    for cycle in range(60):
        for _ in range(1000):
            left, w = w, flow[:2, :2] @ w + flow[:2, 2]
            total += (left + w) / 2000 if cycle == 59 else 0.0
        if cycle < 59:
            w = N @ w + h
    np.testing.assert_allclose(w, before, rtol=1e-9)
    np.testing.assert_allclose(N @ w + h, after, rtol=1e-9)
    np.testing.assert_allclose(total, mean, rtol=1e-5)
    with pytest.raises(ValueError, match="does not settle"):
        periodic_width(W, 10 * np.eye(2), f, h, 0.1)


def test_refuted_and_undecided_designs_are_not_returned() -> None:
    with pytest.raises(obsdesign.NotProved, match=r"refuted: .* at dwell time 0.5 a jump") as error:
        obsdesign.design(problem_with(jump__dwell_time=[0.5, "inf"]))
    assert error.value.outcome.verdict == "refuted"


def test_the_second_method_confirms_and_its_objection_counts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from lmi.verdict import undecided
    from obsdesign.verification import dwell

    design = obsdesign.design(problem_with())
    confirmed = obsdesign.verify(design, paranoid=True)
    evidence = next(c for c in confirmed.claims if c.id == "dwell_stability").evidence
    assert evidence["method"] != evidence["confirmed_by"]["method"]
    genuine = dwell.prove_common

    def doubting(*arguments: Any, method: str = "bernstein") -> Any:
        return undecided("no") if method == "chords" else genuine(*arguments)

    monkeypatch.setattr(dwell, "prove_common", doubting)
    assert obsdesign.verify(design).verdict == "proved"
    doubted = obsdesign.verify(design, paranoid=True)
    assert next(c for c in doubted.claims if c.id == "dwell_stability").verdict == "undecided"


def test_many_states_are_proved_by_one_vector_and_verified() -> None:
    rng = np.random.default_rng(5)
    n = 18
    A = 0.2 * rng.random((n, n))
    A -= np.diag(A.sum(axis=1) + 0.5)
    G = 0.05 * rng.random((n, n))
    body = {
        "flow": {"A": A}, "jump": {"G": G, "dwell_time": [0.1, "inf"]}, "output": {"C": np.eye(1, n), "noise_bound": 0},
        "observer": {"kind": "interval", "gains": {"L": np.zeros((n, 1)), "M": np.zeros((n, 1))}},
    }  # fmt: skip
    design = obsdesign.design(obsdesign.Problem(**body))
    claim = next(c for c in design.claims if c.id == "dwell_stability")
    assert "vector" in claim.evidence
    assert obsdesign.verify(design).verdict == "proved"
    problem, gains = obsdesign.Problem.from_dict(design.problem), design.gains
    for change in (
        {"vector": [1.0] * 17},
        {"vector": [-1.0] * n},
        {"side": "top"},
        {"vector": "v"},
    ):
        forged = {"dwell_stability": {**claim.evidence, **change}}
        assert claims(problem, gains, forged)[-1].verdict == "undecided"


def test_an_entry_that_misses_is_the_witness() -> None:
    stored = np.array([[1.0, 0.0], [0.5, 1.0]])
    claim = nonnegative_claim(exact(stored), exact(stored - [[0, 0], [0.25, 0]]), "here")
    assert claim.verdict == "refuted"
    assert claim.evidence["witness"]["entry"] == [2, 1]
    assert claim.evidence["witness"]["value"] == 0.25
    assert "entry (2, 1) by 0.25" in claim.evidence["witness"]["reason"]
    assert nonnegative_claim(exact(stored), exact(stored), "here").verdict == "proved"


@pytest.mark.parametrize(("first", "refuted"), [(1.5, True), (0.5, False)])
def test_a_stated_gain_of_the_wrong_sign_is_no_matter_of_the_open_one(
    first: float, refuted: bool
) -> None:
    """G - M C has the entry 1 - first in its first row, whatever L is."""
    changes = {"observer__form": "cooperative", "observer__gains": {"M": [[first], [1.0]]}}
    outcome = obsdesign.investigate(problem_with(**changes))
    reasons = [
        claim.evidence["witness"]["reason"] for claim in outcome.claims if claim.id == "attainable"
    ]
    assert any("jump matrix" in reason for reason in reasons) is refuted
