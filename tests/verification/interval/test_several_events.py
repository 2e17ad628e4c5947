"""Widths of interval observers for plants with several events: against sequences, twins, forgeries."""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

import obsdesign
from obsdesign import workflow
from obsdesign.analysis.interval.event_graph import stability_graph
from obsdesign.analysis.interval.marks import Marks
from obsdesign.data.simulation import simulate
from obsdesign.document import Design
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample, rows_of
from tests.systems.designs import designed
from tests.systems.event_widths import doses, is_stable, system_of, two_states

Floats = NDArray[np.float64]


def kicked(gap: float = 0.2, hit: tuple[float, float] = (2, 3)) -> dict[str, Any]:
    """Two states that two events widen."""
    body = two_states(hit, gap)
    kick = {"lower": [-0.1, 0], "upper": [0.1, 0]}
    body["event"].append(
        {"name": "kick", "G": [[1, 0], [0.5, 1.2]], "every": [3, 9], "disturbance": kick}
    )
    return body


def seen_at_hits(sees: str) -> dict[str, Any]:
    """The same with a sensor that is read at one of the events."""
    body = kicked()
    body["sensor"].append(
        {"name": "at_hit", "C": [[1, 0]], "noise_bound": 0.03, "at": "hit", "sees": sees}
    )
    return body


def bolus(gap: float) -> dict[str, Any]:
    """Doses, and now and then another one into the blood."""
    body = doses(gap)
    more = {"lower": [0, 9, 0], "upper": [0, 10, 0]}
    body["event"].append({"name": "bolus", "every": [20, 40], "disturbance": more})
    return body


@functools.cache
def _designed(plant: Callable[..., dict[str, Any]], *arguments: Any) -> Design:
    return designed(plant(*arguments), allow_undecided=True)


def _evidence(design: Design) -> dict[str, Any]:
    width = next(claim for claim in design.claims if claim.id == "event_width")
    assert width.verdict == "proved"
    return dict(width.evidence)


class Sequence:
    """Widths along one sequence of events and samples, from the equations of docs/interval.md.

    Times between events of a name are the shortest, the longest, or any; the last sample before an
    event is often the longest gap before it.
    """

    def __init__(self, body: dict[str, Any], rng: np.random.Generator) -> None:
        self.rng, self.events, self.sensors = rng, body["event"], body["sensor"]
        A, box = np.array(body["flow"]["A"], dtype=float), body["flow"]["disturbance"]
        n = self.n = len(A)
        self.Z = np.zeros((n + 1, n + 1))
        self.Z[:n, :n] = np.where(np.eye(n, dtype=bool), A, np.abs(A))
        self.Z[:n, n] = np.array(box["upper"]) - np.array(box["lower"])
        self.mood = rng.choice(["shortest", "longest", "any"])
        self.due = [rng.choice([0.0, rng.uniform(0, x["every"][0])]) for x in self.events]
        self.next = [0.0 for _ in self.sensors]

    def flow(self, w: Floats, time: float) -> Floats:
        whole: Floats = expm(self.Z * time)
        return (whole @ np.append(w, 1.0))[: self.n]

    def happened(self, event: int, w: Floats) -> Floats:
        own = self.events[event]
        box = own["disturbance"]
        G = np.abs(np.array(own.get("G", np.eye(self.n)), dtype=float))
        return G @ w + np.array(box["upper"]) - np.array(box["lower"])

    def sampled(self, sensor: int, w: Floats) -> Floats:
        own, kept = self.sensors[sensor], w.copy()
        c = np.abs(np.array(own["C"][0], dtype=float))
        for i in np.flatnonzero(c):
            others = c @ w - c[i] * w[i]
            kept[i] = min(w[i], (2 * own["noise_bound"] + others) / c[i])
        return kept

    def largest(self, until: float) -> tuple[Floats, Floats, Floats]:
        """(always, before, after) in the second half; before, after of each event."""
        t, w, size = 0.0, np.full(self.n, 3.0), (len(self.events), self.n)
        always, before, after = np.zeros(self.n), np.zeros(size), np.zeros(size)
        while t < until:
            now = min([*self.due, *self.next])
            middle, w = self.flow(w, (now - t) / 2), self.flow(w, now - t)
            t, counts = now, now > until / 2
            always = np.maximum(always, np.maximum(middle, w)) if counts else always
            for k in self.rng.permutation(len(self.due) + len(self.next)).tolist():
                if k < len(self.due) and self.due[k] == t:
                    before[k] = np.maximum(before[k], w) if counts else before[k]
                    w = self.happened(k, w)
                    after[k] = np.maximum(after[k], w) if counts else after[k]
                    self.due[k] = t + self._until_next(self.events[k]["every"])
                elif k >= len(self.due) and self.next[k - len(self.due)] == t:
                    w = self.sampled(k - len(self.due), w)
                    self.next[k - len(self.due)] = self._next_sample(k - len(self.due), t)
            always = np.maximum(always, w) if counts else always
        return always, before, after

    def _until_next(self, every: Any) -> float:
        low, high = every
        mood = self.mood if self.rng.random() < 0.8 else "any"
        return {"shortest": low, "longest": high}.get(mood, self.rng.uniform(low, high))

    def _next_sample(self, sensor: int, t: float) -> float:
        gap = self.sensors[sensor]["every"][1]
        early = [due - gap for due in self.due if t < due - gap < t + gap]
        return early[0] if early and self.rng.random() < 0.6 else t + gap


@pytest.mark.parametrize(("plant", "arguments", "until"), [
    (kicked, (0.2,), 40.0), (two_states, ((2, 3), 3.1), 40.0),
])  # fmt: skip
def test_no_sequence_is_wider_than_what_is_proved(
    plant: Callable[..., dict[str, Any]], arguments: Any, until: float
) -> None:
    """Several events, and gaps longer than the time between two; never far too wide either."""
    evidence, body = _evidence(_designed(plant, *arguments)), plant(*arguments)
    names, rng = [event["name"] for event in body["event"]], np.random.default_rng(5)
    bounds = [np.array(evidence["always"])]
    bounds += [np.array([evidence[x][name] for name in names]) for x in ("before", "after")]
    largest = [np.zeros_like(bound) for bound in bounds]
    for _ in range(6):
        for place, widths in enumerate(Sequence(body, rng).largest(until)):
            largest[place] = np.maximum(largest[place], widths)
    for bound, width in zip(bounds, largest, strict=True):
        assert (width <= bound).all()
    assert (bounds[0] <= 3 * largest[0]).all()


def test_events_that_widen_without_end_are_not_proved() -> None:
    """Stable without kicks; with them every width grows along one sequence. Twin: rarer hits."""
    body, w, kicks = kicked(0.2, (0.8, 1.2)), np.ones(2), 0.0
    run = Sequence(body, np.random.default_rng(0))
    run.Z[:, -1] = 0.0
    for hit in range(1, 401):  # a sample is the longest gap before every hit, kicks after it
        w = run.flow(run.flow(w, 0.6) * [1, 0], 0.2)
        if hit * 0.8 >= kicks + 3:
            w, kicks = np.array(body["event"][1]["G"]) @ w, hit * 0.8
        w = np.abs(np.array(body["event"][0]["G"])) @ w
    assert w.max() > 1e3
    assert not any(is_stable(body, cells) for cells in (1, 2, 4))
    assert is_stable(kicked(0.2, (1.3, 1.5)), 2)
    assert is_stable({**body, "event": body["event"][:1]}, 4)


def test_a_sequence_of_events_goes_from_mark_to_mark() -> None:
    """Every record of events is a path of marks, whose times it keeps."""
    plant = Problem.from_dict(seen_at_hits("before")).plant
    system = system_of(seen_at_hits("before"))
    marks, rng = Marks(system, (0, 1), 4), np.random.default_rng(0)
    assert set(marks.kinds) == {(0,), (1,), (0, 1), (1, 0)}
    pairs = {(x, y): time for x, y, time in marks.following}
    last, t, before = [0.0, 0.0], 0.0, set(range(len(marks.marks)))
    for _ in range(200):
        due = [t0 + rng.choice([x.dwell_time[0], rng.uniform(*x.dwell_time)])
               for t0, x in zip(last, plant.events, strict=True)]  # fmt: skip
        due = [max(x, t) for x in due]
        now = min(due)
        own = tuple(k for k in (0, 1) if due[k] == now)
        ages = {k: now - last[k] for k in (0, 1)}
        following = [
            place for place, mark in enumerate(marks.marks)
            if mark.events == own
            and all(low <= ages[k] + 1e-9 and (high is None or ages[k] - 1e-9 <= high)
                    for k, (low, high) in mark.due.items())
        ]  # fmt: skip
        assert following
        reached = {
            y for x in before for y in following
            if (time := pairs.get((x, y))) is not None
            and time[0] <= now - t + 1e-9 and (time[1] is None or now - t - 1e-9 <= time[1])
        }  # fmt: skip
        assert reached
        before, t = reached, now
        for k in own:
            last[k] = now


@pytest.mark.parametrize("sees", ["before", "after"])
def test_events_of_one_row_share_what_is_seen_at_one(sees: str) -> None:
    """Hits and kicks together: the sensor at the hit acts before or after both of them."""
    design = _designed(seen_at_hits, sees)
    always, observer = np.array(_evidence(design)["always"]), from_design(design)
    state: Any = observer.init(0.0, lower=[-1, -1], upper=[1, 1])  # type: ignore[attr-defined]
    for k in range(1, 300):
        hit, kick = k % 10 == 0, k % 20 == 0
        y = [0.0, 0.0 if hit else np.nan]
        row = Sample(0.2 * k, y, events=(*[0] * hit, *[1] * kick), jump=hit)
        state, estimate = observer.step(state, row)
        assert estimate.status == "ok"
        if k > 150:
            assert (estimate.upper - estimate.lower <= always).all()


def test_bounds_that_run_are_as_narrow_as_claimed() -> None:
    """Random clocks of two events, whose samples are missing at random."""
    design, plant = _designed(kicked, 0.2), Problem.from_dict(kicked(0.2)).plant
    always, observer = np.array(_evidence(design)["always"]), from_design(design)
    run = simulate(plant, until=60.0, disturbance="random", rng=np.random.default_rng(1))
    rows = list(rows_of(run.t, run.block("y"), w=run.block("w"), jump=run.happened))
    state: Any = observer.init(rows[0].t, lower=[-1, -1], upper=[1, 1])  # type: ignore[attr-defined]
    listed: Any = list(observer.run(state, rows))[len(rows) // 2 :]
    assert all((one.upper - one.lower <= always * (1 + 1e-9)).all() for one in listed)
    assert {one.status for one in listed} == {"ok"}


@pytest.mark.parametrize("name", ["event_stability", "event_width"])
def test_forged_evidence_of_several_events_is_not_believed(name: str) -> None:
    """Changed tubes, numbers, cells; and a design whose events are rarer than the problem's."""
    design = _designed(kicked, 0.2)
    assert obsdesign.verify(design).verdict == "proved"
    claim = next(c for c in design.claims if c.id == name)
    tube = np.array(claim.evidence["tube"])
    smaller = np.where(np.arange(len(tube))[:, None] == 1, 0.5 * tube, tube)
    forgeries: list[dict[str, Any]] = [
        {"tube": smaller.tolist()}, {"cells": 256},
    ]  # fmt: skip
    if name == "event_width":
        before = copy.deepcopy(claim.evidence["before"])
        before["kick"][0] *= 0.99
        forgeries += [{"before": before}, {"after": {}}]
    for forged in forgeries:
        changed = replace(claim, evidence={**claim.evidence, **forged})
        claims = tuple(changed if c.id == name else c for c in design.claims)
        assert obsdesign.verify(replace(design, claims=claims)).verdict != "proved", forged
    often, gains = kicked(0.2), copy.deepcopy(dict(design.gains))
    often["event"][1]["every"] = gains["events"][1]["dwell_time"] = [1.0, 9.0]
    verdicts = {
        c.id: c.verdict
        for c in obsdesign.verify(replace(design, problem=often, gains=gains)).claims
    }
    assert verdicts["consistent"] == "proved"
    assert verdicts[name] == "undecided"


def test_doses_do_not_matter_for_stability() -> None:
    """Events that add to the width alone are left out of the graph, those of any number are not."""
    nodes = stability_graph(system_of(bolus(2)), 1)
    assert nodes is not None
    assert not nodes.marks
    endless = bolus(2)
    endless["event"][1]["every"] = [0, 40]
    assert not any(is_stable(endless, cells) for cells in (1, 2, 4))
    reason = next(
        claim.evidence["reason"]
        for claim in workflow.investigate(Problem.from_dict(endless)).claims
        if claim.id == "event_width"
    )
    assert "event bolus has no shortest time above zero" in reason
