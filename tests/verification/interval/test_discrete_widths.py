"""Widths in discrete time: printed numbers, all words of the clocks, twins, forged evidence."""

from __future__ import annotations

import copy
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign import workflow
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.analysis.interval.step_graph import step_graph
from obsdesign.data.simulation import simulate
from obsdesign.document import Claim
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample, rows_of
from tests.systems.discrete_time import pulsed, turning, two_rates


def claims_of(body: dict[str, Any]) -> dict[str, Claim]:
    return {c.id: c for c in workflow.investigate(Problem.from_dict(body)).claims}


def always(body: dict[str, Any]) -> list[float]:
    claim = claims_of(body)["event_width"]
    assert claim.verdict == "proved"
    return list(claim.evidence["always"])


@pytest.mark.parametrize(
    ("gaps", "widths"),
    [
        ((2, 5), (0.1004, 0.2020, 1)),
        ((5, 10), (0.3340, 0.5080, 1)),
        ((3, 20), (0.4340, 0.3040, 1)),
        ((12, 20), (1.4744, 1.2220, 1)),
    ],
)
def test_widths_of_two_rates(gaps: tuple[int, int], widths: tuple[float, ...]) -> None:
    """The largest over all words, to 1e-8: those of a recursion by hand."""
    np.testing.assert_allclose(always(two_rates(*gaps)), widths, rtol=1e-8, atol=0)


def test_every_word_of_the_clocks_is_below_and_one_comes_near() -> None:
    """All timings of 12 steps from the largest width: those of the two sensors and the event."""
    problem = Problem.from_dict(pulsed())
    evidence = claims_of(pulsed())["event_width"].evidence
    design = obsdesign.design(problem)
    system = ClockSystem(ClockedIntervalGains.from_document(design.gains))
    graph = step_graph(system)
    assert not isinstance(graph, str)
    width, stages = np.array(evidence["always"]), graph.floats
    # by itself: ages (sensor 1, sensor 2, event) -> the largest widths of all words up to here
    reached = {(0, 0, 0): width}
    largest = np.zeros(2)
    words = list(product((True, False), repeat=3))
    for _ in range(40):
        following: dict[tuple[int, ...], np.ndarray[Any, Any]] = {}
        for ages, u in reached.items():
            for happens in words:
                older = [age + 1 for age in ages]
                due = [older[0] == 2, older[1] == 4, older[2] == 5]
                if any(d and not h for d, h in zip(due, happens, strict=True)):
                    continue
                if happens[2] and older[2] < 3:
                    continue
                after = tuple(0 if h else a for h, a in zip(happens, older, strict=True))
                value = _width_after(u, happens)
                following[after] = np.maximum(following.get(after, value), value)
        reached = following
        largest = np.max(list(reached.values()), axis=0)
    assert stages
    assert (largest <= width).all()
    np.testing.assert_allclose(largest, width, rtol=1e-6)


def _width_after(u: np.ndarray[Any, Any], happens: tuple[bool, ...]) -> np.ndarray[Any, Any]:
    """One step of plant `pulsed`, written out: strips of x1 and of x1 + x2, the swap."""
    u = np.array([[0.75, 0.25], [0, 0.5]]) @ u + [0.25, 0.25]
    first, second, event = happens
    if first:
        u = np.minimum(u, [0.5, np.inf])

    def cut(w: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        return np.minimum(w, [0.75 + w[1], 0.75 + w[0]])

    if second and not event:
        u = cut(u)
    if event:
        u = np.array([[0, 1], [1.5, 0]]) @ u + [0, 0.5]
        u = cut(u) if second else u
    return u


def test_widths_of_a_run_stay_below_and_the_latest_samples_reach_them() -> None:
    problem = Problem.from_dict(two_rates(2, 5))
    design = obsdesign.design(problem)
    limit = np.array(always(two_rates(2, 5)))
    observer = from_design(design)
    state = observer.init(0.0, lower=[-9] * 3, upper=[9] * 3)
    run = simulate(problem.plant, until=100.0, rng=np.random.default_rng(0))
    widths = [row.upper - row.lower for row in observer.run(state, rows_of(run.t, run.block("y")))]
    assert (np.array(widths[800:]) <= limit * (1 + 1e-5)).all()
    largest, state = np.zeros(3), observer.init(0.0, lower=[-9] * 3, upper=[9] * 3)
    for k in range(1, 1000):
        y = [0.0 if k % 2 == 1 else np.nan, 0.0 if k % 5 == 0 else np.nan]
        state, row = observer.step(state, Sample(round(0.1 * k, 9), y=y))
        assert row.status == "ok"
        largest = np.maximum(largest, row.upper - row.lower) if k > 900 else largest
    assert (largest <= limit * (1 + 1e-5)).all()
    assert (largest[:2] >= 0.99 * limit[:2]).all()


def test_widths_change_with_the_units() -> None:
    """States in units 2^a, time in units of 8: widths are those, in the new units."""
    plain = always(two_rates(3, 4))
    scaled, units = copy.deepcopy(two_rates(3, 4)), np.array([0.25, 2.0, 16.0])
    flow = scaled["flow"]
    flow["A"] = (np.array(flow["A"]) * units[:, None] / units).tolist()
    flow["dt"] *= 8
    for end in ("lower", "upper"):
        flow["disturbance"][end] = (np.array(flow["disturbance"][end]) * units).tolist()
    for sensor in scaled["sensor"]:
        sensor["C"] = (np.array(sensor["C"]) / units).tolist()
        sensor["every"][1] = round(8 * sensor["every"][1], 9)
    np.testing.assert_allclose(always(scaled), np.array(plain) * units, rtol=1e-8)


def test_a_later_sample_never_narrows() -> None:
    widths = [always(two_rates(2, later)) for later in (1, 2, 4, 8)]
    assert (np.diff(widths, axis=0) >= -1e-9).all()


def test_twins_are_not_proved() -> None:
    """A speed that is never read, and |A| that grows: no tube."""
    blind = two_rates(2, 5)
    blind["sensor"][0]["every"] = [0, "inf"]
    claims = claims_of(blind)
    assert claims["event_stability"].verdict == "undecided"
    assert "speed may be silent for any time" in claims["event_stability"].evidence["reason"]
    unread = two_rates(2, 5)
    unread["sensor"] = unread["sensor"][1:]
    reason = claims_of(unread)["event_stability"].evidence["reason"]
    assert "no output has x2, x3" in reason
    faster = turning("interval", measured="periodic", period=0.9)
    assert claims_of(faster)["event_stability"].verdict == "undecided"
    assert claims_of(turning("interval"))["event_stability"].verdict == "proved"


def test_an_event_at_any_time_leaves_no_width() -> None:
    body = pulsed()
    body["event"][0]["every"] = [0, 2.5]
    outcome = workflow.investigate(Problem.from_dict(body))
    assert outcome.verdict == "proved"
    assert [claim.id for claim in outcome.claims] == ["consistent"]
    assert outcome.design is not None
    assert all(one.given for one in outcome.design.guarantees)
    (text,) = outcome.design.warnings
    assert text == (
        "No width of the bounds is proved: event swap may happen any number of times in one step: "
        "its shortest time is zero, or not stated."
    )


def test_forged_evidence_and_gains_are_not_confirmed() -> None:
    design = obsdesign.design(Problem.from_dict(two_rates(2, 5)))
    assert obsdesign.verify(design).verdict == "proved"
    for name in ("event_width", "event_stability"):
        claims = []
        for claim in design.claims:
            evidence = copy.deepcopy(claim.evidence)
            if claim.id == name:
                evidence["tube"][3][2] *= 0.9
            claims.append(replace(claim, evidence=evidence))
        assert obsdesign.verify(replace(design, claims=tuple(claims))).verdict != "proved"
    narrower = [
        replace(c, evidence={**c.evidence, "always": [0.1, 0.2, 1.0]})
        if c.id == "event_width"
        else c
        for c in design.claims
    ]
    assert obsdesign.verify(replace(design, claims=tuple(narrower))).verdict != "proved"
    for key, value in (("dt", 0.2), ("sensors", None)):
        gains = copy.deepcopy(dict(design.gains))
        if key == "sensors":
            gains["sensors"][0]["gap"] = 0.1
        else:
            gains[key] = value
        assert obsdesign.verify(replace(design, gains=gains)).verdict == "refuted"


def test_a_reason_that_claims_share_is_given_once() -> None:
    """A speed that no sensor measures: both claims on widths are undecided for one reason."""
    plain = two_rates(2, 5)
    with pytest.raises(workflow.NotProved) as refusal:
        obsdesign.design(Problem.from_dict({**plain, "sensor": plain["sensor"][1:]}))
    claims = [claim for claim in refusal.value.outcome.claims if claim.verdict == "undecided"]
    assert len(claims) == 2
    assert str(refusal.value).count("no tube was found on the graph of the clocks") == 1
