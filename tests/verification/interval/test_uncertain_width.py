"""Widths where the times of an event are uncertain: proved, never exceeded, refused where open."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign import workflow
from obsdesign.data.simulation import simulate
from obsdesign.document import Claim, Design
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample, rows_of
from obsdesign.verification.interval.uncertain_width import uncertain_claims
from tests.systems.designs import designed, investigated

PK: dict[str, Any] = {
    "flow": {
        "A": [[-1, 0, 0], [1, -0.5, 0.2], [0, 0.3, -0.2]],
        "disturbance": {"lower": [0, -0.3, 0], "upper": [0, 0.3, 0]},
    },
    "event": [
        {
            "name": "dose", "E": [[100], [0], [0]], "input_bound": [1], "every": [6, 14],
            "disturbance": {"lower": [-4, 0, 0], "upper": [4, 0, 0]}, "time_error": 0.25,
        }
    ],
    "sensor": [{"name": "plasma", "C": [[0, 0.05, 0]], "noise_bound": 0.02, "every": [0, 5]}],
    "observer": {"kind": "interval"},
}  # fmt: skip


# example 4.1 of Degue, Efimov and Richard without gains, x2 sampled
TURNING: dict[str, Any] = {
    "flow": {
        "A": [[-1, 0], [1, -2]], "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]},
    },
    "event": [
        {
            "name": "kick", "G": [[2, 1], [1, 3]], "every": [2, 5], "time_error": 0.05,
            "disturbance": {"lower": [-0.3, -0.3], "upper": [0.3, 0.3]},
        }
    ],
    "sensor": [{"name": "y", "C": [[0, 1]], "noise_bound": 0.03, "every": [0.1, 0.2]}],
    "observer": {"kind": "interval"},
}  # fmt: skip


def changed(**event: Any) -> Problem:
    body = copy.deepcopy(PK)
    own = body["event"][0]
    own |= event
    body["event"] = [{key: value for key, value in own.items() if value is not None}]
    return Problem(**body)


@pytest.fixture(scope="module")
def design() -> Design:
    return obsdesign.design(Problem(**PK))


def width_claim(design: Design) -> Claim:
    return next(claim for claim in design.claims if claim.id == "late_width")


def test_the_width_is_proved_again_without_a_solver(design: Design) -> None:
    outcome = workflow.verify(design)
    assert outcome.verdict == "proved"
    assert width_claim(design).verdict == "proved"


@pytest.mark.parametrize("seed", range(3))
def test_bounds_that_run_are_within_the_widths(design: Design, seed: int) -> None:
    """Doses of either end, as often as they may be, and samples as seldom: after a long run."""
    rng = np.random.default_rng(seed)
    observer: Any = from_design(design)
    t, rows = 0.0, [Sample(0.0)]
    for _ in range(14):
        t += 6.0 if seed < 2 else float(rng.uniform(6, 14))
        w = np.array([1.0 if seed == 0 else float(rng.choice([-1, 1]))])
        rows += [Sample(t - 0.2501), Sample(t, w=w, jump=True, events=(0,)), Sample(t + 0.2501)]
        rows += [Sample(t + age) for age in (1.0, 2.0, 5.0)]
    evidence = width_claim(design).evidence
    state = observer.init(0.0, lower=[0, 0, 0], upper=[0, 0, 0])
    listed = list(observer.run(state, rows))
    widths = np.array([e.upper - e.lower for e in listed])[-36:].reshape(6, 6, 3)
    before, _, after, *others = widths.transpose(1, 0, 2)
    assert (before <= evidence["before"]).all()
    assert (after <= evidence["after"]).all()
    assert (np.array(others) <= evidence["always"]).all()
    assert (after.max(axis=0) >= 0.5 * np.array(evidence["after"]))[0]


def test_the_state_of_a_simulation_is_inside(design: Design) -> None:
    run = simulate(
        Problem(**PK).plant, until=80, initial=np.zeros(3), disturbance="extreme",
        rng=np.random.default_rng(3),
    )  # fmt: skip
    assert run.happened is not None
    observer: Any = from_design(design)
    rows = list(rows_of(run.t, run.block("y"), w=run.block("w"), jump=run.happened[:, 0]))
    state = observer.init(run.t[0], lower=[-1] * 3, upper=[1] * 3)
    for estimate, x in zip(observer.run(state, rows), run.block("x"), strict=True):
        assert (estimate.lower <= x + 1e-9).all()
        assert (x - 1e-9 <= estimate.upper).all()
        assert "void" not in estimate.status


def test_the_width_of_a_jump_that_turns_the_state_is_proved_again() -> None:
    assert workflow.verify(designed(TURNING)).verdict == "proved"


@pytest.mark.parametrize("seed", range(3))
def test_widths_of_a_jump_that_turns_the_state(seed: int) -> None:
    problem, design = Problem(**TURNING), designed(TURNING)
    run = simulate(
        problem.plant, until=30, initial=[0.2, 0.1], disturbance="extreme",
        dwell="shortest" if seed else "random", rng=np.random.default_rng(seed),
    )  # fmt: skip
    assert run.happened is not None
    observer: Any = from_design(design)
    rows = rows_of(run.t, run.block("y"), jump=run.happened[:, 0])
    state = observer.init(run.t[0], lower=[0, 0], upper=[0.4, 0.4])
    listed, x = list(observer.run(state, rows)), run.block("x")
    low, high = (np.array([getattr(e, end) for e in listed]) for end in ("lower", "upper"))
    assert ((low <= x + 1e-9) & (x - 1e-9 <= high)).all()
    stamps = run.t[run.happened[:, 0]]
    far = np.abs(run.t[:, None] - stamps).min(axis=1) > 0.05 + 1e-9
    evidence = width_claim(design).evidence
    late_rows = far & (run.t > 10)
    assert ((high - low)[late_rows] <= evidence["always"]).all()
    assert (high - low)[late_rows].max() > 0.3 * max(evidence["always"])


def test_the_width_grows_smoothly_with_the_error() -> None:
    """Example 4.1: small errors cost little, and none at all costs nothing."""
    body = copy.deepcopy(TURNING)
    widths = []
    for error in (0.0, 0.001, 0.05):
        body["event"][0]["time_error"] = error
        after = investigated(body).claims[-1].evidence["after"]
        widths.append(after if error else after[body["event"][0]["name"]])
    ends = np.array(widths)
    assert (np.diff(ends, axis=0) > 0).all()
    assert (ends[1] < 1.02 * ends[0]).all()


def test_inputs_move_a_state_that_turns_anywhere() -> None:
    body = {**TURNING, "flow": {**TURNING["flow"], "B": [[1], [0]]}}
    outcome = workflow.investigate(Problem(**body))
    assert outcome.verdict == "undecided"
    assert "flow.B is there" in outcome.claims[-1].evidence["reason"]


def test_a_lower_tube_of_sizes_is_not_proved() -> None:
    design = designed(TURNING)
    evidence = width_claim(design).evidence
    own = {name: evidence[name] for name in ("cells", "tube")}
    for factor, verdict in ((1.0, "proved"), (0.97, "undecided")):
        sizes = evidence["sizes"]
        tube = (factor * np.array(sizes["tube"])).tolist()
        proposed = {"late_width": {**own, "sizes": {"cells": sizes["cells"], "tube": tube}}}
        claims = uncertain_claims(Problem(**TURNING), design.gains, proposed)
        assert claims[-1].verdict == verdict


def test_a_lower_tube_is_not_proved(design: Design) -> None:
    """The twin that must not be proved: a tube that the width leaves."""
    evidence = width_claim(design).evidence
    for factor, verdict in ((1.0, "proved"), (0.97, "undecided")):
        tube = (factor * np.array(evidence["tube"])).tolist()
        proposed = {"late_width": {"cells": evidence["cells"], "tube": tube}}
        claims = uncertain_claims(Problem(**PK), design.gains, proposed)
        assert claims[-1].verdict == verdict


def test_a_width_that_was_made_smaller_is_refuted(design: Design) -> None:
    own = width_claim(design)
    less = [0.99 * width for width in own.evidence["always"]]
    forged = replace(own, evidence={**own.evidence, "always": less})
    claims = tuple(forged if claim is own else claim for claim in design.claims)
    assert workflow.verify(replace(design, claims=claims)).verdict == "refuted"


@pytest.mark.parametrize("entry", ["always", "before", "after"])
def test_a_word_in_place_of_a_width_is_refuted(design: Design, entry: str) -> None:
    """Sentences are made of what a file states, too: words there are no internal error."""
    claim = width_claim(design)
    forged = replace(claim, evidence={**claim.evidence, entry: ["six", [1.0], None]})
    claims = tuple(forged if each is claim else each for each in design.claims)
    assert obsdesign.verify(replace(design, claims=claims)).verdict == "refuted"


@pytest.mark.parametrize(
    ("plant", "inputs"), [(PK, [100.0]), (TURNING, [3.0])], ids=["additive", "turning"]
)
def test_without_input_bound_widths_grow_with_the_inputs(
    plant: dict[str, Any], inputs: list[float]
) -> None:
    """Proved for inputs up to 1; N times that holds for those up to N, and once it does not."""
    own = {key: value for key, value in plant["event"][0].items() if key != "input_bound"}
    own["E"] = np.eye(len(plant["flow"]["A"]), 1).tolist()
    design = obsdesign.design(Problem(**{**plant, "event": [own]}))
    stated = obsdesign.design(Problem(**{**plant, "event": [{**own, "input_bound": [1]}]}))
    always = np.array(width_claim(design).evidence["always"])
    assert always.tolist() == width_claim(stated).evidence["always"]
    assert f"event.{own['name']}.input_bound is not stated" in str(design.warnings)
    assert "known inputs up to 1, N times that" in design.guarantees[1].statement
    assert not stated.warnings
    shortest, error = own["every"][0], own["time_error"] * 1.001
    rows = [Sample(0.0)]
    for t in (shortest * np.arange(1, 15)).tolist():
        happens = Sample(t, w=np.array(inputs), jump=True, events=(0,))
        rows += [Sample(t - error), happens, Sample(t + error), Sample(t + 2 * error)]
    observer: Any = from_design(design)
    state = observer.init(0.0, lower=np.zeros(len(always)), upper=np.zeros(len(always)))
    listed = list(observer.run(state, rows))[-4:]
    widest = np.max([e.upper - e.lower for e in (listed[0], *listed[2:])], axis=0)
    assert (widest <= inputs[0] * always).all()
    assert (widest > always).any()


def test_what_is_left_open_is_undecided() -> None:
    outcome = workflow.investigate(changed(every=None))
    assert outcome.verdict == "undecided"
    reason = next(claim.evidence["reason"] for claim in outcome.claims[1:])
    assert "event.dose.every is not stated" in reason


def test_a_flow_that_does_not_decay_is_undecided() -> None:
    body = {**PK, "flow": {"A": [[-1, 0, 0], [1, 0.1, 0.2], [0, 0.3, -0.2]]}}
    outcome = workflow.investigate(Problem(**body))
    assert outcome.verdict == "undecided"
    assert "does not decay" in outcome.claims[-1].evidence["reason"]


def test_a_larger_error_has_the_larger_width(design: Design) -> None:
    smaller = width_claim(obsdesign.design(changed(time_error=0.1))).evidence
    for name in ("before", "after", "always"):
        assert (np.array(smaller[name]) < np.array(width_claim(design).evidence[name])).all()


def test_events_further_apart_never_widen(design: Design) -> None:
    """By 1000 time constants too, where exponentials over a part of that leave all numbers."""
    further = width_claim(obsdesign.design(changed(every=[2e4, 3e4]))).evidence
    for name in ("before", "after", "always"):
        own, near = np.array(further[name]), np.array(width_claim(design).evidence[name])
        assert (own <= near).all()


def test_events_that_hardly_ever_come_are_undecided_in_words() -> None:
    outcome = workflow.investigate(changed(every=[6e80, 1.4e81]))
    assert outcome.verdict == "undecided"
    assert "no tube" in outcome.claims[-1].evidence["reason"]


def test_other_kinds_refuse_in_a_line() -> None:
    for kind in ("set_membership", "luenberger", "impulsive"):
        problem = Problem(**{**PK, "observer": {"kind": kind}})
        with pytest.raises(obsdesign.InputError, match=r"event\.dose\.time_error: kind"):
            workflow.investigate(problem)


# the second event is exact: it may happen in a window of the first
BESIDE: dict[str, Any] = {
    "flow": {"A": [[-0.9, 0.2], [0.3, -0.7]], "disturbance": {"lower": [-0.1, 0], "upper": [0.1, 0]}},
    "event": [
        {"name": "meal", "every": [2, 3], "disturbance": {"lower": [0, 0], "upper": [0, 0.4]}},
        {
            "name": "dose", "E": [[1], [0]], "input_bound": [2], "every": [3, 5],
            "time_error": 0.2,
        },
    ],
    "sensor": [{"name": "y", "C": [[0, 1]], "noise_bound": 0.05, "every": [0, 2]}],
    "observer": {"kind": "interval"},
}  # fmt: skip


def beside(**meal: Any) -> Problem:
    body = copy.deepcopy(BESIDE)
    body["event"][0] |= meal
    return Problem(**body)


@pytest.fixture(scope="module")
def design_beside() -> Design:
    return obsdesign.design(beside())


def test_widths_with_an_exact_event_beside(design_beside: Design) -> None:
    """At their shortest times every second dose has a meal in its window."""
    assert workflow.verify(design_beside).verdict == "proved"
    evidence = width_claim(design_beside).evidence
    run = simulate(
        beside().plant, until=15, initial=np.zeros(2), disturbance="extreme", dwell="shortest",
        step=0.25, rng=np.random.default_rng(0),
    )  # fmt: skip
    assert run.happened is not None
    observer: Any = from_design(design_beside)
    rows = rows_of(run.t, run.block("y"), w=run.block("w"), jump=run.happened)
    stamps = run.t[run.happened[:, 1]]
    state = observer.init(run.t[0], lower=[0, 0], upper=[0, 0])
    for e, x in zip(observer.run(state, rows), run.block("x"), strict=True):
        assert (e.lower <= x + 1e-9).all()
        assert (x - 1e-9 <= e.upper).all()
        if np.abs(e.t - stamps).min() > 0.2001:
            assert (e.upper - e.lower <= evidence["always"]).all()
    alone = Problem(**{**BESIDE, "event": [BESIDE["event"][1]]})
    less = width_claim(obsdesign.design(alone)).evidence["always"]
    assert (np.array(evidence["always"]) > less).all()


def test_a_lower_tube_with_an_exact_event_is_not_proved(design_beside: Design) -> None:
    evidence = width_claim(design_beside).evidence
    for factor, verdict in ((1.0, "proved"), (0.97, "undecided")):
        tube = (factor * np.array(evidence["tube"])).tolist()
        proposed = {"late_width": {"cells": evidence["cells"], "tube": tube}}
        assert uncertain_claims(beside(), design_beside.gains, proposed)[-1].verdict == verdict


@pytest.mark.parametrize(
    ("meal", "reason"),
    [
        ({"G": [[0.5, 0], [0, 1]]}, "it is otherwise for meal"),
        ({"every": [0.4, 3]}, "its shortest time must be above 0.4"),
        ({"time_error": 0.1}, "the plant has several (meal, dose)"),
    ],
)
def test_other_events_beside_leave_the_width_open(meal: dict[str, Any], reason: str) -> None:
    design = obsdesign.design(beside(**meal))
    assert [claim.id for claim in design.claims] == ["consistent"]
    assert reason in str(design.warnings)
