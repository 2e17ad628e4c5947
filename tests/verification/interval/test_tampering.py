"""Files that were changed and signed again: nothing that is not proved again gets through."""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable
from typing import Any

import pytest

import obsdesign
from obsdesign.design_file import from_dict
from obsdesign.document import digest
from obsdesign.verification.same_evidence import difference

BASE: dict[str, Any] = {
    "flow": {"A": [[-1, 0], [1, -2]], "disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}},
    "jump": {"G": [[2, 1], [1, 3]], "dwell_time": [2, 5],
             "disturbance": {"lower": [-0.3] * 2, "upper": [0.3] * 2}},
    "output": {"C": [[0, 1]], "noise_bound": [0.03]},
    "observer": {"kind": "interval", "gain_limit": 5},
}  # fmt: skip


@functools.cache
def written(periodic: bool) -> Any:
    body = copy.deepcopy(BASE)
    if periodic:
        body["output"] |= {"measured": "periodic", "period": 0.1}
    return obsdesign.design(obsdesign.Problem.from_dict(body)).to_dict()


def verified(change: Callable[[Any], object], periodic: bool = False) -> obsdesign.Outcome:
    """What `verify` says of the file after a change, digest and all."""
    body = copy.deepcopy(written(periodic))
    change(body)
    return obsdesign.verify(from_dict({**body, "digest": digest(body)}))


def evidence(body: Any, claim: str) -> Any:
    return next(c for c in body["claims"] if c["id"] == claim)["evidence"]


@pytest.mark.parametrize("periodic", [False, True])
def test_the_file_as_written_is_proved(periodic: bool) -> None:
    assert verified(lambda body: None, periodic).verdict == "proved"


@pytest.mark.parametrize("name", ["mean", "before_jump", "after_jump", "dwell_time"])
def test_widths_of_constant_dwell_times_are_found_again(name: str) -> None:
    def smaller(body: Any) -> None:
        row = evidence(body, "width")["constant_dwell"][0]
        row[name] = [0.1 * x for x in row[name]] if isinstance(row[name], list) else 1.9

    outcome = verified(smaller)
    assert outcome.verdict == "refuted"
    witness_reason = outcome.claims[-1].evidence["witness"]["reason"]
    assert f"width.constant_dwell[0].{name}" in witness_reason


def test_widths_of_constant_dwell_times_may_not_be_left_out() -> None:
    assert verified(lambda body: evidence(body, "width").pop("constant_dwell")).verdict == "refuted"
    assert verified(lambda b: evidence(b, "width")["constant_dwell"].pop()).verdict == "refuted"


@pytest.mark.parametrize("name", ["after_jump", "after_sample", "always", "sampled", "jumped"])
def test_widths_between_samples_are_found_again(name: str) -> None:
    def smaller(body: Any) -> None:
        widths = evidence(body, "sampled_stability")
        widths[name] = [0.5 * x for x in widths[name]]

    assert verified(smaller, periodic=True).verdict != "proved"


def test_the_range_of_dwell_times_is_that_of_the_problem() -> None:
    def wider(body: Any) -> None:
        evidence(body, "dwell_stability")["dwell_time"] = [0.0, "inf"]

    outcome = verified(wider)
    assert outcome.verdict == "refuted"
    assert "dwell_stability.dwell_time" in outcome.claims[-1].evidence["witness"]["reason"]


@pytest.mark.parametrize("claim", ["width", "dwell_stability", "flow_positive", "rates"])
def test_what_nothing_produced_is_refused(claim: str) -> None:
    def invented(body: Any) -> None:
        evidence(body, claim)["mean_over_all"] = [0.0, 0.0]

    outcome = verified(invented)
    assert outcome.verdict == "refuted"
    assert outcome.claims[-1].evidence["witness"]["entry"] == f"{claim}.mean_over_all"


def test_how_a_proof_went_is_no_promise_but_a_scalar() -> None:
    boxes = evidence(written(False), "dwell_stability")["boxes"]
    other = verified(lambda body: evidence(body, "dwell_stability").update(boxes=boxes + 7))
    assert other.verdict == "proved"
    table = verified(lambda body: evidence(body, "dwell_stability").update(boxes={"width": 0.0}))
    assert table.verdict == "refuted"


def test_a_rate_beyond_binary64_is_not_proved() -> None:
    assert verified(lambda b: evidence(b, "rates").update(in_time=100.0)).verdict != "proved"


@pytest.mark.parametrize("limit", [1.0, 4.9])
def test_gains_beyond_their_limit_are_refused(limit: float) -> None:
    def narrower(body: Any) -> None:
        body["problem"]["observer"]["gain_limit"] = limit
        if abs(body["gains"]["L"][1][0]) <= limit:
            body["gains"]["L"][1][0] = 5.0
            body["gains"]["D0"][1][1] = -7.0

    outcome = verified(narrower)
    assert outcome.claims[0].verdict == "refuted"
    assert "gain_limit" in outcome.claims[0].evidence["witness"]["reason"]


def test_given_gains_beyond_the_limit_are_bad_input() -> None:
    body = copy.deepcopy(BASE)
    body["observer"]["gains"] = {"L": [[0], [6]]}
    with pytest.raises(obsdesign.InputError, match="row 2, column 1 must not exceed"):
        obsdesign.investigate(obsdesign.Problem.from_dict(body))


def test_differences_by_sort() -> None:
    true = {"bound": [1.0, 2.0], "approx_pole": 1.0, "estimated": {"std": 1.0}, "steps": 3}
    assert difference("c", true, true) is None
    assert difference("c", {**true, "steps": 9, "approx_pole": 1.000001}, true) is None
    assert difference("c", true, {**true, "confirmed_by": {"steps": 3}}) is None
    false = [{**true, "bound": [1.0]}, {**true, "bound": [1.0, 1.9]}, {**true, "more": 1},
             {k: v for k, v in true.items() if k != "bound"}, {**true, "bound": "[1, 2]"}]  # fmt: skip
    for stored in false:
        gap = difference("c", stored, true)
        assert gap is not None
        assert gap.false
    near = [{**true, "bound": [1.0, 2.0 * (1 + 1e-12)]}, {**true, "approx_pole": 2.0},
            {**true, "estimated": {"std": 0.5}}]  # fmt: skip
    for stored in near:
        gap = difference("c", stored, true)
        assert gap is not None
        assert not gap.false


@pytest.mark.parametrize("value", [0.5, -1, 40.000001, True, "many"])
def test_a_count_of_how_a_proof_went_stays_a_count(value: Any) -> None:
    true = {"boxes": 3, "steps": 40, "smallest_box": 0.25, "tail_from": 2.0}
    assert difference("dwell_stability", {**true, "boxes": 7, "tail_from": 1.5}, true) is None
    for key in ("boxes", "steps"):
        gap = difference("dwell_stability", {**true, key: value}, true)
        assert gap is not None
        assert gap.false
    assert difference("dwell_stability", {**true, "tail_from": -1.0}, true) is not None


def test_a_fraction_of_a_step_is_refused() -> None:
    def halved(body: Any) -> None:
        body["claims"] = [
            {**c, "evidence": {**c["evidence"], "steps": 1.5}} if "steps" in c["evidence"] else c
            for c in body["claims"]
        ]

    assert verified(halved, periodic=True).verdict == "refuted"


@pytest.mark.parametrize("periodic", [False, True])
def test_bounds_without_a_bound_of_the_noise_are_refuted(periodic: bool) -> None:
    def without(body: Any) -> None:
        del body["problem"]["output"]["noise_bound"]

    outcome = verified(without, periodic)
    assert outcome.verdict == "refuted"
    (claim,) = (claim for claim in outcome.claims if claim.id == "consistent")
    assert claim.verdict == "refuted"
    assert "output.noise_bound is required" in claim.evidence["witness"]["reason"]
