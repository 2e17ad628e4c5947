"""Events and sensors in a problem file: what they mean, and what is refused."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.data.simulation import simulate
from obsdesign.data.simulation.rows import instants_of
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.kinds import KINDS, TAKING_CLOCKS
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from tests.systems.clocks import DOSES, renamed, two_clocks


def test_a_problem_of_events_and_sensors_survives_its_own_text() -> None:
    problem = Problem.from_dict(DOSES)
    assert Problem.from_dict(problem.to_dict()) == problem
    assert [event.name for event in problem.plant.events] == ["dose", "bolus"]
    assert problem.plant.events[0].dwell_time == (6.0, 14.0)
    assert [sensor.gap for sensor in problem.plant.sensors] == [math.inf, 6.0 * 2 + 2 * 0.5]
    assert (problem.plant.n, problem.plant.p) == (3, 2)
    bounds = problem.plant.outputs.noise_bound
    assert bounds is not None
    assert bounds.tolist() == [[-0.02, 0.02], [-0.1, 0.2]]


def test_a_sensor_may_say_that_its_stamps_are_exact() -> None:
    body = copy.deepcopy(DOSES)
    body["sensor"][1]["time_error"] = 0
    assert Problem.from_dict(body) == Problem.from_dict(DOSES)


REFUSALS: list[tuple[tuple[Any, ...], Any, str]] = [
    (("event", 0, "name"), "x1", "'x1' is kept for other columns"),
    (("event", 0, "name"), "received", "'received' is kept for other columns"),
    (("event", 0, "name"), "Dose", "event.name must be a small letter"),
    (("event", 0, "name"), "plasma", "column 'plasma' is doubled"),
    (
        ("sensor", 0),
        {"name": "u", "C": [[1, 0, 0], [0, 1, 0]], "noise_bound": 1, "every": 1},
        "sensor.u: its column is 'u1', a name",
    ),
    (("event", 0, "every"), [14, 6], r"event.dose.every must be \[shortest, longest\]"),
    (("event", 0, "every"), 0, "event.dose.every must be a positive number or a pair"),
    (("event", 0, "dwell_time"), [6, 14], r"'dwell_time' in \[event.dose\]: it is 'every' there"),
    (("event", 0, "E"), [[1], [0]], "event.dose.E must have 3 rows"),
    (("event", 1, "G"), [[1, 0]], "event.bolus.G must be square"),
    (("sensor", 1, "period"), 6, r"'period' in \[sensor.tissue\]: it is 'every' there"),
    (
        ("sensor", 1, "time_error"),
        0.5,
        r"noise_bound that is larger by 0\.5 times the largest rate",
    ),
    (("sensor", 1, "time_error"), -1, "sensor.tissue.time_error must be a number >= 0"),
    (("sensor", 1, "jitter"), 3.5, "sensor.tissue.jitter must be from 0 to half of every, 3"),
    (("sensor", 1, "every"), [0, 6], "jitter requires a number as sensor.tissue.every"),
    (("sensor", 1, "every"), "often", "sensor.tissue.every must be a positive number"),
    (("sensor", 1, "losses"), 0.5, "sensor.tissue.losses must be a whole number"),
    (("sensor", 1, "losses"), 10**19, "sensor.tissue.losses must be a whole number, from 0"),
    (("sensor", 0, "sends_on_change"), -1, "sensor.plasma.sends_on_change must be >= 0; got -1"),
    (("sensor", 0, "sends_on_change"), 0, "sensor.plasma.sends_on_change"),
    (("sensor", 0, "sends_on_change"), [1, 2], "sends_on_change must have 1"),
    (("sensor", 1, "sends_on_change"), 1, r"requires sensor.tissue.every = \[0, longest silence\]"),
    (("sensor", 0, "at"), "dose", "sensor.plasma.at .an event. is required; got both"),
    (("sensor", 1, "C"), [[0, 1]], "sensor.tissue.C must have 3 columns"),
    (("sensor", 1, "noise_bound"), [[0.2, 0.1]], "sensor.tissue.noise_bound: lower must not"),
    (("output",), {"C": [[0, 1, 0]]}, r"\[output\] may not be mixed with \[\[sensor\]\]"),
    (("jump",), {}, r"\[jump\] may not be mixed with \[\[sensor\]\]"),
]


@pytest.mark.parametrize(("place", "value", "words"), REFUSALS)
def test_an_entry_that_cannot_be_met_is_named(
    place: tuple[Any, ...], value: Any, words: str
) -> None:
    body: Any = copy.deepcopy(DOSES)
    inner = body
    for step in place[:-1]:
        inner = inner[step]
    inner[place[-1]] = value
    with pytest.raises(InputError, match=words):
        Problem.from_dict(body)


def test_a_sensor_is_read_at_an_event_that_there_is() -> None:
    body: Any = copy.deepcopy(DOSES)
    body["sensor"][0] = {"name": "plasma", "C": [[0, 1, 0]], "noise_bound": 0.1, "at": "meal"}
    with pytest.raises(
        InputError, match=r"sensor.plasma.at must be .* \(dose, bolus\); got 'meal'"
    ):
        Problem.from_dict(body)
    body["sensor"][0]["at"] = "bolus"
    assert Problem.from_dict(body).plant.sensors[0].event == "bolus"


def test_a_sensor_or_an_output_is_required() -> None:
    flow = DOSES["flow"]
    for body, entry in (({"flow": flow}, "output"), ({"flow": flow, "event": []}, "sensor")):
        with pytest.raises(InputError, match=f"{entry} is required"):
            Problem.from_dict(body)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in TAKING_CLOCKS])
def test_a_kind_of_one_clock_names_those_of_several(kind: str) -> None:
    with pytest.raises(
        DoesNotApply, match=r"the plant has 2 .* Observers for several: interval, set_mem"
    ):
        obsdesign.design(Problem.from_dict(DOSES).for_kind(kind)[0])


@pytest.mark.parametrize(
    ("kind", "clock", "required"),
    [
        ("luenberger", {"every": 0.5}, 'must have every = "continuous" or at = "EVENT"'),
        ("impulsive", {"every": "continuous"}, 'must have at = "EVENT"'),
    ],
)
def test_a_refused_clock_is_named_as_the_file_has_it(
    kind: str, clock: dict[str, Any], required: str
) -> None:
    ((key, value),) = clock.items()
    body: Any = {
        "flow": {"A": [[-1.0]], "D": [[1.0]]},
        "event": [{"name": "dose", "G": [[0.5]], "every": [1.0, 2.0]}],
        "sensor": [{"name": "scale", "C": [[1.0]], "noise_bound": [0.1], **clock}],
        "observer": {"kind": kind},
    }
    with pytest.raises(DoesNotApply) as refusal:
        obsdesign.design(Problem.from_dict(body))
    assert f"sensor.scale {required} for kind {kind!r}; got {key} = {value!r}." in str(
        refusal.value
    )


def test_bounds_of_every_noise_are_required() -> None:
    body: Any = copy.deepcopy(DOSES)
    del body["sensor"][1]["noise_bound"]
    with pytest.raises(DoesNotApply, match=r"sensor.tissue.noise_bound is required by kind 'set_"):
        obsdesign.design(Problem.from_dict(body))
    with pytest.raises(InputError, match="noise_bound is required where another sensor has one"):
        simulate(Problem.from_dict(body).plant)


@pytest.mark.parametrize("kind", ["set_membership", "luenberger", "interval"])
def test_one_event_and_one_sensor_are_a_jump_and_an_output(kind: str) -> None:
    """Named or not: the same gains, claims and estimates."""
    plain = {**two_clocks(), "observer": {"kind": kind}}
    designs = [obsdesign.design(Problem.from_dict(body)) for body in (plain, renamed(plain))]
    first, second = (design.to_dict() for design in designs)
    for key in ("gains", "claims", "guarantees"):
        assert first[key] == second[key]
    run = simulate(Problem.from_dict(plain).plant, until=8.0, rng=np.random.default_rng(2))
    start: Any = {"lower": [-2, -2], "upper": [2, 2]} if kind != "luenberger" else {"x": [0, 0]}
    batches = [
        from_design(design).run_batch(  # type: ignore[attr-defined]
            run.t, run.block("y"), jump=run.columns["jump"], **start
        )
        for design in designs
    ]
    values = [batch.x if kind == "luenberger" else batch.lower for batch in batches]
    assert np.array_equal(*values)


def test_named_records_say_what_plain_ones_say() -> None:
    """A plant by other names draws the same record, under other titles."""
    plain = two_clocks()
    runs = [
        simulate(Problem.from_dict(body).plant, until=8.0, rng=np.random.default_rng(2))
        for body in (plain, renamed(plain))
    ]
    assert list(runs[1].columns) == ["t", "level", "stroke", "x1", "x2"]
    assert np.array_equal(runs[0].columns["y1"], runs[1].columns["level"], equal_nan=True)
    assert np.array_equal(runs[0].columns["jump"] == 1, runs[1].columns["stroke"] == 1)
    assert np.array_equal(runs[0].block("x"), runs[1].block("x"))


@pytest.mark.parametrize("seed", range(4))
def test_simulated_clocks_keep_what_is_stated(seed: int) -> None:
    plant = Problem.from_dict(DOSES).plant
    rows = instants_of(plant, "random", 400.0, None, np.random.default_rng(seed))
    for k, event in enumerate(plant.events):
        assert event.dwell_time is not None
        gaps = np.diff(rows.times[rows.happens[:, k]])
        assert len(gaps) > 5
        assert event.dwell_time[0] <= gaps.min() <= gaps.max() <= event.dwell_time[1]
    tissue = rows.times[rows.is_measured[:, 1]]
    apart = np.diff(tissue)
    assert apart.max() <= plant.sensors[1].gap
    assert apart.max() > 6 + 2 * 0.5  # some are lost
    assert np.abs(tissue / 6 - np.round(tissue / 6)).max() <= 0.5 / 6
    happens = np.hstack([rows.is_measured, rows.happens]).any(axis=1)
    assert happens[1:].all()
    assert rows.times[0] == 0.0


def test_a_sensor_at_an_event_is_read_there_alone() -> None:
    body: Any = copy.deepcopy(DOSES)
    body["sensor"][0] = {"name": "plasma", "C": [[0, 1, 0]], "noise_bound": 0.1, "at": "bolus"}
    run = simulate(Problem.from_dict(body).plant, rng=np.random.default_rng(1))
    assert run.happened is not None
    assert np.array_equal(np.isfinite(run.columns["plasma"]), run.happened[:, 1])
    with pytest.raises(InputError, match=r"random or shortest for several events \(dose, bolus\)"):
        simulate(Problem.from_dict(body).plant, dwell=3.0)


def test_an_event_brings_its_own_input() -> None:
    events = [
        {"name": "left", "E": [[1], [0]], "every": [1, 2]},
        {"name": "right", "E": [[0, 0], [2, 1]], "every": [1, 3]},
    ]
    sensor = {"name": "both", "C": [[1, 1]], "every": "continuous"}
    problem = Problem.from_dict(
        {"flow": {"A": [[0, 0], [0, 0]]}, "event": events, "sensor": [sensor]}
    )
    run = simulate(problem.plant, until=20.0, initial=[0.0, 0.0])
    left, first, second = (np.nan_to_num(run.columns[x]) for x in ("left", "right1", "right2"))
    assert np.allclose(run.block("x"), np.cumsum(np.column_stack([left, 2 * first + second]), 0))
    assert run.happened is not None
    assert np.array_equal(np.isfinite(run.columns["right1"]), run.happened[:, 1])
