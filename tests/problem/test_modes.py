"""[[mode]] of a problem file: what it means, and what is refused in one line."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from obsdesign.errors import DoesNotApply, InputError
from obsdesign.kinds import KINDS, TAKING_MODES
from obsdesign.problem.problem import Problem
from obsdesign.workflow import investigate
from tests.systems.switched import random_switched, valve

Change = Callable[[dict[str, Any]], object]


def test_modes_stand_in_the_normal_form_and_come_back() -> None:
    problem = valve()
    assert Problem.from_dict(problem.to_dict()) == problem
    assert problem.plant.modes == Problem.from_dict(problem.to_dict()).plant.modes
    assert problem.plant.modes[0] != problem.plant.modes[1]
    for seed in range(5):
        drawn = random_switched(np.random.default_rng(seed), "interval")
        assert Problem.from_dict(drawn.to_dict()) == drawn


def test_a_mode_has_what_it_states_and_shares_the_rest() -> None:
    body = valve().to_dict()
    body["mode"][0] |= {"C": [[1, 0]], "disturbance": {"lower": [0, 0], "upper": [1, 2]}}
    body["mode"][0]["G"] = [[1, 1], [0, 1]]
    plant = Problem.from_dict(body).plant
    opened, closed = plant.in_mode(0), plant.in_mode(1)
    assert opened.flow.upper.tolist() == [1, 2]
    assert closed.flow.upper.tolist() == [0.01, 0.01]
    assert opened.output.C.tolist() == [[1, 0]]
    assert closed.output.C.tolist() == [[0, 1]]
    assert opened.flow.A[0, 0] == -0.6
    assert closed.flow.A[0, 0] == 0.05
    assert opened.jump is None
    entered = plant.in_mode(0, entered=True).jump
    assert entered is not None
    assert entered.G.tolist() == [[1, 1], [0, 1]]
    assert plant.in_mode(1, entered=True).jump is None


def test_flow_A_serves_modes_without_their_own() -> None:
    body = valve().to_dict()
    del body["mode"][1]["A"]
    plant = Problem.from_dict(body).plant
    assert plant.in_mode(1).flow.A.tolist() == plant.flow.A.tolist()
    del body["flow"]["A"]
    with pytest.raises(InputError, match=r"flow\.A is required, since mode\.closed has no A"):
        Problem.from_dict(body)


def _event(**entries: object) -> dict[str, object]:
    return {"name": "stroke", "every": 5, **entries}


def _mode(**entries: object) -> Change:
    return lambda body: body["mode"][0].update(entries)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (_mode(every=[0, 1]), "mode.open.every: the shortest stay must be > 0"),
        (_mode(every=[3, 1]), "mode.open.every must be [shortest, longest]"),
        (_mode(every=["inf", "inf"]), "mode.open.every must be"),
        (_mode(every="continuous"), "mode.open.every must be"),
        (lambda b: b["mode"][0].pop("every"), "mode.open.every is required"),
        (_mode(next=["shut"]), "mode.open.next must hold names of other modes (closed)"),
        (_mode(next=["open"]), "mode.open.next must hold names of other modes (closed)"),
        (_mode(next=[]), "mode.open.next must name a mode"),
        (_mode(name="closed"), "mode.name must differ from mode to mode"),
        (_mode(name="t"), "mode.name: 't' is kept for other columns"),
        (_mode(name="Open"), "mode.name must be a small letter"),
        (_mode(A=[[1]]), "mode.open.A must have 2 rows"),
        (_mode(B=[[1], [2]]), "mode.open.B must have 0 columns"),
        (_mode(C=[[1, 2, 3]]), "mode.open.C must have 2 columns"),
        (_mode(G=[[1]]), "mode.open.G must have 2 rows"),
        (_mode(gains={"L": [[1, 2]]}), "mode.open.gains.L must have 2 rows"),
        (_mode(gains={"M": [[1], [2]]}), "unknown key 'M' in [mode.open.gains]"),
        (_mode(disturbance={"lower": [0], "upper": [1]}), "mode.open.disturbance must have 2"),
        (_mode(disturbance={"lower": [1, 1], "upper": [0, 0]}), "lower must not exceed upper"),
        (_mode(stay=[1, 2]), "unknown key 'stay' in [mode.open]"),
        (lambda b: b["mode"].pop(), "[[mode]]: two modes or more are required"),
        (lambda b: b.update(event=[_event(modes=["ajar"])]), "event.stroke.modes must name modes"),
        (lambda b: b.update(event=[_event(modes=["open"] * 2)]), "once each; got 'open'"),
        (lambda b: b.update(event=[_event(modes=[])]), "event.stroke.modes must name a mode"),
        (lambda b: b.update(event=[_event(time_error=0.1)]), "time_error is not available with"),
    ],
)
def test_refusals_name_the_entry(change: Change, text: str) -> None:
    body = copy.deepcopy(valve().to_dict())
    change(body)
    with pytest.raises(InputError) as refusal:
        Problem.from_dict(body)
    assert text in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_modes_are_not_mixed_with_a_jump() -> None:
    body = valve().to_dict()
    sensor = body.pop("sensor")[0]
    body["output"] = {"C": sensor["C"], "noise_bound": sensor["noise_bound"]}
    assert Problem.from_dict(body).plant.modes
    body["jump"] = {"dwell_time": [1, 2]}
    with pytest.raises(InputError, match=r"\[\[mode\]\] may not be mixed with \[jump\]"):
        Problem.from_dict(body)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in TAKING_MODES])
def test_other_kinds_refuse_modes(kind: str) -> None:
    with pytest.raises(DoesNotApply, match="Observers for modes: interval, luenberger"):
        investigate(valve().for_kind(kind)[0])


@pytest.mark.parametrize(
    ("observer", "text"),
    [
        ({"kind": "interval", "objective": "feasible"}, "observer.objective is not available"),
        ({"kind": "interval", "form": "coordinates"}, "observer.form must be cooperative or split"),
        ({"kind": "interval", "gains": {"M": [[0], [0]]}}, "observer.gains.M is not available"),
        ({"kind": "luenberger", "poles": [-1, -2]}, "observer.poles is not available"),
        ({"kind": "luenberger", "memory": 2}, "observer.memory is not available"),
    ],
)
def test_options_about_other_plants_are_refused(observer: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError) as refusal:
        investigate(valve(**observer))
    assert text in str(refusal.value)


@pytest.mark.parametrize("kind", TAKING_MODES)
@pytest.mark.parametrize("every", [0.1, [0.05, 0.1]], ids=["periodic", "irregular"])
def test_sampled_sensors_and_several_of_them_are_refused(kind: str, every: Any) -> None:
    """Each refusal names what modes require, for the plant as it is."""
    body = valve(kind=kind).to_dict()
    body["sensor"][0]["every"] = every
    words = (
        r'must have every = "continuous" with \[\[mode\]\].* without modes: interval, set_member'
    )
    with pytest.raises(InputError, match=words):
        investigate(Problem.from_dict(body))
    body["sensor"].append({**body["sensor"][0], "name": "second"})
    for mode in body["mode"]:
        del mode["gains"]
    words = r"\[\[mode\]\] requires one sensor .* 2 \(\w+, second\)\. .* with all rows in C"
    with pytest.raises(InputError, match=words):
        investigate(Problem.from_dict(body))


def test_several_sensors_of_every_row_are_one_with_all_rows() -> None:
    """What the refusal of two of them says to write."""
    body = valve().to_dict()
    own = {"C": [[0, 1], [1, 0]], "noise_bound": [0.01, 0.02], "every": "continuous"}
    body["sensor"] = [{"name": "level", **own}]
    for mode in body["mode"]:
        del mode["gains"]
    assert investigate(Problem.from_dict(body)).verdict == "proved"


def test_gains_of_the_observer_serve_modes_without_their_own() -> None:
    body = valve().to_dict()
    del body["mode"][1]["gains"]
    body["observer"]["gains"] = {"L": [[0], [1]]}
    first, second = Problem.from_dict(body).in_modes
    assert first.gains["L"].tolist() == [[0.1], [2]]
    assert second.gains["L"].tolist() == [[0], [1]]


@pytest.mark.parametrize("kind", TAKING_MODES)
@pytest.mark.parametrize(
    ("event", "text"),
    [
        ({"name": "stroke"}, "event.stroke.every is required by [[mode]]"),
        ({"name": "stroke", "every": [0, 5]}, "event.stroke.every: the shortest time must be > 0"),
    ],
)
def test_events_within_modes_need_a_shortest_time(
    kind: str, event: dict[str, Any], text: str
) -> None:
    body = valve(kind=kind).to_dict() | {"event": [event]}
    with pytest.raises(InputError) as refusal:
        investigate(Problem.from_dict(body))
    assert text in str(refusal.value)


def test_modes_of_an_event_need_modes() -> None:
    body = valve().to_dict()
    del body["mode"]
    body["event"] = [_event(modes=["open"])]
    with pytest.raises(InputError, match=r"event\.stroke\.modes requires \[\[mode\]\]"):
        Problem.from_dict(body)
