"""Designs that were changed and signed again: widths and trajectories are proved from the file."""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable
from typing import Any

import pytest

import obsdesign
from obsdesign.design_file import from_dict
from obsdesign.document import digest
from obsdesign.workflow import Outcome
from tests.systems.nominal_patterns import problem_of


@functools.cache
def written() -> Any:
    return obsdesign.design(problem_of("rand2_21", 0.1, [0.5, 0.5])).to_dict()


def verified(change: Callable[[Any], object]) -> Outcome:
    body = copy.deepcopy(written())
    change(body)
    return obsdesign.verify(from_dict({**body, "digest": digest(body)}))


def evidence(body: Any, claim: str) -> Any:
    return next(c for c in body["claims"] if c["id"] == claim)["evidence"]


def verdict_of(outcome: Outcome, claim: str) -> str:
    return next((c.verdict for c in outcome.claims if c.id == claim), "missing")


def test_the_file_as_written_is_proved() -> None:
    assert verified(lambda body: None).verdict == "proved"


def _scale(table: Any, factor: float) -> Any:
    return [_scale(x, factor) for x in table] if isinstance(table, list) else factor * table


@pytest.mark.parametrize("factor", [0.0, 0.5, -1.0])
def test_other_multipliers_hold_no_tube(factor: float) -> None:
    def change(body: Any) -> None:
        body["gains"]["multipliers"] = _scale(body["gains"]["multipliers"], factor)

    outcome = verified(change)
    assert outcome.verdict != "proved"
    assert verdict_of(outcome, "width") == "undecided"


def test_multipliers_of_fewer_windows_hold_no_tube() -> None:
    outcome = verified(lambda body: body["gains"]["multipliers"].pop())
    assert verdict_of(outcome, "width") == "undecided"
    assert outcome.verdict != "proved"


def test_multipliers_where_nothing_is_sampled_hold_no_tube() -> None:
    """The observer evaluates none of them there."""

    def change(body: Any) -> None:
        for windows in body["gains"]["multipliers"]:
            for rows in windows:
                for step in rows:
                    step[0] += 1e-12

    assert verdict_of(verified(change), "width") == "undecided"


def test_a_tube_that_is_too_narrow_is_left() -> None:
    def change(body: Any) -> None:
        own = evidence(body, "width")
        own["tube"] = _scale(own["tube"], 0.999)
        own["always"] = _scale(own["always"], 0.999)

    outcome = verified(change)
    assert verdict_of(outcome, "width") == "undecided"
    assert outcome.verdict != "proved"


@pytest.mark.parametrize(
    ("claim", "entry"), [("width", "always"), ("optimal", "least"), ("optimal", "ratio")]
)
def test_numbers_are_those_that_follow(claim: str, entry: str) -> None:
    def change(body: Any) -> None:
        evidence(body, claim)[entry][0] *= 0.9

    outcome = verified(change)
    assert outcome.verdict == "refuted"
    assert f"{claim}.{entry}" in outcome.claims[-1].evidence["witness"]["reason"]


def test_a_wider_tube_is_another_statement() -> None:
    """True of the observer, but not what the sentences say."""

    def change(body: Any) -> None:
        own = evidence(body, "width")
        own["tube"] = _scale(own["tube"], 2.0)

    outcome = verified(change)
    assert verdict_of(outcome, "width") == "proved"
    assert outcome.verdict == "refuted"


def test_a_disturbance_outside_its_bounds_is_no_trajectory() -> None:
    def change(body: Any) -> None:
        evidence(body, "optimal")["trajectories"]["disturbances"][0][-1] = 1.0000001

    outcome = verified(change)
    assert verdict_of(outcome, "optimal") == "undecided"
    assert outcome.verdict != "proved"


def test_a_trajectory_that_is_noticed_shows_less() -> None:
    """Disturbances of full size leave the strip: what is certified is made smaller by that."""

    def change(body: Any) -> None:
        own = evidence(body, "optimal")["trajectories"]["disturbances"]
        own[0] = [1.0] * len(own[0])

    outcome = verified(change)
    least = next(c for c in outcome.claims if c.id == "optimal").evidence["least"]
    assert least[0] < evidence(written(), "optimal")["least"][0]
    assert outcome.verdict == "refuted"


@pytest.mark.parametrize(
    ("entry", "value"), [("steps", 7), ("pieces", 3), ("rows", [9, 0]), ("disturbances", None)]
)
def test_trajectories_of_another_shape_are_not_used(entry: str, value: Any) -> None:
    def change(body: Any) -> None:
        evidence(body, "optimal")["trajectories"][entry] = value

    outcome = verified(change)
    assert verdict_of(outcome, "optimal") in ("undecided", "missing")
    assert outcome.verdict != "proved"


def test_sentences_are_those_that_follow() -> None:
    def change(body: Any) -> None:
        (text,) = [g for g in body["guarantees"] if "ultimate bound" in g["statement"]]
        text["statement"] = text["statement"].replace("is (0.", "is (0.0")

    assert verified(change).verdict == "refuted"


def test_a_width_without_its_proof_is_refuted() -> None:
    def change(body: Any) -> None:
        evidence(body, "width").pop("tube")

    outcome = verified(change)
    assert verdict_of(outcome, "width") == "missing"
    assert outcome.verdict == "refuted"
