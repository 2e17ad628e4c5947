"""Stability and widths on clocks of their own are proved again; of other clocks they are not."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.balls import exact, to_float
from lmi.arithmetic.exponential import expm
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.analysis.interval.event_graph import stability_graph
from obsdesign.analysis.interval.mark_graph import MarkGraph
from obsdesign.checker import check_events, check_widths
from obsdesign.design_file import from_dict
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from tests.checker.test_check_widths import definitions
from tests.systems.checked import CHECK_EVENTS, answer, changed, evidence, exit_code
from tests.systems.designs import investigated_file
from tests.systems.event_widths import motor, stable_tube, system_of, two_states

EXAMPLES = Path(__file__).parents[2] / "examples"
WIDE = ("motor_encoders", "odometer_gps", "thermometer")
Change = Callable[[dict[str, Any]], object]


def _with(body: dict[str, Any], **blocks: Any) -> dict[str, Any]:
    return body | {name: [*body.get(name, []), entry] for name, entry in blocks.items()}


def _zeros(n: int) -> dict[str, Any]:
    return {"lower": [0.0] * n, "upper": [0.0] * n}


KICK = {"name": "kick", "G": [[1, 0], [0.5, 1.2]], "every": [3, 9], "disturbance": _zeros(2)}
FIRST = {"name": "first", "C": [[1, 0]], "noise_bound": 0.03, "every": [0, 0.4]}
AT_HIT = {"name": "at_hit", "C": [[1, 0]], "noise_bound": 0.03, "at": "hit"}
PLANTS: dict[str, dict[str, Any]] = {
    "one event": two_states((1.3, 1.9), 0.2),
    "it may stay away": two_states((1.3, math.inf), 0.2),
    "near the limit": two_states((0.79, 1.2), 0.2),
    "two events": _with(two_states((2.0, 3.0), 0.2), event=KICK),
    "one row": _with(two_states((2.0, 3.0), 0.2), event=KICK, sensor=AT_HIT | {"sees": "after"}),
    "two sensors": _with(two_states((1.2, 2.0), 0.3), sensor=FIRST),
    "apart": _with(two_states((2.0, 3.0), 0.2), event=KICK) | {"timing": {"spacing": 0.5}},
    "continuous": _with(two_states((1.3, 1.9), 0.2), sensor=FIRST | {"every": "continuous"}),
    "no events": motor(0.03, 0.15),
    "two states": {
        "name": "two states",
        "flow": {"A": [[-1, 0], [1, -1]], "disturbance": _zeros(2)},
        "sensor": [FIRST | {"every": [0, 0.1]}],
        "observer": {"kind": "interval"},
    },
}


def unproved(body: dict[str, Any], **evidence: Any) -> dict[str, Any]:
    """A design without gains, signed, with whatever evidence of its stability."""
    document = {
        "format": "obsdesign/design", "version": 1, "name": body["name"], "kind": "interval",
        "problem": obsdesign.Problem.from_dict(body).to_dict(),
        "gains": system_of(body).gains.to_document(),
        "claims": [{"id": "event_stability", "verdict": "proved", "evidence": evidence}],
    }  # fmt: skip
    text = json.dumps(document, default=np.ndarray.tolist).replace("Infinity", '"inf"')
    return changed(json.loads(text), lambda d: None)


@cache
def _text(name: str) -> str:
    if name in WIDE:
        design = investigated_file(EXAMPLES / f"{name}.toml").design
        assert design is not None
        return json.dumps(design.to_dict())
    system = system_of(PLANTS[name])
    cells, tube = next((k, v) for k in (1, 2, 4, 8) if (v := stable_tube(system, k)) is not None)
    return json.dumps(unproved(PLANTS[name], cells=cells, tube=tube))


def document(name: str) -> Any:
    """The document of a design, signed."""
    return json.loads(_text(name))


@pytest.mark.parametrize("name", [*PLANTS, *WIDE])
def test_it_is_proved_again(name: str) -> None:
    code, text = answer(document(name), CHECK_EVENTS)
    assert code == 0, text
    assert "tends to zero" in text.splitlines()[0]
    assert ("comes to at most" in text) == (name in WIDE)
    assert "not checked: " in text.splitlines()[-1]


def test_its_sentences_are_its_own() -> None:
    lines = answer(document("apart"), CHECK_EVENTS)[1].splitlines()
    assert lines[0] == (
        "proved: without disturbances and noise the width tends to zero; assumed: 'hit' again "
        "2.0 to 3.0 later, 'kick' again 3.0 to 9.0 later, different events at least 0.5 apart, "
        "of 'level' a sample in any 0.2"
    )
    assert "event_stability" not in lines[-1]
    without = changed(document("motor_encoders"), lambda d: d["claims"].pop())
    assert "comes to" not in answer(without, CHECK_EVENTS)[1]


def test_every_time_that_the_proof_rests_on_is_in_the_sentence() -> None:
    first = answer(document("one row"), CHECK_EVENTS)[1].splitlines()[0]
    assert "apart" not in first  # in one row they have no time between them
    assert first.endswith("of 'level' a sample in any 0.2, of 'at_hit' a sample after every 'hit'")
    first = answer(document("continuous"), CHECK_EVENTS)[1].splitlines()[0]
    assert first.endswith("of 'level' a sample in any 0.2, of 'first' nothing")
    for line in answer(document("thermometer"), CHECK_EVENTS)[1].splitlines()[:2]:
        assert line.startswith("proved: with")
        assert line.split("; assumed: ")[1].startswith("of '")


def test_late_reports_are_in_the_sentence() -> None:
    for block, delay, ending in (
        ("event", 0.5, ", every report in"), ("sensor", 0.5, ", every report in"), ("sensor", 0.0, "0.2"),
    ):  # fmt: skip
        late = changed(document("one event"), entry(block, "report_delay", delay))
        assert answer(late, CHECK_EVENTS)[1].splitlines()[0].endswith(ending)


def entry(block: str, name: str, value: Any, place: int = 0) -> Change:
    """An entry of the problem is another."""
    return lambda d: d["problem"][block][place].update({name: value})


def clock(every: Any) -> Change:
    """The clock of the first event, in the problem and in the gains."""

    def change(d: dict[str, Any]) -> None:
        d["problem"]["event"][0]["every"] = d["gains"]["events"][0]["dwell_time"] = every

    return change


def gap(longest: float) -> Change:
    """The longest silence of the first sensor, in both."""

    def change(d: dict[str, Any]) -> None:
        d["problem"]["sensor"][0]["every"] = [0.0, longest]
        d["gains"]["sensors"][0]["gap"] = longest

    return change


def tube(claim: str, node: int, factor: float) -> Change:
    def change(d: dict[str, Any]) -> None:
        rows = evidence(d, claim)["tube"]
        rows[node] = [factor * a for a in rows[node]]

    return change


def stated(claim: str, **entries: Any) -> Change:
    return lambda d: evidence(d, claim).update(entries)


def in_gains(*path: Any, value: Any) -> Change:
    def change(d: dict[str, Any]) -> None:
        block = d["gains"]
        for name in path[:-1]:
            block = block[name]
        block[path[-1]] = value

    return change


WRONG: list[tuple[str, str, Change]] = [
    ("one event", "the problem's clock alone", entry("event", "every", [1.2, 1.9])),
    ("one event", "a longer gap of the problem", entry("sensor", "every", [0.0, 0.3])),
    ("near the limit", "events come earlier", clock([0.77, 1.2])),
    ("near the limit", "samples come later", gap(0.25)),
    ("one event", "a bound is missing", lambda d: evidence(d, "event_stability")["tube"].pop()),
    ("one event", "one too many", stated("event_stability", tube=[[1.0, 1.0]] * 4)),
    ("near the limit", "a bound of one node is lower", tube("event_stability", 0, 0.5)),
    ("near the limit", "another is higher", tube("event_stability", 1, 3.0)),
    ("one event", "a bound is zero", tube("event_stability", 0, 0.0)),
    ("one event", "its sign", tube("event_stability", 0, -1.0)),
    ("one event", "no cells", stated("event_stability", cells=0)),
    ("one event", "cells that are no number", stated("event_stability", cells=True)),
    ("two events", "another number of cells", stated("event_stability", cells=2)),
    ("it may stay away", "a flow that grows", lambda d: [
        block.update(A=[[0.01, 0.0], [1.0, -2.0]]) for block in (d["gains"], d["problem"]["flow"])
    ]),
    ("one row", "the sensor sees the state before", lambda d: [
        block.update(sees="before")
        for block in (d["problem"]["sensor"][1], d["gains"]["sensors"][1])
    ]),
    ("one row", "a word", entry("sensor", "sees", "never", 1)),
    ("one row", "it is read at another event", entry("sensor", "at", "kick", 1)),
    ("two sensors", "a sensor more in the gains", lambda d: d["gains"]["sensors"].append(
        dict(d["gains"]["sensors"][1])
    )),
    ("two events", "an event more in the gains", lambda d: [
        d["gains"][name].append(d["gains"][name][1]) for name in ("events", "M")
    ]),
    ("one event", "another name of a sensor", in_gains("sensors", 0, "name", value="x")),
    ("one event", "another number of outputs", in_gains("sensors", 0, "outputs", value=2)),
    ("one event", "it sees another state", in_gains("sensors", 0, "sees", value="after")),
    ("one event", "it is read at an event", in_gains("sensors", 0, "event", value="hit")),
    ("one event", "a word of both", lambda d: [
        block.update(sees="never")
        for block in (d["problem"]["sensor"][0], d["gains"]["sensors"][0])
    ]),
    ("one event", "another name of an event", in_gains("events", 0, "name", value="x")),
    ("one event", "losses of a range", entry("sensor", "losses", 1)),
    ("one event", "jitter of a range", entry("sensor", "jitter", 0.1)),
    ("continuous", "losses", entry("sensor", "losses", 1, 1)),
    ("one row", "losses of a sensor that is read at an event", entry("sensor", "losses", 1, 1)),
    ("one row", "it has a clock, too", entry("sensor", "every", [0.0, "inf"], 1)),
    ("one row", "it is read at no event", lambda d: [
        d["problem"]["sensor"][1].update(at="none"), d["gains"]["sensors"][1].update(event="none")
    ]),
    ("continuous", "it has no clock", lambda d: [
        d["problem"]["sensor"][1].pop("every"), d["gains"]["sensors"][1].update(gap="inf")
    ]),
    ("one event", "a clock and an event", lambda d: [
        d["problem"]["sensor"][0].update(at="hit"), d["gains"]["sensors"][0].update(event="hit")
    ]),
    ("two sensors", "two of one name", lambda d: [
        x["sensor" + end][1].update(name="level") for x, end in ((d["problem"], ""), (d["gains"], "s"))
    ]),
    ("one event", "a name of an event", lambda d: [
        x["sensor" + end][0].update(name="hit") for x, end in ((d["problem"], ""), (d["gains"], "s"))
    ]),
    ("one event", "a report before its time", entry("sensor", "report_delay", -1.0)),
    ("one event", "jitter below zero", entry("sensor", "jitter", -5e-324)),
    ("one event", "losses that are no number", entry("sensor", "losses", True)),
    ("two events", "another order", lambda d: d["gains"]["events"].reverse()),
    ("two events", "the map of an event", entry("event", "G", [[1, 0], [0.4, 1.2]], 1)),
    ("two events", "one event less", lambda d: d["gains"]["events"].pop()),
    ("apart", "events may be closer", lambda d: d["problem"]["timing"].update(spacing=0.1)),
    ("apart", "in the gains", in_gains("spacing", value=0.1)),
    ("two sensors", "another output", entry("sensor", "C", [[0.5, 0.0]], 1)),
    ("no events", "a flow of the gains", in_gains("A", 2, 2, value=-2.1)),
    ("no events", "later samples", gap(1e6)),
    ("motor_encoders", "a lower tube", tube("event_width", 0, 0.99)),
    ("motor_encoders", "a lower bound", stated("event_width", always=[0.01, 0.04, 0.0004])),
    ("motor_encoders", "more noise", in_gains("noise_bound", value=[0.0051, 0.02])),
    ("motor_encoders", "a sign of noise", in_gains("noise_bound", value=[0.005, -0.02])),
    ("motor_encoders", "a larger disturbance", in_gains("flow_upper", 1, value=0.21)),
    ("motor_encoders", "bounds that cross", in_gains("flow_upper", 1, value=-0.3)),
    ("odometer_gps", "a lower tube", tube("event_width", 0, 0.9)),
    ("thermometer", "a lower tube", tube("event_width", 0, 0.9)),
]  # fmt: skip


@pytest.mark.parametrize(("name", "what", "change"), WRONG)
def test_what_does_not_hold_is_not_proved(name: str, what: str, change: Change) -> None:
    assert exit_code(changed(document(name), change), check_events) == 1


UNREAD: list[tuple[str, Change]] = [
    ("uncertain times", entry("event", "time_error", 0.1)),
    ("modes of an event", entry("event", "modes", ["on"])),
    ("discrete time", lambda d: d["problem"]["flow"].update(dt=0.1)),
    ("modes", lambda d: d["problem"].update(mode=[])),
    ("parameters", lambda d: d["problem"].update(parameter=[])),
    ("another kind", lambda d: d.update(kind="luenberger")),
    ("no claim of this program", lambda d: d["claims"].clear()),
]


@pytest.mark.parametrize(("what", "change"), UNREAD)
def test_other_plants_are_not_read(what: str, change: Change) -> None:
    assert exit_code(changed(document("one event"), change), check_events) == 2


def test_verify_agrees_with_what_is_refused() -> None:
    body = document("motor_encoders")
    assert obsdesign.verify(from_dict(body), paranoid=True).verdict == "proved"
    lower = changed(body, tube("event_width", 0, 0.99))
    assert obsdesign.verify(from_dict(lower)).verdict != "proved"


# the graph --------------------------------------------------------------------------------------


def random_clocks(seed: int) -> dict[str, Any]:
    """Two events and two sensors: spacings and gaps of any order, ends with and without room."""
    rng = np.random.default_rng([26, seed])
    body = two_states((1.0, 2.0), 0.2) | {"timing": {"spacing": float(rng.choice([0.0, 0.3]))}}
    body["event"] = [*body["event"], dict(KICK)]
    body["sensor"] = [*body["sensor"], dict(FIRST), *([AT_HIT] if seed % 2 else [])]
    for event in body["event"]:
        low = float(rng.choice([0.3, 1.0, 2.0]))
        event["every"] = [low, low + float(rng.choice([0.0, 0.5, 3.0, math.inf]))]
    for sensor in body["sensor"][:2]:
        sensor["every"] = [0.0, float(rng.choice([0.2, 0.7, 2.5]))]
    body["sensor"][0] |= {"every": 0.1, "jitter": 0.02, "losses": int(rng.integers(0, 9))}
    return body


CLOCKS = [(body, 3) for body in PLANTS.values() if "event" in body]
CLOCKS += [(random_clocks(seed), 1) for seed in range(12)]
CLOCKS += [(random_clocks(seed), 2) for seed in (0, 3, 4)]
ANY = {"name": "any", "G": [[1, 0], [0, 1]], "disturbance": _zeros(2)}
CLOCKS += [(_with(two_states((1.0, 2.0), 0.2), event=ANY), 2)]


@pytest.mark.parametrize(("body", "cells"), CLOCKS)
def test_the_graph_is_that_of_verify(body: dict[str, Any], cells: int) -> None:
    """Nodes in the same order, and passages in exact times that those in floats contain."""
    design = check_events.Design(json.dumps(unproved(body)))
    design.read()
    maps = check_events.WidthMaps(design, homogeneous=True)
    system = system_of(body)
    builder = MarkGraph(system, maps.events, cells)
    graph = check_events.Graph(maps, check_events.Marks(maps, cells, 1))
    other, nodes = builder.graph(math.inf), stability_graph(system, cells)
    assert other is not None
    assert nodes is not None
    assert len(nodes.graph.nodes) == len(graph.nodes)
    assert [(node.sort, *node.places) for node in builder.places] == [*graph.places]
    for own, lists in zip(other.nodes, graph.nodes, strict=True):
        assert list(map(len, own)) == list(map(len, lists))
        for strategy, passages in zip(own, lists, strict=True):
            for one, (source, place, (low, high)) in zip(strategy, passages, strict=True):
                event = len(graph.happens) - 1 if one.event is None else one.event
                assert (one.source, event) == (source, place)
                assert one.low <= low <= high <= one.high
                assert float(high) >= one.high * (1 - 1e-9)


def test_what_events_and_samples_do_is_that_of_verify() -> None:
    """Random outputs and gains, read before and after events, several in a row."""
    rng = np.random.default_rng(27)
    for seed in range(6):
        body = random_clocks(seed) | {"timing": {"spacing": 0.0}}
        body["sensor"] += [AT_HIT | {"name": "later", "sees": "after"}]
        body["sensor"] += [AT_HIT | {"name": "at_kick", "at": "kick"}]
        for sensor in body["sensor"]:
            sensor |= {"C": rng.choice([-2.0, 0.0, 0.5, 3.0], (1, 2)).tolist(), "noise_bound": 0.3}
        plant = obsdesign.Problem.from_dict(body).plant
        L, M = rng.uniform(-1, 1, (2, plant.p)), rng.uniform(-1, 1, (2, 2, plant.p))
        M[seed % 2] *= np.arange(plant.p) == (plant.p - 1 if seed % 2 else 2)
        system = ClockSystem(ClockedIntervalGains.from_plant(plant, L=L, M=M))
        document = unproved(body)
        document["gains"] |= {"L": L.tolist(), "M": M.tolist()}
        design = check_events.Design(json.dumps(changed(document, lambda d: None)))
        design.read()
        still, driven = (check_events.WidthMaps(design, homogeneous=x) for x in (True, False))
        u = rng.uniform(0, 1, 2)
        for k in range(len(design.sensors)):
            check_stages(driven.sampled(k), (system.sampled(k),), u)
        for kind in ((0,), (1,), (0, 1), (1, 0)):
            stages = [stage.homogeneous() for stage in system.happened(kind)]
            check_stages(still.happened(kind), stages, u)


def check_stages(own: Any, stages: Any, u: Any) -> None:
    """What each stage makes of u, one after the other."""
    image, other = [Fraction(a) for a in u], exact(u)
    assert len(own) == len(stages)
    for maps, stage in zip(own, stages, strict=True):
        image, other = check_events.least(maps, image), stage(other)
        assert np.allclose([float(a) for a in image], to_float(other), rtol=1e-12, atol=0)


def test_a_box_is_as_high_as_the_bend_between_its_ends() -> None:
    """e^-t - e^-2t about its peak at ln 2: both ends are lower by h^2 / 8 times 1/2, nearly."""
    one, h = Fraction(1), Fraction(1, 1000)
    flow = check_events.PositiveFlow([[-one, 0 * one], [one, -2 * one]], [0 * one, 0 * one])
    X, Y = flow.box(Fraction(math.log(2)) - h / 2, h)
    y = [one, 0 * one, one]
    bound = max(check_events.dot(X[1], y), check_events.dot(Y[1], y))
    assert Fraction(1, 4) < bound < Fraction(1, 4) + h * h / 64


def test_boxes_hold_the_path() -> None:
    """At all times of a box, also where the path bends most."""
    rng = np.random.default_rng(25)
    for _ in range(20):
        n = int(rng.integers(1, 4))
        W = rng.uniform(0, 1, (n, n)) - 3 * np.diag(rng.uniform(0, 1, n))
        f, start = rng.uniform(0, 1, n), rng.uniform(0, 2, n)
        rows = [[Fraction(a) for a in row] for row in W]
        flow = check_events.PositiveFlow(rows, [Fraction(a) for a in f])
        t, h = float(rng.uniform(0, 1)), float(rng.uniform(0, 2))
        ends = flow.box(Fraction(t), Fraction(h))
        y = [Fraction(a) for a in (*start, 1.0)]
        bound = [max(float(check_events.dot(X[i], y)) for X in ends) for i in range(n)]
        Z = np.block([[W, f[:, None]], [np.zeros((1, n + 1))]])
        for s in np.linspace(t, t + h, 30):
            path = expm(Z * s)[:n] @ np.array([*start, 1.0])
            assert (path <= np.array(bound) * (1 + 1e-12)).all()


def test_a_limit_that_is_met_is_not_below() -> None:
    """u' = 1 - u from 0: below 1 for ever, and below 1 - e^-2 up to 2 alone."""
    flow = check_events.PositiveFlow([[Fraction(-1)]], [Fraction(1)])
    limit, start = Fraction(1 - math.exp(-2.0)), [Fraction(0)]
    assert flow.is_below(start, 0, limit * (1 + Fraction(1, 10**9)), (Fraction(0), Fraction(2)))
    assert flow.is_below(start, 0, limit * (1 + Fraction(1, 10**9)), (Fraction(1), Fraction(2)))
    assert not flow.is_below(start, 0, limit * (1 - Fraction(1, 10**9)), (Fraction(1), Fraction(2)))


def test_a_peak_inside_of_a_range_is_met() -> None:
    """u1' = -u1, u2' = u1 - 2 u2 from (1, 0): u2 = e^-t - e^-2t has its peak 1/4 at ln 2."""
    one = Fraction(1)
    flow = check_events.PositiveFlow([[-one, 0 * one], [one, -2 * one]], [0 * one, 0 * one])
    ends = (Fraction(0), Fraction(9))
    assert flow.is_below([one, 0 * one], 1, Fraction(250001, 10**6), ends)
    assert not flow.is_below([one, 0 * one], 1, Fraction(249999, 10**6), ends)
    assert flow.is_below([one, 0 * one], 1, Fraction(250001, 10**6), (Fraction(0), math.inf))


def test_what_it_shares_is_the_same_text() -> None:
    """So that what is tested of one is tested of both."""
    own, other = definitions(check_events), definitions(check_widths)
    shared = set(own) & set(other)
    assert {name for name in shared if own[name] != other[name]} == {"Design", "prove_width",
                                                                     "prove_design"}  # fmt: skip
    assert {"Ball", "exponential", "array", "number", "main"} <= shared


@pytest.mark.parametrize(
    ("A", "v", "code"),
    [
        ([[0.5, 0.0], [1.0, -1.0]], [1.0, 1.1], 0),  # x2 falls while x1 is held by its samples
        ([[0.5, 0.0], [1.0, -1.0]], [1.0, 0.9], 1),
        ([[-1.0, 0.0], [1.0, -1.0]], [1.0, 0.9], 0),  # x2 rises first, and is lower later
        ([[-1.0, 0.0], [1.0, -1.0]], [1.0, 0.2], 1),
        ([[8.0, 0.0], [0.0, -1.0]], [1.0, 1.0], 0),  # x1 grows by less than 1 from nothing
        ([[8.0, 0.0], [40.0, -1.0]], [1.0, 1.0], 1),
    ],
)
def test_each_way_to_bound_an_entry_counts(A: Any, v: list[float], code: int) -> None:
    """Without events: it falls, or all entries flow from an earlier time, or from a sample."""

    def change(d: dict[str, Any]) -> None:
        d["problem"]["flow"]["A"] = d["gains"]["A"] = A
        evidence(d, "event_stability").update(tube=[v])

    assert exit_code(changed(document("two states"), change), check_events) == code


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_state_that_grows_does_not_return(place: int) -> None:
    """Whichever it is; where all decay, all are lower at some later time."""
    zeros, y = [Fraction(0)] * 3, [Fraction(1)] * 4
    for rate, returns in ((Fraction(1, 10), False), (Fraction(-1, 10), True)):
        rates = [rate if i == place else Fraction(-1) for i in range(3)]
        W = [[a if i == j else Fraction(0) for j in range(3)] for i, a in enumerate(rates)]
        flow = check_events.PositiveFlow(W, zeros)
        if returns:
            assert flow.time_of_return(y, Fraction(1)) > 0
        else:
            with pytest.raises(check_events.NotProved):
                flow.time_of_return(y, Fraction(1))
